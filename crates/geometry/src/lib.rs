#![doc = include_str!("../README.md")]
//!
//! Conventions: a transform is named `a_from_b` and maps coordinates in `b` to coordinates in `a`;
//! rotations are unit quaternions, lengths are metres, angles radians, all in `f64`. Perturbations
//! are applied on the right, `x.retract(d) = x * exp(d)`, with translation before rotation in `d`.

mod align;
mod group;
mod manifold;
mod pose;
mod se2;
mod se3;
mod sim3;
mod so2;
mod so3;
mod trajectory;
mod yaw;

pub use align::{Degenerate, umeyama};
pub use group::LieGroup;
pub use manifold::Manifold;
pub use pose::{Body, Camera, Odom, Pose, Similarity, World};
pub use se2::Se2;
pub use se3::Se3;
pub use sim3::Sim3;
pub use so2::So2;
pub use so3::{So3, hat};
pub use trajectory::{Trajectory, TrajectoryError, associate};
pub use yaw::YawPose;

/// A three-vector of `f64`.
pub type Vec3 = nalgebra::Vector3<f64>;
/// A two-vector of `f64`.
pub type Vec2 = nalgebra::Vector2<f64>;
/// A 3x3 matrix of `f64`.
pub type Mat3 = nalgebra::Matrix3<f64>;
