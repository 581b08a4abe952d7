//! The manifold trait that every optimised quantity implements.

use nalgebra::SVector;

/// A point on a smooth manifold of `D` dimensions.
///
/// Implementations must satisfy `x.retract(&x.local(&y)) == y`, `x.local(&x.retract(&d)) == d` for small `d`,
/// and `x.retract(&zero) == x`.
pub trait Manifold<const D: usize>: Sized {
    /// Moves along the tangent vector `delta` at `self`.
    fn retract(&self, delta: &SVector<f64, D>) -> Self;
    /// The tangent vector at `self` such that `self.retract(delta)` is `other`.
    fn local(&self, other: &Self) -> SVector<f64, D>;
}
