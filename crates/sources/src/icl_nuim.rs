//! ICL-NUIM in the layout of TUM RGB-D: images named by their numbers, and poses in a file `*.gt.freiburg`.
//!
//! Handa et al., "A benchmark for RGB-D visual odometry, 3D reconstruction and SLAM" (2014). Its camera has fy = -480: its y axis
//! points up, in the camera as in the world. Here y points down in both, which makes each pose `F T F` with `F` the reflection
//! along y.

use crate::recording::{ImageAt, read_truth};
use cairn_eval::Format;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Skipped, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// Images a second.
pub const RATE_HZ: f64 = 30.0;

/// The file of poses, by which a folder is one of this data set.
pub fn poses_file(folder: &Path) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let is_one =
        |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(".gt.freiburg"));
    files.filter(is_one).min()
}

/// The camera that the data set states, with y down.
pub fn camera() -> Camera {
    Camera::pinhole(640, 480, 481.2, 480.0, 319.5, 239.5)
}

/// True poses of the camera, y down, at the times of numbered frames.
pub fn truth(path: &Path, skipped: &mut Vec<Skipped>) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let poses = read_truth(path, Format::Tum, skipped)?;
    Ok(poses.into_iter().map(|(number, pose)| (at_rate(number), y_down(&pose))).collect())
}

/// The time of a frame whose number is written as seconds.
pub fn at_rate(number: Stamp) -> Stamp {
    Stamp((number.0 as f64 / RATE_HZ).round() as i64)
}

fn y_down(pose: &Se3) -> Se3 {
    let (t, q) = (pose.translation, pose.rotation.quaternion());
    // A reflection turns the axis of a rotation as a pseudovector: what is along y stays, the rest is turned round.
    let rotation = So3::from_xyzw(-q.i, q.j, -q.k, q.w).unwrap_or(pose.rotation);
    Se3::new(rotation, Vec3::new(t.x, -t.y, t.z))
}

/// Whether "times" are the numbers of frames: each is that in the name of its image, and they are whole.
pub fn are_numbers(images: &[(Stamp, ImageAt)]) -> bool {
    let is_number = |(stamp, at): &(Stamp, ImageAt)| match at {
        ImageAt::File(path) => {
            let name = path.file_stem().and_then(|s| s.to_str()).and_then(|s| s.parse::<i64>().ok());
            // A time since 1970 in a name is no number of a frame.
            name.is_some_and(|n| n < 1_000_000 && stamp.0 == n * 1_000_000_000)
        }
        _ => false,
    };
    images.len() > 1 && images.iter().all(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point stays at its pixel: seen by a camera with y up and fy below zero, or by one with y down.
    #[test]
    fn the_camera_with_y_down_sees_what_the_one_with_y_up_sees() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.3, -0.2, 0.5)), Vec3::new(1.0, 2.0, -0.5));
        let point = Vec3::new(0.4, 2.3, 3.0);
        let seen = pose.inverse() * point;
        let pixel_of_up = (481.2 * seen.x / seen.z + 319.5, -480.0 * seen.y / seen.z + 239.5);
        let down = y_down(&pose).inverse() * Vec3::new(point.x, -point.y, point.z);
        let pixel = camera().project(&down).unwrap();
        assert!(
            (pixel.x - pixel_of_up.0).abs() + (pixel.y - pixel_of_up.1).abs() < 1e-9,
            "{pixel} {pixel_of_up:?}"
        );
    }
}
