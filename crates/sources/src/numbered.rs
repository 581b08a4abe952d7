//! Images whose file names are numbers, as in the folders of KITTI.

use crate::decode;
use std::path::{Path, PathBuf};

pub struct NumberedImage {
    /// The number.
    pub number: usize,
    /// The file.
    pub path: PathBuf,
}

/// The images of a folder whose names are numbers, in numeric order.
pub fn numbered(folder: &Path) -> Result<Vec<NumberedImage>, String> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut files: Vec<NumberedImage> = entries
        .filter_map(|e| Some(e.ok()?.path()))
        .filter_map(|path| {
            let extension = path.extension()?.to_str()?.to_ascii_lowercase();
            let number = path.file_stem()?.to_str()?.parse().ok()?;
            matches!(extension.as_str(), "png" | "jpg" | "jpeg").then_some(NumberedImage { number, path })
        })
        .collect();
    files.sort_by(|a, b| (a.number, &a.path).cmp(&(b.number, &b.path)));
    files.dedup_by_key(|f| f.number);
    match files.is_empty() {
        true => Err(format!("{} holds no numbered PNG or JPEG", folder.display())),
        false => Ok(files),
    }
}

/// Width and height of the first readable image of a camera of a KITTI folder.
pub fn image_size(folder: &Path, camera: usize) -> Result<[usize; 2], String> {
    let files = numbered(&folder.join(format!("image_{camera}")))?;
    let mut problem = format!("no image in image_{camera}");
    for file in files {
        match decode::size(&file.path) {
            Ok(size) => return Ok(size),
            Err(e) => problem = e.to_string(),
        }
    }
    Err(problem)
}
