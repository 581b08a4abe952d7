#![doc = include_str!("../README.md")]
//!
//! Nonlinear least squares for cameras and points: reprojection residuals with analytic Jacobians,
//! robust losses, pose-only adjustment, bundle adjustment by the Schur complement, and graphs of poses on a
//! block-sparse Cholesky factorisation.
//!
//! Every problem is solved by one Levenberg-Marquardt loop ([`LevenbergMarquardt`]); a problem is a trait
//! ([`Problem`]), so that small ones live on the stack ([`minimise_dense`]) and large ones in sparse blocks. Solvers are
//! pure: they take a copied problem, change the copy, and return a [`Report`].

pub mod bal;
mod bundle;
mod chow_test;
mod clique;
mod dense;
mod factors;
pub mod g2o;
pub mod graph;
mod levenberg_marquardt;
mod matched_points;
mod pose_only;
pub mod ransac;
mod report;
mod reprojection;
mod robust;
mod schur;
mod slices;
pub mod sparse;
mod text;

pub use bundle::{Bundle, BundleConfig, Calibration, Freedom, Moves, Observation};
pub use chow_test::chow_test;
pub use clique::{Clique, maximum_clique};
pub use dense::{DenseNormal, minimise_dense};
pub use factors::{Equations, Factors, NoFactors, Variable};
pub use levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt, Outcome, Problem, Trial};
pub use matched_points::PointMatch;
pub use pose_only::{PoseOnly, PoseOnlyConfig, PosePrior};
pub use report::{Report, Stop};
pub use reprojection::{Linear, Pinhole, Pixel};
pub use robust::{CHI2_2, CHI2_3, CHI2_95, Loss, huber};
pub use slices::{pause, to_end};
pub use text::TextError;
