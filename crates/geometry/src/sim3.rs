//! Similarity transforms: rotation, translation and scale.
//!
//! The tangent vector is (translation, rotation, logarithm of scale). Exponential and logarithm after Strasdat, "Local
//! accuracy and global consistency for efficient visual SLAM" (2012), section 2.4; their matrix `W` is an integral
//! along the screw motion and is evaluated by quadrature, which has no special cases (see [`Screw`]).

use crate::se3::{chord_jacobian, positive_quaternion};
use crate::{LieGroup, Manifold, Mat3, Se3, So3, Vec3, hat};
use nalgebra::{SMatrix, SVector};
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
    /// From rotation, translation and scale.
    pub fn new(rotation: So3, translation: Vec3, scale: f64) -> Self {
        Self { rotation, translation, scale }
    }

    /// The identity similarity.
    pub fn identity() -> Self {
        Self::new(So3::identity(), Vec3::zeros(), 1.0)
    }

    /// True when every number is finite and the scale is positive.
    pub fn is_finite(&self) -> bool {
        Se3::new(self.rotation, self.translation).is_finite() && self.scale.is_finite() && self.scale > 0.0
    }

    /// The inverse similarity.
    pub fn inverse(&self) -> Self {
        let r = self.rotation.inverse();
        Self::new(r, -(r * self.translation) / self.scale, 1.0 / self.scale)
    }

    /// Transforms a pose: `a_from_c` from `b_from_c`; lengths are scaled, the rotation remains a rotation.
    pub fn transform_pose(&self, b_from_c: &Se3) -> Se3 {
        Se3::new(self.rotation * b_from_c.rotation, *self * b_from_c.translation)
    }
}

impl Sim3 {
    /// Exponential of (translation, rotation, logarithm of scale).
    pub fn exp(d: &SVector<f64, 7>) -> Self {
        let (v, w, log_scale) = parts(d);
        let screw = Screw::new(w.norm(), log_scale);
        Self::new(So3::exp(&w), screw.matrix(&w) * v, log_scale.exp())
    }

    /// The adjoint: `self * exp(d) == exp(adjoint * d) * self`.
    pub fn adjoint(&self) -> SMatrix<f64, 7, 7> {
        let (r, t) = (self.rotation.matrix(), &self.translation);
        let mut a = SMatrix::<f64, 7, 7>::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&(r * self.scale));
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&(hat(t) * r));
        a.fixed_view_mut::<3, 1>(0, 6).copy_from(&-t);
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        a[(6, 6)] = 1.0;
        a
    }

    /// The terms of the logarithm: rotation vector, coefficients of `W`, and the inverse of `W`.
    fn screw(&self) -> (Vec3, Screw, Mat3) {
        let w = self.rotation.log();
        let screw = Screw::new(w.norm(), self.scale.ln());
        // The integral of scaled rotations over at most 180 degrees is not singular.
        let inverse = screw.matrix(&w).try_inverse().unwrap_or_else(Mat3::identity);
        (w, screw, inverse)
    }
}

/// Splits a tangent vector into translation, rotation vector and logarithm of scale.
fn parts(d: &SVector<f64, 7>) -> (Vec3, Vec3, f64) {
    (d.fixed_rows::<3>(0).into(), d.fixed_rows::<3>(3).into(), d[6])
}

/// Joins translation, rotation vector and logarithm of scale into a tangent vector.
fn joined(v: &Vec3, w: &Vec3, log_scale: f64) -> SVector<f64, 7> {
    SVector::<f64, 7>::from([v.x, v.y, v.z, w.x, w.y, w.z, log_scale])
}

/// Coefficients of `W = integral over u in 0..1 of exp(s u) exp(hat(w) u) = c I + a hat(w) + b hat(w)^2`, with the
/// derivatives of `a`, `b`, `c` with respect to `s`, and of `a` and `b` with respect to the angle, divided by the
/// angle.
struct Screw {
    a: f64,
    b: f64,
    c: f64,
    by_scale: [f64; 3],
    by_angle: [f64; 2],
}

/// Nodes in 0..1 and weights of ten-point Gauss-Legendre quadrature: the first half, the second half is symmetric.
const NODES: [[f64; 2]; 5] = [
    [0.013046735741414128, 0.03333567215434407],
    [0.06746831665550773, 0.07472567457529028],
    [0.16029521585048778, 0.10954318125799103],
    [0.2833023029353764, 0.13463335965499817],
    [0.4255628305091844, 0.14776211235737643],
];

