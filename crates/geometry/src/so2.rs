//! Rotations in the plane.

use crate::{Manifold, Vec2};
use nalgebra::{SMatrix, SVector};
use std::ops::Mul;

/// A rotation in the plane, stored as cosine and sine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct So2 {
    cos: f64,
    sin: f64,
}

impl So2 {
    /// The identity rotation.
    pub fn identity() -> Self {
        Self { cos: 1.0, sin: 0.0 }
    }

    /// Counter-clockwise rotation by an angle in radians.
    pub fn exp(angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { cos, sin }
    }

    /// The angle in radians, in (-pi, pi].
    pub fn log(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// The rotation with cosine and sine proportional to the given values; `None` when both are zero or one is not
    /// finite.
    pub fn from_cos_sin(cos: f64, sin: f64) -> Option<Self> {
        let norm = cos.hypot(sin);
        (norm.is_finite() && norm > 1e-12).then(|| Self { cos: cos / norm, sin: sin / norm })
    }

    /// Cosine of the angle.
    pub fn cos(&self) -> f64 {
        self.cos
    }

    /// Sine of the angle.
    pub fn sin(&self) -> f64 {
        self.sin
    }

    /// The inverse rotation.
    pub fn inverse(&self) -> Self {
        Self { cos: self.cos, sin: -self.sin }
    }

    /// The 2x2 matrix.
    pub fn matrix(&self) -> SMatrix<f64, 2, 2> {
        SMatrix::<f64, 2, 2>::new(self.cos, -self.sin, self.sin, self.cos)
    }

    /// `2 sin(angle / 2)`, and its derivative with respect to the angle.
    pub(crate) fn chord(&self) -> (f64, f64) {
        let half = 0.5 * self.log();
        (2.0 * half.sin(), half.cos())
    }
}

impl Mul for So2 {
    type Output = So2;
    fn mul(self, rhs: So2) -> So2 {
        let (cos, sin) = (self.cos * rhs.cos - self.sin * rhs.sin, self.sin * rhs.cos + self.cos * rhs.sin);
        // One Newton step towards unit norm, so that products of many rotations remain rotations.
        let scale = 1.5 - 0.5 * (cos * cos + sin * sin);
        So2 { cos: cos * scale, sin: sin * scale }
    }
}

impl Mul<Vec2> for So2 {
    type Output = Vec2;
    fn mul(self, rhs: Vec2) -> Vec2 {
        Vec2::new(self.cos * rhs.x - self.sin * rhs.y, self.sin * rhs.x + self.cos * rhs.y)
    }
}

impl Manifold<1> for So2 {
    fn retract(&self, delta: &SVector<f64, 1>) -> Self {
        *self * Self::exp(delta[0])
    }
    fn local(&self, other: &Self) -> SVector<f64, 1> {
        SVector::<f64, 1>::new((self.inverse() * *other).log())
    }
}
