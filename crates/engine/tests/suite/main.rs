//! The integration tests of this crate, as one program.

mod bare_walls;
mod baseline;
mod delayed;
mod dense;
mod frames;
mod inertial;
mod journal;
mod locate;
mod lost_by_depth;
mod odometry;
mod registration;
mod resume;
mod sliced;

/// The kitchen recording.
fn kitchen() -> Option<String> {
    recording("7scenes-kitchen")
}

/// A recording; prints "skipped" where it is missing.
fn recording(name: &str) -> Option<String> {
    let data = std::env::var_os("CAIRN_DATA").map_or_else(
        || std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        std::path::PathBuf::from,
    );
    let folder = data.join(name);
    if !folder.exists() {
        println!("skipped: {} is missing", folder.display());
        return None;
    }
    Some(folder.to_string_lossy().into_owned())
}
