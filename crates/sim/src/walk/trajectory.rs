//! The poses of a trajectory file, for motion through them.

use cairn_eval::{FileError, load_trajectory};
use cairn_geometry::Se3;
use cairn_sensor::{SourceError, Stamp};
use std::path::Path;

/// The poses of a file in TUM format (`t x y z qx qy qz qw`; any other with times and rotations is read too), in the order of
/// their times.
///
/// # Errors
/// Names the file and the line when it cannot be read, has no times or no rotations, or a pose is unknown.
pub fn read_tum(path: &Path) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let refused = |what: String, why: String| {
        SourceError::new(what, why, "write eight numbers a line: t x y z qx qy qz qw")
    };
    let file = load_trajectory(path).map_err(|FileError { file, line, reason }| {
        refused(line.map_or_else(|| file.clone(), |line| format!("{file}:{line}")), reason)
    })?;
    if file.nominal_times {
        return Err(refused(file.name, "has no times".into()));
    }
    if !file.has_rotations {
        return Err(refused(file.name, "has positions only".into()));
    }
    if file.unknown_poses > 0 {
        return Err(refused(file.name, format!("{} of its poses are nan", file.unknown_poses)));
    }
    let trajectory = &file.trajectory;
    Ok(trajectory.stamps_ns().iter().zip(trajectory.poses()).map(|(ns, pose)| (Stamp(*ns), *pose)).collect())
}
