//! Rigid transforms.
//!
//! Source: Solà et al. (2018), appendix D; the tangent vector is (translation, rotation).

use crate::{Manifold, Mat3, So3, Vec3, hat};
use nalgebra::{Matrix4, SVector};
use std::ops::Mul;

/// A rigid transform `a_from_b`: `p_a = rotation * p_b + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// Rotation part.
    pub rotation: So3,
    /// Translation part in metres (the origin of `b` seen in `a`).
    pub translation: Vec3,
}

impl Default for Se3 {
    fn default() -> Self {
        Self::identity()
    }
}

impl Se3 {
    /// From its parts.
    pub fn new(rotation: So3, translation: Vec3) -> Self {
        Self { rotation, translation }
    }

    /// The transform that changes nothing.
    pub fn identity() -> Self {
        Self::new(So3::identity(), Vec3::zeros())
    }

    /// From a 4x4 matrix; the rotation block is replaced by the nearest rotation.
    pub fn from_matrix(m: &Matrix4<f64>) -> Self {
        let r: Mat3 = m.fixed_view::<3, 3>(0, 0).into();
        let t: Vec3 = m.fixed_view::<3, 1>(0, 3).into();
        Self::new(So3::from_matrix(&r), t)
    }

    /// The 4x4 matrix.
    pub fn matrix(&self) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation.matrix());
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }

    /// The inverse transform, `b_from_a`.
    pub fn inverse(&self) -> Self {
        let r = self.rotation.inverse();
        Self::new(r, -(r * self.translation))
    }

    /// Exponential of (translation, rotation).
    pub fn exp(d: &SVector<f64, 6>) -> Self {
        let (v, w): (Vec3, Vec3) = (d.fixed_rows::<3>(0).into(), d.fixed_rows::<3>(3).into());
        Self::new(So3::exp(&w), So3::left_jacobian(&w) * v)
    }

    /// Logarithm as (translation, rotation).
    pub fn log(&self) -> SVector<f64, 6> {
        let w = self.rotation.log();
        let v = So3::left_jacobian_inverse(&w) * self.translation;
        SVector::<f64, 6>::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    /// The adjoint: `self * exp(d) == exp(adjoint * d) * self`.
    pub fn adjoint(&self) -> nalgebra::SMatrix<f64, 6, 6> {
        let r = self.rotation.matrix();
        let mut a = nalgebra::SMatrix::<f64, 6, 6>::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&(hat(&self.translation) * r));
        a
    }

    /// Interpolates position linearly and rotation spherically: `self` at `t = 0`, `other` at `t = 1`.
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        Self::new(
            self.rotation.interpolate(&other.rotation, t),
            self.translation + (other.translation - self.translation) * t,
        )
    }

    /// True when every number is finite.
    pub fn is_finite(&self) -> bool {
        self.translation.iter().all(|v| v.is_finite())
            && self.rotation.quaternion().coords.iter().all(|v| v.is_finite())
    }
}

impl Mul for Se3 {
    type Output = Se3;
    fn mul(self, rhs: Se3) -> Se3 {
        Se3::new(self.rotation * rhs.rotation, self.translation + self.rotation * rhs.translation)
    }
}

impl Mul<Vec3> for Se3 {
    type Output = Vec3;
    fn mul(self, rhs: Vec3) -> Vec3 {
        self.rotation * rhs + self.translation
    }
}

impl Manifold<6> for Se3 {
    fn retract(&self, delta: &SVector<f64, 6>) -> Self {
        *self * Self::exp(delta)
    }
    fn local(&self, other: &Self) -> SVector<f64, 6> {
        (self.inverse() * *other).log()
    }
}
