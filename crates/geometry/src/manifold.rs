//! The contract every optimised quantity keeps.

use nalgebra::SVector;

/// A point on a smooth manifold of `D` dimensions.
///
/// The contract: `x.retract(&x.local(&y)) == y`, `x.local(&x.retract(&d)) == d` for small `d`,
/// and `x.retract(&zero) == x`.
pub trait Manifold<const D: usize>: Sized {
    /// Moves along the tangent vector `delta` at `self`.
    fn retract(&self, delta: &SVector<f64, D>) -> Self;
    /// The tangent vector at `self` that leads to `other`.
    fn local(&self, other: &Self) -> SVector<f64, D>;
}