impl Screw {
    /// By quadrature: exact up to rounding for angles up to pi and scales between 1/20 and 20.
    fn new(angle: f64, log_scale: f64) -> Self {
        let mut sum = Self { a: 0.0, b: 0.0, c: 0.0, by_scale: [0.0; 3], by_angle: [0.0; 2] };
        for [node, weight] in NODES {
            for u in [node, 1.0 - node] {
                let x = angle * u;
                let (sinc, half, slope_a, slope_b) = sinc_terms(x);
                let f = weight * (log_scale * u).exp();
                let abc = [f * u * sinc, f * u * u * half, f];
                sum.a += abc[0];
                sum.b += abc[1];
                sum.c += abc[2];
                for k in 0..3 {
                    sum.by_scale[k] += u * abc[k];
                }
                sum.by_angle[0] += f * u.powi(3) * slope_a;
                sum.by_angle[1] += f * u.powi(4) * slope_b;
            }
        }
        sum
    }

    /// The matrix `W`.
    fn matrix(&self, w: &Vec3) -> Mat3 {
        let h = hat(w);
        Mat3::from_diagonal_element(self.c) + h * self.a + h * h * self.b
    }

    /// Derivatives of `W v` with respect to `w` and to the logarithm of scale.
    fn derivatives(&self, w: &Vec3, v: &Vec3) -> (Mat3, Vec3) {
        let (wv, [a, b, c]) = (w.cross(v), self.by_scale);
        let wwv = w.cross(&wv);
        let by_w = hat(v) * -self.a
            + (Mat3::from_diagonal_element(w.dot(v)) + w * v.transpose() - v * w.transpose() * 2.0) * self.b
            + (wv * self.by_angle[0] + wwv * self.by_angle[1]) * w.transpose();
        (by_w, wv * a + wwv * b + v * c)
    }
}

/// `sin x / x`, `(1 - cos x) / x^2`, and the derivative of each with respect to `x`, divided by `x`.
fn sinc_terms(x: f64) -> (f64, f64, f64, f64) {
    let x2 = x * x;
    if x < 0.3 {
        // Taylor series, error below 1e-16.
        let series =
            |first: f64, n: [f64; 6]| n.iter().rev().fold(0.0, |sum, divisor| first / divisor - x2 * sum);
        return (
            series(1.0, [1.0, 6.0, 120.0, 5040.0, 362880.0, 39916800.0]),
            series(1.0, [2.0, 24.0, 720.0, 40320.0, 3628800.0, 479001600.0]),
            series(-1.0, [3.0, 30.0, 840.0, 45360.0, 3991680.0, 518918400.0]),
            series(-1.0, [12.0, 180.0, 6720.0, 453600.0, 47900160.0, 7264857600.0]),
        );
    }
    let (sin, cos) = x.sin_cos();
    (sin / x, (1.0 - cos) / x2, (x * cos - sin) / (x2 * x), (x * sin - 2.0 * (1.0 - cos)) / (x2 * x2))
}

impl Manifold<7> for Sim3 {
    fn retract(&self, delta: &SVector<f64, 7>) -> Self {
        *self * Self::exp(delta)
    }
    fn local(&self, other: &Self) -> SVector<f64, 7> {
        (self.inverse() * *other).coordinates()
    }
}

impl LieGroup<7> for Sim3 {
    fn identity() -> Self {
        Self::identity()
    }
    fn compose(&self, other: &Self) -> Self {
        *self * *other
    }
    fn inverse(&self) -> Self {
        self.inverse()
    }
    fn adjoint(&self) -> SMatrix<f64, 7, 7> {
        self.adjoint()
    }
    fn coordinates(&self) -> SVector<f64, 7> {
        let (w, _, inverse) = self.screw();
        joined(&(inverse * self.translation), &w, self.scale.ln())
    }
    fn coordinates_jacobian(&self) -> SMatrix<f64, 7, 7> {
        let (w, screw, inverse) = self.screw();
        let (by_w, by_scale) = screw.derivatives(&w, &(inverse * self.translation));
        let rotation_block = So3::right_jacobian_inverse(&w);
        let mut j = SMatrix::<f64, 7, 7>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(inverse * self.rotation.matrix() * self.scale));
        j.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(inverse * by_w * rotation_block));
        j.fixed_view_mut::<3, 1>(0, 6).copy_from(&-(inverse * by_scale));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation_block);
        j[(6, 6)] = 1.0;
        j
    }
    fn chordal(&self) -> SVector<f64, 7> {
        joined(&self.translation, &(positive_quaternion(&self.rotation).1 * 2.0), self.scale.ln())
    }
    fn chordal_jacobian(&self) -> SMatrix<f64, 7, 7> {
        let mut j = SMatrix::<f64, 7, 7>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(self.rotation.matrix() * self.scale));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&chord_jacobian(&self.rotation));
        j[(6, 6)] = 1.0;
        j
    }
    fn is_finite(&self) -> bool {
        self.is_finite()
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
