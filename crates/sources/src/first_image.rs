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
