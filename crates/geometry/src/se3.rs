//! Rigid transforms in three dimensions.
//!
//! Source: Solà et al. (2018), appendix D; the tangent vector is (translation, rotation).

use crate::{LieGroup, Manifold, Mat3, So3, Vec3, hat};
use nalgebra::{Matrix4, Matrix6, SVector, Vector6};
use std::ops::Mul;

/// A rigid transform `a_from_b`: `p_a = rotation * p_b + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// Rotation part.
    pub rotation: So3,
    /// Translation part in metres (the origin of `b` in `a`).
    pub translation: Vec3,
}

impl Default for Se3 {
    fn default() -> Self {
        Self::identity()
    }
}

impl Se3 {
    /// From rotation and translation.
    pub fn new(rotation: So3, translation: Vec3) -> Self {
        Self { rotation, translation }
    }

    /// The identity transform.
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
    #[inline]
    pub fn matrix(&self) -> Matrix4<f64> {
        let mut m = Matrix4::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation.matrix());
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }

    /// The inverse transform, `b_from_a`.
    #[inline]
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
    #[inline]
    fn mul(self, rhs: Se3) -> Se3 {
        Se3::new(self.rotation * rhs.rotation, self.translation + self.rotation * rhs.translation)
    }
}

impl Mul<Vec3> for Se3 {
    type Output = Vec3;
    #[inline]
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

impl LieGroup<6> for Se3 {
    fn identity() -> Self {
        Self::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        *self * *other
    }
    fn inverse(&self) -> Self {
        self.inverse()
    }
    fn adjoint(&self) -> Matrix6<f64> {
        self.adjoint()
    }
    fn coordinates(&self) -> Vector6<f64> {
        let (w, t) = (self.rotation.log(), &self.translation);
        let wt = w.cross(t);
        let v = t - wt * 0.5 + w.cross(&wt) * left_jacobian_inverse_coefficient(w.norm_squared()).0;
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }
    /// The inverse of the right Jacobian. The block that couples translation and rotation follows from differentiating
    /// `inverse(left_jacobian(w)) * t` with respect to `w`.
    fn coordinates_jacobian(&self) -> Matrix6<f64> {
        let (w, t) = (self.rotation.log(), &self.translation);
        let (c, slope) = left_jacobian_inverse_coefficient(w.norm_squared());
        let h = hat(&w);
        let rotation_block = Mat3::identity() + h * 0.5 + h * h * c;
        let by_w = hat(t) * 0.5
            + (Mat3::from_diagonal_element(w.dot(t)) + w * t.transpose() - t * w.transpose() * 2.0) * c
            + (h * (h * t)) * w.transpose() * slope;
        upper_triangular(&rotation_block, &(by_w * rotation_block), &rotation_block)
    }
    fn chordal(&self) -> Vector6<f64> {
        let (q, t) = (positive_quaternion(&self.rotation), &self.translation);
        Vector6::new(t.x, t.y, t.z, 2.0 * q.1.x, 2.0 * q.1.y, 2.0 * q.1.z)
    }
    fn chordal_jacobian(&self) -> Matrix6<f64> {
        upper_triangular(&self.rotation.matrix(), &Mat3::zeros(), &chord_jacobian(&self.rotation))
    }
    fn is_finite(&self) -> bool {
        self.is_finite()
    }
}

/// The coefficient `c` in `inverse(left_jacobian(w)) = I - hat(w) / 2 + c hat(w)^2`, and `dc / d(angle) / angle`, as
/// functions of the squared angle.
pub(crate) fn left_jacobian_inverse_coefficient(angle2: f64) -> (f64, f64) {
    if angle2 < 1e-4 {
        // Error below 1e-17 for both.
        let c = 1.0 / 12.0 + angle2 * (1.0 / 720.0 + angle2 * (1.0 / 30240.0 + angle2 / 1209600.0));
        return (c, 1.0 / 360.0 + angle2 * (1.0 / 7560.0 + angle2 / 201600.0));
    }
    let angle = angle2.sqrt();
    let (sin, cos) = (0.5 * angle).sin_cos();
    let (cot, rest) = (cos / sin, 1.0 - 0.5 * angle * cos / sin);
    let by_angle = 0.5 * (cot - 0.5 * angle / (sin * sin));
    (rest / angle2, -(by_angle / angle + 2.0 * rest / angle2) / angle2)
}

/// Real and vector part of the quaternion, with the sign that makes the real part non-negative.
pub(crate) fn positive_quaternion(r: &So3) -> (f64, Vec3) {
    let q = r.quaternion();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    (sign * q.w, Vec3::new(q.i, q.j, q.k) * sign)
}

/// Derivative of twice the quaternion's vector part with respect to a rotation perturbation on the right.
pub(crate) fn chord_jacobian(r: &So3) -> Mat3 {
    let (w, v) = positive_quaternion(r);
    Mat3::from_diagonal_element(w) + hat(&v)
}

/// The block upper triangular matrix `[a b; 0 d]`.
fn upper_triangular(a: &Mat3, b: &Mat3, d: &Mat3) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(b);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(d);
    m
}
