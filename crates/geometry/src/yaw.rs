//! Poses with known roll and pitch: a rotation about the vertical and a translation, four degrees of freedom.
//!
//! Gravity makes roll and pitch observable, so that only these four drift (Qin, Li, Shen, "VINS-Mono", 2018, section
//! VIII). Body frames are gravity-aligned first; every transform between gravity-aligned frames is in this group.

use crate::{LieGroup, Manifold, Mat3, Se3, So2, So3, Vec2, Vec3};
use nalgebra::{Matrix4, Vector4};
use std::ops::Mul;

/// A transform `a_from_b` between gravity-aligned frames (both with z up): `p_a = yaw * p_b + translation`, yaw about
/// z.
///
/// The tangent vector is (translation, yaw); as in [`crate::Se2`] the retraction is not the exponential map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YawPose {
    /// Rotation about z.
    pub yaw: So2,
    /// Translation part in metres (the origin of `b` in `a`).
    pub translation: Vec3,
}

impl YawPose {
    /// From yaw and translation.
    pub fn new(yaw: So2, translation: Vec3) -> Self {
        Self { yaw, translation }
    }

    /// The identity transform.
    pub fn identity() -> Self {
        Self::new(So2::identity(), Vec3::zeros())
    }

    /// The inverse transform, `b_from_a`.
    pub fn inverse(&self) -> Self {
        let r = self.yaw.inverse();
        let t = Self::new(r, Vec3::zeros()) * self.translation;
        Self::new(r, -t)
    }

    /// Decomposes `world_from_body` (z of the world up) into `world_from_level` and the tilt `level_from_body`, which
    /// contains roll and pitch: `world_from_body = world_from_level * level_from_body`.
    ///
    /// Of all such decompositions it is the one with the smallest tilt (swing-twist decomposition about z).
    pub fn split(world_from_body: &Se3) -> (Self, So3) {
        let r = world_from_body.rotation.matrix();
        let (cos, sin) = (r[(0, 0)] + r[(1, 1)], r[(1, 0)] - r[(0, 1)]);
        // Upside down the twist is undefined and any value is valid.
        let yaw = So2::from_cos_sin(cos, sin).unwrap_or(So2::identity());
        let level = Self::new(yaw, world_from_body.translation);
        (level, level.rotation().inverse() * world_from_body.rotation)
    }

    /// The measurement between gravity-aligned frames nearest to a measurement `a_from_b` between tilted bodies.
    ///
    /// Each tilt is `level_from_body` as returned by [`YawPose::split`]. The part of the measured rotation that is not
    /// about the vertical contradicts gravity and is dropped.
    pub fn between(tilt_a: &So3, a_from_b: &Se3, tilt_b: &So3) -> Self {
        let level = Se3::new(*tilt_a * a_from_b.rotation * tilt_b.inverse(), *tilt_a * a_from_b.translation);
        Self::split(&level).0
    }

    /// The yaw as a rotation in three dimensions.
    pub fn rotation(&self) -> So3 {
        So3::exp(&Vec3::new(0.0, 0.0, self.yaw.log()))
    }

    /// The full pose including the tilt: `world_from_body` from `level_from_body`.
    pub fn tilted(&self, level_from_body: &So3) -> Se3 {
        Se3::new(self.rotation() * *level_from_body, self.translation)
    }
}

impl Mul for YawPose {
    type Output = YawPose;
    fn mul(self, rhs: YawPose) -> YawPose {
        YawPose::new(self.yaw * rhs.yaw, self * rhs.translation)
    }
}

impl Mul<Vec3> for YawPose {
    type Output = Vec3;
    fn mul(self, rhs: Vec3) -> Vec3 {
        let rotated = self.yaw * Vec2::new(rhs.x, rhs.y);
        Vec3::new(rotated.x, rotated.y, rhs.z) + self.translation
    }
}

impl Manifold<4> for YawPose {
    fn retract(&self, delta: &Vector4<f64>) -> Self {
        *self * Self::new(So2::exp(delta.w), Vec3::new(delta.x, delta.y, delta.z))
    }
    fn local(&self, other: &Self) -> Vector4<f64> {
        (self.inverse() * *other).coordinates()
    }
}

impl LieGroup<4> for YawPose {
    fn identity() -> Self {
        Self::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        *self * *other
    }
    fn inverse(&self) -> Self {
        self.inverse()
    }
    fn adjoint(&self) -> Matrix4<f64> {
        let mut a = self.coordinates_jacobian();
        a[(0, 3)] = self.translation.y;
        a[(1, 3)] = -self.translation.x;
        a
    }
    fn coordinates(&self) -> Vector4<f64> {
        let t = &self.translation;
        Vector4::new(t.x, t.y, t.z, self.yaw.log())
    }
    fn coordinates_jacobian(&self) -> Matrix4<f64> {
        let mut j = Matrix4::identity();
        let (c, s) = (self.yaw.cos(), self.yaw.sin());
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&Mat3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0));
        j
    }
    fn chordal(&self) -> Vector4<f64> {
        let t = &self.translation;
        Vector4::new(t.x, t.y, t.z, self.yaw.chord().0)
    }
    fn chordal_jacobian(&self) -> Matrix4<f64> {
        let mut j = self.coordinates_jacobian();
        j[(3, 3)] = self.yaw.chord().1;
        j
    }
    fn is_finite(&self) -> bool {
        self.translation.iter().chain([&self.yaw.cos(), &self.yaw.sin()]).all(|v| v.is_finite())
    }
}
