//! Rigid transforms in the plane.
//!
//! The tangent vector is (translation, angle). The retraction applies translation and rotation directly, without the
//! coupling of the exponential map: the usual parametrisation of planar pose graphs (g2o, GTSAM), so that costs are
//! comparable.

use crate::{LieGroup, Manifold, So2, Vec2};
use nalgebra::{Matrix3, Vector3};
use std::ops::Mul;

/// A rigid transform of the plane `a_from_b`: `p_a = rotation * p_b + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se2 {
    /// Rotation part.
    pub rotation: So2,
    /// Translation part in metres (the origin of `b` in `a`).
    pub translation: Vec2,
}

impl Se2 {
    /// From rotation and translation.
    pub fn new(rotation: So2, translation: Vec2) -> Self {
        Self { rotation, translation }
    }

    /// From x and y in metres and an angle in radians.
    pub fn from_xy_angle(x: f64, y: f64, angle: f64) -> Self {
        Self::new(So2::exp(angle), Vec2::new(x, y))
    }

    /// The identity transform.
    pub fn identity() -> Self {
        Self::new(So2::identity(), Vec2::zeros())
    }

    /// The inverse transform, `b_from_a`.
    pub fn inverse(&self) -> Self {
        let r = self.rotation.inverse();
        Self::new(r, -(r * self.translation))
    }
}

impl Mul for Se2 {
    type Output = Se2;
    fn mul(self, rhs: Se2) -> Se2 {
        Se2::new(self.rotation * rhs.rotation, self.translation + self.rotation * rhs.translation)
    }
}

impl Mul<Vec2> for Se2 {
    type Output = Vec2;
    fn mul(self, rhs: Vec2) -> Vec2 {
        self.rotation * rhs + self.translation
    }
}

impl Manifold<3> for Se2 {
    fn retract(&self, delta: &Vector3<f64>) -> Self {
        *self * Self::from_xy_angle(delta.x, delta.y, delta.z)
    }
    fn local(&self, other: &Self) -> Vector3<f64> {
        (self.inverse() * *other).coordinates()
    }
}

impl LieGroup<3> for Se2 {
    fn identity() -> Self {
        Self::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        *self * *other
    }
    fn inverse(&self) -> Self {
        self.inverse()
    }
    fn adjoint(&self) -> Matrix3<f64> {
        let (c, s, t) = (self.rotation.cos(), self.rotation.sin(), self.translation);
        Matrix3::new(c, -s, t.y, s, c, -t.x, 0.0, 0.0, 1.0)
    }
    fn coordinates(&self) -> Vector3<f64> {
        Vector3::new(self.translation.x, self.translation.y, self.rotation.log())
    }
    fn coordinates_jacobian(&self) -> Matrix3<f64> {
        let (c, s) = (self.rotation.cos(), self.rotation.sin());
        Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    }
    fn chordal(&self) -> Vector3<f64> {
        Vector3::new(self.translation.x, self.translation.y, self.rotation.chord().0)
    }
    fn chordal_jacobian(&self) -> Matrix3<f64> {
        let mut j = self.coordinates_jacobian();
        j[(2, 2)] = self.rotation.chord().1;
        j
    }
    fn is_finite(&self) -> bool {
        self.translation.iter().chain([&self.rotation.cos(), &self.rotation.sin()]).all(|v| v.is_finite())
    }
}
