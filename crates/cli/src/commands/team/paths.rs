//! Names of the files of a robot of a team.

use std::path::{Path, PathBuf};

/// `NAME.EXTENSION` beside a file.
pub fn beside(path: &Path, extension: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".");
    name.push(extension);
    path.with_file_name(name)
}
