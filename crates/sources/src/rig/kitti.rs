//! KITTI odometry `calib.txt`: a 3x4 projection per camera of the rectified rig.

use crate::text::{data_lines, fields, numbers, place, read_text};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Rig, RigCamera, SourceError};
use std::path::Path;

/// Projections `P0:` to `P3:` as in the file, with their line; `None` for absent ones.
pub type Projections = [Option<(usize, [f64; 12])>; 4];

/// Reads the `P` lines; other lines (`Tr:`) are ignored.
pub fn projections(path: &Path) -> Result<Projections, SourceError> {
    let text = read_text(path)?;
    let mut out = [None; 4];
    for (number, line) in data_lines(&text) {
        let Some((key, rest)) = line.split_once(':') else { continue };
        let index = match key.trim() {
            "P0" | "P_rect_00" => 0,
            "P1" | "P_rect_01" => 1,
            "P2" | "P_rect_02" => 2,
            "P3" | "P_rect_03" => 3,
            _ => continue,
        };
        let values = numbers::<12>(fields(rest)).ok_or_else(|| {
            SourceError::new(place(path, number), "a projection needs 12 finite numbers", "correct the line")
        })?;
        out[index] = Some((number, values));
    }
    if out.iter().all(Option::is_none) {
        return Err(SourceError::new(
            path.display().to_string(),
            "has no line \"P0:\"",
            "give a KITTI calib.txt",
        ));
    }
    Ok(out)
}

/// The size of the rectified images that the `S_rect_00` of a raw recording's `calib_cam_to_cam.txt` states.
pub fn stated_size(path: &Path) -> Result<Option<[usize; 2]>, SourceError> {
    let text = read_text(path)?;
    let stated = data_lines(&text).find_map(|(_, line)| line.strip_prefix("S_rect_00:"));
    let size = stated.and_then(|rest| numbers::<2>(fields(rest)));
    Ok(size
        .filter(|size| size.iter().all(|side| (1.0..1e6).contains(side)))
        .map(|size| size.map(|side| side as usize)))
}

/// The rig of two of the cameras (`[0, 1]` gray or `[2, 3]` colour); the body is camera 0 of the file, whose
/// poses the ground truth gives: `P = K [I | t]`, so a camera is at `-K^-1 P[:, 3]`.
pub fn rig(path: &Path, all: &Projections, which: &[usize], size: [usize; 2]) -> Result<Rig, SourceError> {
    let mut cameras = Vec::new();
    for &i in which {
        let (line, p) = all[i].ok_or_else(|| {
            SourceError::new(
                path.display().to_string(),
                format!("has no line \"P{i}:\""),
                "complete the file",
            )
        })?;
        let [fx, cx, fy, cy] = [p[0], p[2], p[5], p[6]];
        let camera = Camera::pinhole(size[0], size[1], fx, fy, cx, cy);
        camera
            .validate()
            .map_err(|e| SourceError::new(place(path, line), e.to_string(), "correct the projection"))?;
        let z = p[11];
        let origin = -Vec3::new((p[3] - cx * z) / fx, (p[7] - cy * z) / fy, z);
        cameras.push(RigCamera {
            name: format!("image_{i}"),
            camera,
            body_from_camera: Se3::new(So3::identity(), origin),
        });
    }
    Ok(Rig { cameras, depth: None, imu: None })
}
