//! Rotations that the gyroscope measured between poses, which share the gyroscope's bias and the offset of its clock.
//!
//! They are what tells the focal length while the camera goes straight: a wrong one makes every turn too large or too
//! small. Residual: `log(dR(b)^T R_i^T R_j)`, the rotation part of Forster and others, "On-manifold preintegration" (TRO
//! 2017), eq. 37.

use cairn_geometry::{Mat3, Se3, So3, Vec3};

/// Standard deviation of the bias at a usual MEMS gyroscope, rad/s.
pub(crate) const BIAS_SIGMA: f64 = 0.05;

/// Standard deviation of the offset of the clocks that the readings were taken with, seconds.
pub(crate) const LATE_SIGMA_S: f64 = 0.02;

/// The rotation of the camera from one pose to another, by the gyroscope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroLink {
    /// Index of the earlier pose.
    pub from: usize,
    /// Index of the later pose.
    pub to: usize,
    /// Rotation gained in the camera frame of the earlier pose, with a bias of zero.
    pub rotation: So3,
    /// The rate at the earlier pose and at the later one, rad/s, each in the camera frame there.
    pub rates: [Vec3; 2],
    /// Its length, seconds.
    pub seconds: f64,
    /// Standard deviation of the rotation on each axis, radians.
    pub sigma: f64,
}

/// What is estimated of the gyroscope: its bias, rad/s, and by how many seconds its readings are to be taken later.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Clock {
    pub bias: Vec3,
    pub late_s: f64,
}

/// A link, linearised: the residual, radians, and its derivatives by the rotations of both poses, bias and offset.
pub(crate) struct Linearised {
    pub residual: Vec3,
    pub by_from: Mat3,
    pub by_to: Mat3,
    pub by_bias: Mat3,
    pub by_late: Vec3,
}

impl Clock {
    /// What the gyroscope measured, from later readings: `exp(-late w_i) dR exp(late w_j)`, less the bias.
    fn measured(&self, link: &GyroLink) -> So3 {
        let [before, after] = link.rates.map(|rate| So3::exp(&(rate * self.late_s)));
        before.inverse() * link.rotation * after * So3::exp(&(self.bias * -link.seconds))
    }

    /// The residual of a link, radians.
    pub fn residual(&self, link: &GyroLink, poses: &[Se3]) -> Vec3 {
        let turned = poses[link.from].rotation.inverse() * poses[link.to].rotation;
        (self.measured(link).inverse() * turned).log()
    }

    /// The same with its derivatives.
    pub fn linearised(&self, link: &GyroLink, poses: &[Se3]) -> Linearised {
        let residual = self.residual(link, poses);
        let inverse = So3::right_jacobian_inverse(&residual);
        let back = (poses[link.to].rotation.inverse() * poses[link.from].rotation).matrix();
        // Bias and offset turn from the left, whose Jacobian is the transposed one of the right.
        let turned = So3::right_jacobian(&(self.bias * -link.seconds));
        let unbiased = So3::exp(&(self.bias * link.seconds));
        let [first, last] = link.rates;
        let between = So3::exp(&(last * -self.late_s)) * link.rotation.inverse();
        Linearised {
            residual,
            by_from: -(inverse * back),
            by_to: inverse,
            by_bias: inverse.transpose() * turned * link.seconds,
            by_late: inverse.transpose() * (unbiased * (between * first - last)),
        }
    }
}
