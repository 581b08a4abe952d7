//! The first image in the folder of a recording.

use crate::decode;
use std::path::{Path, PathBuf};

/// Where images lie in recordings of the known kinds.
const INSIDE: [&str; 13] = [
    "",
    "mav0/cam0/data",
    "cam0/data",
    "image_0",
    "image_2",
    "image_00/data",
    "image_02/data",
    "rgb",
    "color",
    "results",
    "images",
    "img",
    "rgbd",
];

/// Endings of images that are not read.
const UNREAD: [&str; 13] =
    ["webp", "tif", "tiff", "pgm", "ppm", "pnm", "heic", "heif", "avif", "jxl", "exr", "gif", "npy"];

/// Of a folder whose images are of a kind that is not read, which that is, and the way out.
pub fn unread(folder: &Path) -> Option<String> {
    let first = |inside: &&str| {
        let files = std::fs::read_dir(folder.join(inside)).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
        files.filter(|path| ending(path).is_some()).min()
    };
    let path = INSIDE.iter().find_map(first)?;
    let (ending, parent) = (ending(&path)?, path.parent()?.display());
    // What holds numbers rather than shades has to keep them.
    let with = match ending.as_str() {
        "npy" | "exr" => "to PNG, depth to 16 bits".to_owned(),
        _ => format!("with mogrify -format png {parent}/*.{ending}"),
    };
    Some(format!("{} is an image of a kind that is not read: convert them {with}", path.display()))
}

fn ending(path: &Path) -> Option<String> {
    let ending = path.extension()?.to_str()?;
    UNREAD.iter().any(|unread| ending.eq_ignore_ascii_case(unread)).then(|| ending.to_owned())
}

/// Columns and rows of the first image that can be read.
pub fn size(folder: &Path) -> Option<[usize; 2]> {
    let first = |folder: PathBuf| {
        let files = std::fs::read_dir(folder).ok()?.filter_map(|e| Some(e.ok()?.path()));
        let mut files: Vec<PathBuf> = files
            .filter(|p| p.file_name().is_some_and(|name| !name.to_string_lossy().contains("depth")))
            .collect();
        files.sort();
        files.iter().filter(|p| p.is_file()).take(50).find_map(|p| decode::size(p).ok())
    };
    INSIDE.iter().find_map(|inside| first(folder.join(inside)))
}
