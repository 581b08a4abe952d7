//! Rotations that the gyroscope measured between poses, which share the gyroscope's bias.
//!
//! They are what tells the focal length while the camera goes straight: a wrong one makes every turn too large or too
//! small. Residual: `log(dR(b)^T R_i^T R_j)`, the rotation part of Forster and others, "On-manifold preintegration" (TRO
//! 2017), eq. 37.

use cairn_geometry::{Se3, So3, Vec3};

/// Standard deviation of the bias at a usual MEMS gyroscope, rad/s.
pub(crate) const BIAS_SIGMA: f64 = 0.05;

/// The rotation of the camera from one pose to another, by the gyroscope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroLink {
    /// Index of the earlier pose.
    pub from: usize,
    /// Index of the later pose.
    pub to: usize,
    /// Rotation gained in the camera frame of the earlier pose, with a bias of zero.
    pub rotation: So3,
    /// Its length, seconds.
    pub seconds: f64,
    /// Standard deviation of the rotation on each axis, radians.
    pub sigma: f64,
}

/// The residual of a link, radians.
pub(crate) fn residual(link: &GyroLink, poses: &[Se3], bias: &Vec3) -> Vec3 {
    let turned = poses[link.from].rotation.inverse() * poses[link.to].rotation;
    let measured = link.rotation * So3::exp(&(bias * -link.seconds));
    (measured.inverse() * turned).log()
}
