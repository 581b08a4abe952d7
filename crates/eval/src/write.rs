//! Writers of trajectory files: TUM, KITTI, EuRoC. Poses are `world_from_body`.

use crate::error::FileError;
use crate::header::TrajectoryHeader;
use cairn_geometry::{Se3, Trajectory};
use std::fmt::Write as _;
use std::path::Path;

/// Seconds as text with exactly nine decimals.
pub fn seconds_text(stamp_ns: i64) -> String {
    let sign = if stamp_ns < 0 { "-" } else { "" };
    let ns = stamp_ns.unsigned_abs();
    format!("{sign}{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

/// TUM: `t x y z qx qy qz qw`, seconds and metres with nine decimals, the time exact to the nanosecond.
pub fn to_tum(trajectory: &Trajectory) -> String {
    let mut out = String::from("# timestamp tx ty tz qx qy qz qw\n");
    for (stamp_ns, pose) in trajectory.iter() {
        let (p, q) = (pose.translation, pose.rotation.quaternion());
        let _ = writeln!(
            out,
            "{} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            seconds_text(stamp_ns),
            p.x,
            p.y,
            p.z,
            q.i,
            q.j,
            q.k,
            q.w
        );
    }
    out
}

/// TUM, with what the poses are of said before them.
pub fn to_tum_with(header: &TrajectoryHeader, trajectory: &Trajectory) -> String {
    header.to_text() + &to_tum(trajectory)
}

/// KITTI: the 3x4 matrix by rows with nine decimals; times are not stored.
pub fn to_kitti(trajectory: &Trajectory) -> String {
    let mut out = String::new();
    for pose in trajectory.poses() {
        let m = pose.matrix();
        let row = |r: usize| (0..4).map(move |c| (r, c));
        let cells: Vec<String> = (0..3).flat_map(row).map(|at| format!("{:.9e}", m[at])).collect();
        let _ = writeln!(out, "{}", cells.join(" "));
    }
    out
}

/// EuRoC csv: `ns,x,y,z,qw,qx,qy,qz`.
pub fn to_euroc(trajectory: &Trajectory) -> String {
    let mut out = String::from(
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n",
    );
    for (stamp_ns, Se3 { rotation, translation: p }) in trajectory.iter() {
        let q = rotation.quaternion();
        let _ = writeln!(
            out,
            "{stamp_ns},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9},{:.9}",
            p.x, p.y, p.z, q.w, q.i, q.j, q.k
        );
    }
    out
}

/// Writes a text file atomically; see [`write_bytes_whole`].
///
/// # Errors
/// When the file cannot be written.
pub fn write_whole(path: &Path, text: &str) -> Result<(), FileError> {
    write_bytes_whole(path, text.as_bytes())
}

/// Writes a file atomically: into a temporary file in the same folder, which is then renamed.
///
/// # Errors
/// When the file cannot be written; an existing file is left unchanged.
pub fn write_bytes_whole(path: &Path, content: &[u8]) -> Result<(), FileError> {
    let fail =
        |e: std::io::Error| FileError::whole(&path.display().to_string(), format!("cannot write: {e}"));
    let name = path.file_name().ok_or_else(|| {
        FileError::whole(&path.display().to_string(), "cannot write: the path has no file name")
    })?;
    let mut part = std::ffi::OsString::from(".");
    part.push(name);
    part.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(part);
    std::fs::write(&part, content).and_then(|()| std::fs::rename(&part, path)).map_err(|e| {
        let _ = std::fs::remove_file(&part);
        fail(e)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Format, parse_trajectory};
    use cairn_geometry::{So3, Vec3};

    #[test]
    fn written_files_round_trip() {
        let mut t = Trajectory::new();
        for i in 0..50 {
            let a = f64::from(i);
            let rotation = So3::exp(&Vec3::new(0.03 * a, -0.05 * a, 0.11 * a));
            let pose = Se3::new(rotation, Vec3::new(0.37 * a, -a.sin(), a * a * 1e-3));
            t.push(1_403_636_584_763_555_584 + i64::from(i) * 50_000_001, pose).unwrap();
        }
        let formats =
            [(Format::Tum, to_tum(&t)), (Format::Kitti, to_kitti(&t)), (Format::Euroc, to_euroc(&t))];
        for (format, text) in formats {
            let file = parse_trajectory(&text, "t", Some(t.stamps_ns())).unwrap();
            assert_eq!(file.format, format);
            assert_eq!(file.trajectory.stamps_ns(), t.stamps_ns(), "{format:?}");
            for (a, b) in t.poses().iter().zip(file.trajectory.poses()) {
                let error = a.inverse() * *b;
                assert!(error.translation.norm() < 2e-8 && error.rotation.angle() < 1e-8, "{format:?}");
            }
        }
    }

    #[test]
    fn files_are_written_atomically() {
        let folder = std::env::temp_dir().join(format!("cairn-eval-write-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.txt");
        write_whole(&path, "one\n").unwrap();
        write_whole(&path, "two\n").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two\n");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "no temporary file is left behind");
        let error = write_whole(&folder.join("none/b.txt"), "x").unwrap_err().to_string();
        assert!(error.contains("none/b.txt") && error.contains("cannot write"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
