//! Similarity transforms: rotation, translation and scale.

use crate::{Se3, So3, Vec3};
use std::ops::Mul;

/// A similarity `a_from_b`: `p_a = scale * (rotation * p_b) + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sim3 {
    /// Rotation part.
    pub rotation: So3,
    /// Translation part in metres of `a`.
    pub translation: Vec3,
    /// Metres of `a` per metre of `b`; positive.
    pub scale: f64,
}

impl Sim3 {
    /// From its parts.
    pub fn new(rotation: So3, translation: Vec3, scale: f64) -> Self {
        Self { rotation, translation, scale }
    }

    /// The similarity that changes nothing.
    pub fn identity() -> Self {
        Self::new(So3::identity(), Vec3::zeros(), 1.0)
    }

    /// Whether every number is finite and the scale positive.
    pub fn is_finite(&self) -> bool {
        Se3::new(self.rotation, self.translation).is_finite() && self.scale.is_finite() && self.scale > 0.0
    }

    /// The inverse similarity.
    pub fn inverse(&self) -> Self {
        let r = self.rotation.inverse();
        Self::new(r, -(r * self.translation) / self.scale, 1.0 / self.scale)
    }

    /// Moves a pose: `a_from_c` from `b_from_c`; lengths are scaled, the rotation stays a rotation.
    pub fn transform_pose(&self, b_from_c: &Se3) -> Se3 {
        Se3::new(self.rotation * b_from_c.rotation, *self * b_from_c.translation)
    }
}

impl From<Se3> for Sim3 {
    fn from(t: Se3) -> Self {
        Self::new(t.rotation, t.translation, 1.0)
    }
}

impl Mul for Sim3 {
    type Output = Sim3;
    fn mul(self, rhs: Sim3) -> Sim3 {
        Sim3::new(self.rotation * rhs.rotation, self * rhs.translation, self.scale * rhs.scale)
    }
}

impl Mul<Vec3> for Sim3 {
    type Output = Vec3;
    fn mul(self, rhs: Vec3) -> Vec3 {
        (self.rotation * rhs) * self.scale + self.translation
    }
}
