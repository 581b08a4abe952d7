//! Rotations in three dimensions: exponential, logarithm and Jacobians.
//!
//! Source: Solà, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), appendix B.

use crate::{Manifold, Mat3, Vec3};
use nalgebra::{Quaternion, UnitQuaternion};
use std::ops::Mul;

/// A rotation, stored as a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct So3(UnitQuaternion<f64>);

/// The skew-symmetric matrix with `hat(a) * b == a.cross(b)`.
pub fn hat(v: &Vec3) -> Mat3 {
    Mat3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

impl So3 {
    /// The identity rotation.
    pub fn identity() -> Self {
        Self(UnitQuaternion::identity())
    }

    /// Wraps a unit quaternion.
    pub fn from_quaternion(q: UnitQuaternion<f64>) -> Self {
        Self(q)
    }

    /// From quaternion components in the order of trajectory files, normalised; `None` when the norm is zero or not
    /// finite.
    pub fn from_xyzw(x: f64, y: f64, z: f64, w: f64) -> Option<Self> {
        let q = Quaternion::new(w, x, y, z);
        let norm = q.norm();
        (norm.is_finite() && norm > 1e-9).then(|| Self(UnitQuaternion::from_quaternion(q)))
    }

    /// The rotation nearest to a matrix in the Frobenius norm, by singular value decomposition.
    pub fn from_matrix(m: &Mat3) -> Self {
        let svd = m.svd(true, true);
        let (Some(u), Some(vt)) = (svd.u, svd.v_t) else { return Self::identity() };
        let sign = (u * vt).determinant().signum();
        let r = u * Mat3::from_diagonal(&Vec3::new(1.0, 1.0, sign)) * vt;
        Self(UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r)))
    }

    /// The quaternion.
    pub fn quaternion(&self) -> &UnitQuaternion<f64> {
        &self.0
    }

    /// The 3x3 matrix.
    #[inline]
    pub fn matrix(&self) -> Mat3 {
        self.0.to_rotation_matrix().into_inner()
    }

    /// Exponential of a rotation vector (radians).
    pub fn exp(w: &Vec3) -> Self {
        let angle2 = w.norm_squared();
        // Half-angle series below 1e-4 rad: the error is under 1e-20.
        let (real, scale) = if angle2 < 1e-8 {
            (1.0 - angle2 / 8.0, 0.5 - angle2 / 48.0)
        } else {
            let angle = angle2.sqrt();
            ((0.5 * angle).cos(), (0.5 * angle).sin() / angle)
        };
        Self(UnitQuaternion::from_quaternion(Quaternion::new(real, w.x * scale, w.y * scale, w.z * scale)))
    }

    /// The rotation vector (radians), of norm at most pi.
    pub fn log(&self) -> Vec3 {
        let q = if self.0.w < 0.0 { -self.0.into_inner() } else { self.0.into_inner() };
        let v = Vec3::new(q.i, q.j, q.k);
        let sin_half = v.norm();
        if sin_half < 1e-8 { v * 2.0 } else { v * (2.0 * sin_half.atan2(q.w) / sin_half) }
    }

    /// The inverse rotation.
    #[inline]
    pub fn inverse(&self) -> Self {
        Self(self.0.inverse())
    }

    /// The angle of rotation in radians, 0 to pi.
    pub fn angle(&self) -> f64 {
        self.log().norm()
    }

    /// Spherical interpolation: `self` at `t = 0`, `other` at `t = 1`.
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        *self * Self::exp(&((self.inverse() * *other).log() * t))
    }

    /// Right Jacobian (Solà et al. eq. 143): `exp(w + d) ~ exp(w) * exp(right_jacobian(w) * d)`.
    pub fn right_jacobian(w: &Vec3) -> Mat3 {
        let a2 = w.norm_squared();
        let h = hat(w);
        if a2 < 1e-8 {
            return Mat3::identity() - h * 0.5 + h * h / 6.0;
        }
        let a = a2.sqrt();
        Mat3::identity() - h * ((1.0 - a.cos()) / a2) + h * h * ((a - a.sin()) / (a2 * a))
    }

    /// Inverse of the right Jacobian (Solà et al. eq. 144).
    pub fn right_jacobian_inverse(w: &Vec3) -> Mat3 {
        let a2 = w.norm_squared();
        let h = hat(w);
        if a2 < 1e-8 {
            return Mat3::identity() + h * 0.5 + h * h / 12.0;
        }
        let a = a2.sqrt();
        Mat3::identity() + h * 0.5 + h * h * (1.0 / a2 - (1.0 + a.cos()) / (2.0 * a * a.sin()))
    }

    /// Left Jacobian: the right Jacobian of `-w`.
    pub fn left_jacobian(w: &Vec3) -> Mat3 {
        Self::right_jacobian(&-w)
    }

    /// Inverse of the left Jacobian.
    pub fn left_jacobian_inverse(w: &Vec3) -> Mat3 {
        Self::right_jacobian_inverse(&-w)
    }
}

impl Mul for So3 {
    type Output = So3;
    #[inline]
    fn mul(self, rhs: So3) -> So3 {
        So3(UnitQuaternion::new_normalize((self.0 * rhs.0).into_inner()))
    }
}

impl Mul<Vec3> for So3 {
    type Output = Vec3;
    #[inline]
    fn mul(self, rhs: Vec3) -> Vec3 {
        self.0 * rhs
    }
}

impl Manifold<3> for So3 {
    fn retract(&self, delta: &Vec3) -> Self {
        *self * Self::exp(delta)
    }
    fn local(&self, other: &Self) -> Vec3 {
        (self.inverse() * *other).log()
    }
}
