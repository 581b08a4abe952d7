//! Where the recordings are.

use std::path::PathBuf;

/// The folder of a recording: in `CAIRN_DATA`, or beside the repository. Where it is missing, that is printed.
pub fn recording(name: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let root = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = root.join(name);
    if !folder.is_dir() {
        println!("skipped: {} is missing", folder.display());
        return None;
    }
    Some(folder)
}
