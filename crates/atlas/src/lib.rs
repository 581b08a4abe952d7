#![doc = include_str!("../README.md")]
//!
//! A [`Map`] is a value: cloning it is cheap, and whoever holds one is never disturbed. The only way to
//! change a map is to apply a [`ChangeSet`].

mod apply;
mod arena;
mod atlas;
mod beside;
mod change;
mod ids;
mod key_frame;
mod landmark;
mod map;
mod mirror;
mod motion;
mod places;
mod rebase;
pub mod store;
mod stream;
mod world;

pub use atlas::{Atlas, Reader};
pub use beside::Shift;
pub use change::{Applied, Change, ChangeSet};
pub use ids::{KeyFrameId, LandmarkId};
pub use key_frame::KeyFrame;
pub use landmark::{Landmark, Observation};
pub use map::Map;
pub use mirror::{Mirror, Mirrored};
pub use motion::{Felt, Motion, Sensed};
pub use places::PlaceIndex;
pub use stream::{Published, Removed, Subscription};
pub use world::{Tie, WorldId};
