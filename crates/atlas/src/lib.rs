#![doc = include_str!("../README.md")]
//!
//! A [`Snapshot`] is a value: cloning it is cheap, and it never changes while it is held. The only way to
//! change a map is to apply a [`ChangeSet`], which gives the next snapshot.

mod apply;
mod arena;
mod atlas;
mod cameras;
mod change;
mod combine;
mod covisible;
mod cut;
mod ids;
mod in_view;
mod inertial;
mod key_frame;
mod landmark;
mod made_by;
mod map;
mod mirror;
mod named;
mod names;
mod other_camera;
mod own;
mod paged;
mod paging;
mod places;
mod rebase;
mod record;
mod relative_pose;
mod scale;
mod similar;
mod snapshot;
pub mod store;
mod stream;

pub use atlas::{Atlas, Reader};
pub use change::{Applied, Change, ChangeSet};
pub use combine::{CombineError, Shift};
pub use ids::{KeyFrameId, LandmarkId};
pub use in_view::{Sighting, Viewpoint};
pub use inertial::{ImuFactor, ImuSegment, InertialState};
pub use key_frame::KeyFrame;
pub use landmark::{Landmark, Observation};
pub use map::{MapId, MapPrior};
pub use mirror::{Mirror, Mirrored};
pub use names::{KeyFrameName, LandmarkName, RobotId};
pub use other_camera::OtherCamera;
pub use paged::{Paged, ReadBackError};
pub use places::PlaceIndex;
pub use relative_pose::RelativePose;
pub use scale::{DEPTH_SCALE_SIGMA, INERTIAL_SCALE_SIGMA, MapScale, RELATED_SCALE_SIGMA};
pub use snapshot::{Readout, Snapshot, Unsound};
pub use stream::{Feed, Published, Removed, Subscription};
