#![doc = include_str!("../README.md")]
// `!(a > b)` is intended: it also rejects NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod bow;
mod depth;
mod frame;
mod front_end;
mod matching;
pub mod orb;
mod p3p;
mod parallel;
mod pnp;
mod rectify;
mod registration;
mod roots;
mod search;
mod stereo;
mod triangulate;
mod two_view;

pub use depth::DepthConfig;
pub use frame::{Descriptor, Frame, Octaves, RectifiedCamera, Rolling};
pub use front_end::{FrontEnd, FrontEndConfig, FrontEndError, SensorMode};
pub use matching::{DescriptorQuery, match_descriptors};
pub use orb::{
    BestTwo, DESCRIPTOR_ID, Features, OrbConfig, OrbExtractor, Pyramid, best_two, best_two_of, hamming,
};
pub use p3p::p3p;
pub use pnp::{PnpConfig, PnpRejected, PnpResult, pnp_ransac};
pub use rectify::{RectifiedPair, Rectifier, rectify_pair};
pub use registration::{Misregistration, RegistrationCheck};
pub use search::{Found, Target, consistent_rotation, search};
pub use stereo::StereoConfig;
pub use triangulate::{correct, essential, midpoint, triangulate_views};
pub use two_view::{
    TwoView, TwoViewConfig, TwoViewModel, TwoViewReason, TwoViewRejected, Verified, essential_motions,
    five_point, four_point, homography_motions, two_view, verify_two_views,
};
