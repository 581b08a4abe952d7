//! Loads a trajectory from a path: a file in any known format, or the ground truth in a data set folder.

use crate::decimal;
use crate::error::FileError;
use crate::read::{Format, KITTI_STEP_NS, TrajectoryFile, parse_trajectory, pose_from_matrix};
use cairn_geometry::Trajectory;
use std::fs;
use std::path::{Path, PathBuf};

/// Largest file of poses: ten hours at 200 Hz.
const MAX_BYTES: u64 = 1024 * cairn_files::MIB;

/// Ground-truth files in folders of known data sets, in the order in which they are tried.
const GROUND_TRUTH_FILES: [&str; 7] = [
    "mav0/state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0/data.csv",
    "mav0/mocap0/data.csv",
    "mocap0/data.csv",
    "groundtruth.txt",
    "gt_tum.txt",
    "poses.txt",
];

/// Reads the trajectory at a path: a TUM, KITTI or EuRoC file, or a folder of EuRoC, TUM, KITTI or 7-Scenes that
/// contains ground truth. A KITTI file takes its times from `times.txt` in the same folder, if present.
///
/// # Errors
/// When the file cannot be read or parsed, or the folder contains no known ground truth.
pub fn load_trajectory(path: &Path) -> Result<TrajectoryFile, FileError> {
    let name = path.display().to_string();
    if path.is_dir() {
        if let Some(file) = GROUND_TRUTH_FILES.iter().map(|f| path.join(f)).find(|f| f.is_file()) {
            return load_trajectory(&file);
        }
        return load_matrices(path);
    }
    let text = read(path)?;
    let file = parse_trajectory(&text, &name, None)?;
    let times_path = path.with_file_name("times.txt");
    if file.format == Format::Kitti && times_path.is_file() {
        let times = parse_times(&read(&times_path)?, &times_path.display().to_string())?;
        let last = file.trajectory.stamps_ns().last().map_or(0, |ns| ns / KITTI_STEP_NS) as usize;
        if times.len() == file.trajectory.len() || (file.frame_numbers && times.len() > last) {
            return parse_trajectory(&text, &name, Some(&times));
        }
    }
    Ok(file)
}

fn read(path: &Path) -> Result<String, FileError> {
    let name = path.display().to_string();
    cairn_files::read_text(path, MAX_BYTES).map_err(|e| FileError::whole(&name, format!("cannot read: {e}")))
}

fn parse_times(text: &str, name: &str) -> Result<Vec<i64>, FileError> {
    let lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    lines
        .map(|(i, line)| {
            decimal::nanoseconds(line.trim()).ok_or_else(|| {
                FileError::at(name, i + 1, format!("'{}' is not a time in seconds", line.trim()))
            })
        })
        .collect()
}

/// 7-Scenes: files `frame-000123.pose.txt` with a 4x4 matrix each; nominal times at 30 Hz from the frame number.
fn load_matrices(folder: &Path) -> Result<TrajectoryFile, FileError> {
    let name = folder.display().to_string();
    let entries = fs::read_dir(folder).map_err(|e| FileError::whole(&name, format!("cannot read: {e}")))?;
    let mut frames: Vec<(i64, PathBuf)> = entries
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let digits = path.file_name()?.to_str()?.strip_prefix("frame-")?.strip_suffix(".pose.txt")?;
            Some((digits.parse().ok()?, path))
        })
        .collect();
    frames.sort();
    if frames.is_empty() {
        return Err(FileError::whole(
            &name,
            "no ground truth found in this folder (looked for EuRoC, TUM, KITTI and 7-Scenes files); name the \
             file itself",
        ));
    }
    let mut trajectory = Trajectory::new();
    let mut unknown_poses = 0;
    for (number, path) in frames {
        let name = path.display().to_string();
        let text = read(&path)?;
        let values: Vec<f64> = text.split_ascii_whitespace().filter_map(|v| v.parse().ok()).collect();
        if values.len() != 16 {
            return Err(FileError::whole(&name, "not a 4x4 matrix"));
        }
        if values.iter().any(|v| !v.is_finite()) {
            unknown_poses += 1;
            continue;
        }
        let pose = pose_from_matrix(&values).map_err(|e| FileError::whole(&name, e.to_string()))?;
        let stamp_ns = (i128::from(number) * 1_000_000_000 / 30).try_into();
        let stamp_ns = stamp_ns.map_err(|_| FileError::whole(&name, "the frame number is too large"))?;
        trajectory.push(stamp_ns, pose).map_err(|e| FileError::whole(&name, e.to_string()))?;
    }
    let format = Format::Matrices;
    let numbered = TrajectoryFile {
        trajectory,
        name,
        format,
        has_rotations: true,
        nominal_times: true,
        frame_numbers: true,
        unknown_poses,
        header: None,
    };
    Ok(numbered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;

    #[test]
    fn loads_folders_and_times_files() {
        let folder = std::env::temp_dir().join(format!("cairn-eval-load-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let error = load_trajectory(&folder).unwrap_err().to_string();
        assert!(error.contains("no ground truth found"), "{error}");
        fs::write(folder.join("frame-000003.pose.txt"), "1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n").unwrap();
        let scenes = load_trajectory(&folder).unwrap();
        assert_eq!(scenes.trajectory.stamps_ns(), [100_000_000]);
        assert_eq!(scenes.trajectory.poses()[0].translation, Vec3::new(5.0, 6.0, 7.0));
        fs::write(folder.join("frame-000004.pose.txt"), "1 0 0\n").unwrap();
        assert!(
            load_trajectory(&folder).unwrap_err().to_string().contains("frame-000004.pose.txt: not a 4x4")
        );
        fs::write(folder.join("poses.txt"), "1 0 0 4 0 1 0 5 0 0 1 6\n1 0 0 7 0 1 0 8 0 0 1 9\n").unwrap();
        fs::write(folder.join("times.txt"), "0\n1.037000e-01\n").unwrap();
        let kitti = load_trajectory(&folder).unwrap();
        assert_eq!(kitti.trajectory.stamps_ns(), [0, 103_700_000]);
        fs::write(folder.join("times.txt"), "0\n").unwrap();
        assert_eq!(
            load_trajectory(&folder).unwrap().trajectory.stamps_ns()[1],
            100_000_000,
            "times.txt of another length is ignored"
        );
        fs::write(folder.join("times.txt"), "0\nlate\n").unwrap();
        assert!(load_trajectory(&folder).unwrap_err().to_string().contains("times.txt:2: 'late'"));
        assert!(load_trajectory(&folder.join("none")).unwrap_err().to_string().contains("cannot read"));
        fs::write(folder.join("binary"), [0xff, 0xf0, 0x00]).unwrap();
        assert!(load_trajectory(&folder.join("binary")).unwrap_err().to_string().contains("not text"));
        fs::remove_dir_all(&folder).unwrap();
    }
}
