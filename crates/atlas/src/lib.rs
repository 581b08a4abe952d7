#![doc = include_str!("../README.md")]
//!
//! A [`Snapshot`] is a value: cloning it is cheap, and whoever holds one is never disturbed. The only way to
//! change a map is to apply a [`ChangeSet`].

mod apply;
mod arena;
mod atlas;
mod beside;
mod change;
mod ids;
mod inertial;
mod key_frame;
mod landmark;
mod map;
mod mirror;
mod places;
mod rebase;
mod snapshot;
pub mod store;
mod stream;

pub use atlas::{Atlas, Reader};
pub use beside::Shift;
pub use change::{Applied, Change, ChangeSet};
pub use ids::{KeyFrameId, LandmarkId};
pub use inertial::{ImuFactor, ImuSegment, InertialState};
pub use key_frame::KeyFrame;
pub use landmark::{Landmark, Observation};
pub use map::{MapId, MapPrior};
pub use mirror::{Mirror, Mirrored};
pub use places::PlaceIndex;
pub use snapshot::Snapshot;
pub use stream::{Published, Removed, Subscription};
