//! Images whose file names are numbers, as in the folders of KITTI.

use crate::decode::{self, ImageError};
use std::path::{Path, PathBuf};

/// Why a folder has no numbered image that can be read.
#[derive(Debug, thiserror::Error)]
pub enum NumberedError {
    /// It cannot be listed.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// It has no such file.
    #[error("{0} holds no numbered PNG or JPEG")]
    None(String),
    /// None of them can be read; why not the last one.
    #[error(transparent)]
    Image(ImageError),
}

pub struct NumberedImage {
    /// The number.
    pub number: usize,
    /// The file.
    pub path: PathBuf,
}

/// The images of a folder whose names are numbers, in numeric order.
pub fn numbered(folder: &Path) -> Result<Vec<NumberedImage>, NumberedError> {
    numbered_after(folder, "")
}

/// The images of a folder whose names are numbers after a word, in numeric order.
pub fn numbered_after(folder: &Path, prefix: &str) -> Result<Vec<NumberedImage>, NumberedError> {
    numbered_with(folder, prefix, |rest| rest.parse().ok())
}

fn numbered_with(
    folder: &Path,
    prefix: &str,
    number_of: impl Fn(&str) -> Option<usize>,
) -> Result<Vec<NumberedImage>, NumberedError> {
    let path = || folder.display().to_string();
    let entries =
        std::fs::read_dir(folder).map_err(|source| NumberedError::Folder { path: path(), source })?;
    let mut files: Vec<NumberedImage> = entries
        .filter_map(|e| Some(e.ok()?.path()))
        .filter_map(|path| {
            let number = number_of(path.file_stem()?.to_str()?.strip_prefix(prefix)?)?;
            decode::is_image(&path).then_some(NumberedImage { number, path })
        })
        .collect();
    files.sort_by(|a, b| (a.number, &a.path).cmp(&(b.number, &b.path)));
    files.dedup_by_key(|f| f.number);
    match files.is_empty() {
        true => Err(NumberedError::None(path())),
        false => Ok(files),
    }
}

/// The images of a folder in the order of their numbers, whatever stands before or after these: the number is what differs in
/// their names, up to the next letter.
pub fn numbered_somehow(folder: &Path) -> Result<Vec<NumberedImage>, NumberedError> {
    let files = std::fs::read_dir(folder)
        .map_err(|source| NumberedError::Folder { path: folder.display().to_string(), source })?;
    let files = files.filter_map(|e| Some(e.ok()?.path())).filter(|path| decode::is_image(path));
    let stems: Vec<String> = files.filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned())).collect();
    let first = stems.first().map_or("", String::as_str);
    let in_all = |stem: &String| first.bytes().zip(stem.bytes()).take_while(|(a, b)| a == b).count();
    let same = stems.iter().map(in_all).min().unwrap_or(0);
    let prefix = first.get(..same).unwrap_or("").trim_end_matches(|c: char| c.is_ascii_digit());
    numbered_with(folder, prefix, |rest| {
        let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        rest[..end].parse().ok()
    })
}

/// Width and height of the first readable image of a folder.
pub fn image_size(folder: &Path) -> Result<[usize; 2], NumberedError> {
    let mut problem = NumberedError::None(folder.display().to_string());
    for file in numbered(folder)? {
        match decode::size(&file.path) {
            Ok(size) => return Ok(size),
            Err(e) => problem = NumberedError::Image(e),
        }
    }
    Err(problem)
}
