//! The Lie group trait of the pose types, as needed for estimation from relative measurements (pose graphs).
//!
//! The coordinates of an element are `identity.local(element)`. Their derivative and the adjoint are what the
//! residual of a relative measurement needs in any group (Solà, Deray, Atchuthan 2018, section II).

use crate::Manifold;
use nalgebra::{SMatrix, SVector};

/// A group of transforms with `D` degrees of freedom; `a.compose(b)` is `a_from_c` for `a_from_b` and `b_from_c`.
pub trait LieGroup<const D: usize>: Manifold<D> + Copy {
    /// The identity element.
    fn identity() -> Self;

    /// The product `self * other`: applies `other` first.
    fn compose(&self, other: &Self) -> Self;

    /// The inverse element.
    fn inverse(&self) -> Self;

    /// The adjoint at the identity: `self * exp(d) == exp(adjoint * d) * self` to first order in `d`.
    fn adjoint(&self) -> SMatrix<f64, D, D>;

    /// The coordinates `identity.local(self)`: a residual that is zero at the identity.
    fn coordinates(&self) -> SVector<f64, D>;

    /// Derivative of the coordinates of `self.retract(d)` with respect to `d`, at `d = 0`.
    fn coordinates_jacobian(&self) -> SMatrix<f64, D, D>;

    /// The chordal residual: translation, then `2 sin(angle / 2)` times the axis of rotation, then the rest.
    ///
    /// The squared norm of its rotation part is half the squared Frobenius norm of `rotation - identity` (Hartley et
    /// al., "Rotation averaging", 2013, section 4), so that its least-squares cost is that of SE-Sync.
    fn chordal(&self) -> SVector<f64, D>;

    /// Derivative of the chordal residual of `self.retract(d)` with respect to `d`, at `d = 0`.
    fn chordal_jacobian(&self) -> SMatrix<f64, D, D>;

    /// True when every number is finite.
    fn is_finite(&self) -> bool;
}
