//! Whether the poses turn as the gyroscope says, by one factor.
//!
//! A lens that is `a` times too long shows every turn of the camera across its view `a` times too small. Gravity leaks into the
//! accelerations then, in step with the sway of a walk, and lengths are wrong by far more than the lens is. Least squares over the
//! links, about the two axes across the view: `seen = factor measured + bias t - offset (rate at the end - rate at the begin)`;
//! the residuals tell how certain the factor is.

use super::input::Seen;
use crate::{Bias, Preintegrated};
use cairn_geometry::{Se3, Vec3};
use nalgebra::{Matrix4, Vector4};

/// The logarithm of (rotations seen over rotations measured) and its standard deviation; `None` where the camera does not turn,
/// and with too few links to tell how certain it is.
pub fn seen_over_measured(seen: &Seen, links: &[Preintegrated], imu_from_camera: &Se3) -> Option<[f64; 2]> {
    let to_camera = imu_from_camera.rotation.inverse();
    let mut normal = Matrix4::zeros();
    let (mut right, mut squares, mut rows) = (Vector4::zeros(), 0.0, 0);
    for (pair, link) in seen.poses.windows(2).zip(links) {
        let (first, last) = (link.samples().first()?, link.samples().last()?);
        let turned = pair[0].world_from_camera.rotation.inverse() * pair[1].world_from_camera.rotation;
        let seen: Vec3 = turned.log();
        let measured = to_camera * link.gained(&Bias::default()).0.log();
        let rates = to_camera * (last.gyro - first.gyro);
        for axis in 0..2 {
            let mut row = Vector4::new(measured[axis], 0.0, 0.0, -rates[axis]);
            row[1 + axis] = link.seconds();
            normal += row * row.transpose();
            right += row * seen[axis];
            squares += seen[axis].powi(2);
            rows += 1;
        }
    }
    let freedom = f64::from(rows - 4);
    let inverse = normal.try_inverse().filter(|_| freedom > 0.0)?;
    let found = inverse * right;
    let variance = (squares - found.dot(&right)).max(0.0) / freedom;
    let [factor, sigma] = [found[0], (variance * inverse[(0, 0)]).max(0.0).sqrt()];
    (factor > 0.0 && sigma.is_finite()).then(|| [factor.ln(), sigma / factor])
}
