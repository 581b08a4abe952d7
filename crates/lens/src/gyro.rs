//! Rotations that the gyroscope measured between poses, as factors of a bundle with the gyroscope's bias.
//!
//! They are what tells the focal length while the camera goes straight: a wrong one makes every turn too large or too
//! small. Residual: `log(dR(b)^T R_i^T R_j)`, the rotation part of Forster and others, "On-manifold preintegration" (TRO
//! 2017), eq. 37.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_solve::{Equations, Factors, Variable};
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// Standard deviation of the bias at a usual MEMS gyroscope, rad/s.
const BIAS_SIGMA: f64 = 0.05;

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

/// The links of a problem and the bias, in the camera's axes.
#[derive(Clone, Debug)]
pub(crate) struct GyroFactors {
    links: Vec<GyroLink>,
    pub bias: Vec3,
    tried: Vec3,
}

impl GyroFactors {
    pub fn new(links: Vec<GyroLink>) -> Self {
        Self { links, bias: Vec3::zeros(), tried: Vec3::zeros() }
    }

    fn residual(link: &GyroLink, poses: &[Se3], bias: &Vec3) -> Vec3 {
        let turned = poses[link.from].rotation.inverse() * poses[link.to].rotation;
        let measured = link.rotation * So3::exp(&(bias * -link.seconds));
        (measured.inverse() * turned).log()
    }

    /// Half the sum of the squared whitened residuals, and of the bias' prior.
    pub fn cost(&self, poses: &[Se3], bias: &Vec3) -> f64 {
        let of = |l: &GyroLink| Self::residual(l, poses, bias).norm_squared() / l.sigma.powi(2);
        0.5 * (self.links.iter().map(of).sum::<f64>() + bias.norm_squared() / BIAS_SIGMA.powi(2))
    }
}

impl Factors for GyroFactors {
    fn sizes(&self) -> Vec<usize> {
        vec![3; usize::from(!self.links.is_empty())]
    }

    fn held(&self) -> Vec<(usize, Range<usize>)> {
        Vec::new()
    }

    fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        for l in &self.links {
            visit(&[Variable::Pose(l.from), Variable::Pose(l.to), Variable::Own(0)]);
        }
    }

    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        for l in &self.links {
            let residual = Self::residual(l, poses, &self.bias);
            let back = (poses[l.to].rotation.inverse() * poses[l.from].rotation).matrix();
            let by_right = So3::right_jacobian_inverse(&residual);
            let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-(by_right * back)));
            jacobian.fixed_view_mut::<3, 3>(0, 9).copy_from(&by_right);
            let by_bias = by_right * So3::exp(&-residual).matrix() * l.seconds;
            jacobian.fixed_view_mut::<3, 3>(0, 12).copy_from(&by_bias);
            let w = 1.0 / l.sigma;
            let parts = [
                (Some(Variable::Pose(l.from)), 0..6),
                (Some(Variable::Pose(l.to)), 6..12),
                (Some(Variable::Own(0)), 12..15),
            ];
            equations.add(&(residual * w), &(jacobian * w), &parts);
        }
        if !self.links.is_empty() {
            let w = 1.0 / BIAS_SIGMA;
            let jacobian = SMatrix::<f64, 3, 3>::identity() * w;
            let residual: SVector<f64, 3> = self.bias * w;
            equations.add(&residual, &jacobian, &[(Some(Variable::Own(0)), 0..3)]);
        }
        Some(())
    }

    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        self.tried = match step {
            [x, y, z, ..] => self.bias + Vec3::new(*x, *y, *z),
            _ => self.bias,
        };
        self.cost(poses, &self.tried)
    }

    fn accept(&mut self) {
        self.bias = self.tried;
    }
}
