//! Record3D's table: `metadata.json` beside `rgb/`, or `metadata` beside `rgbd/` of an unzipped `.r3d`, with `w`, `h`, the matrix `K`
//! by columns, `fps`, and in newer ones `frameTimestamps`.

use crate::text::{numbers, read_text, stamp_seconds};
use cairn_files::yaml::{self, Node, Value};
use cairn_sensor::{Camera, Rig, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// The file and its content.
pub fn metadata(folder: &Path) -> Option<(PathBuf, Node)> {
    let (path, _) = [("metadata.json", "rgb"), ("metadata", "rgbd")]
        .map(|(file, images)| (folder.join(file), folder.join(images)))
        .into_iter()
        .find(|(file, images)| file.is_file() && images.is_dir())?;
    let root = yaml::parse(&read_text(&path).ok()?).ok()?;
    (root.get("K").is_some() && root.get("w").is_some()).then_some((path, root))
}

/// The camera, scaled where the images have another size than the matrix is of.
///
/// # Errors
/// When the matrix or its size is missing, or is of images of another ratio of the sides.
pub fn rig(folder: &Path, [width, height]: [usize; 2]) -> Result<Rig, SourceError> {
    let (path, root) = metadata(folder).unwrap_or((folder.to_owned(), Node { line: 0, value: Value::Null }));
    let wrong = |why: &str| SourceError::new(path.display().to_string(), why, "give --rig");
    let words = |node: &'_ Node| -> Vec<String> {
        node.list().unwrap_or_default().iter().filter_map(Node::text).map(str::to_owned).collect()
    };
    let k = root.get("K").map(words).unwrap_or_default();
    let k = numbers::<9>(k.iter().map(String::as_str)).ok_or_else(|| wrong("K is no 3x3 matrix"))?;
    let stated = ["w", "h"].map(|key| root.get(key).and_then(Node::text).and_then(|t| t.parse::<f64>().ok()));
    let [Some(w), Some(h)] = stated else { return Err(wrong("w and h are no numbers")) };
    let [by_x, by_y] = [width as f64 / w, height as f64 / h];
    if (by_x / by_y - 1.0).abs() > 0.01 {
        return Err(wrong(&format!("is of images of {w}x{h}, but these have {width}x{height}")));
    }
    let camera = Camera::pinhole(width, height, k[0] * by_x, k[4] * by_y, k[6] * by_x, k[7] * by_y);
    camera.validate().map_err(|e| wrong(&e.to_string()))?;
    Ok(Rig::mono(camera))
}

/// When each image was taken, where that is stated.
pub fn stamps(folder: &Path) -> Option<Vec<Stamp>> {
    let (_, root) = metadata(folder)?;
    let all = root.get("frameTimestamps")?.list()?.iter().map(|node| stamp_seconds(node.text()?));
    all.collect::<Option<Vec<Stamp>>>().filter(|all| !all.is_empty())
}

/// Images a second, where that is stated and possible.
pub fn rate_hz(folder: &Path) -> Option<f64> {
    let (_, root) = metadata(folder)?;
    root.get("fps")?.text()?.parse().ok().filter(|hz| (1.0..=240.0).contains(hz))
}
