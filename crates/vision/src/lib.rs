#![doc = include_str!("../README.md")]
// `!(a > b)` is meant: it also refuses NaN.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod alike;
pub mod bow;
mod depth;
mod eye;
mod frame;
pub mod orb;
mod p3p;
mod pnp;
mod rectify;
mod roots;
mod search;
mod stereo;
mod triangulate;
mod two_view;

pub use alike::{Look, match_looks};
pub use depth::DepthSetting;
pub use eye::{Eye, EyeSetting, SeeError, SensorMode};
pub use frame::{Descriptor, EyeModel, Frame, Octaves};
pub use orb::{BestTwo, Features, OrbExtractor, OrbSetting, Pyramid, best_two, best_two_of, hamming};
pub use p3p::p3p;
pub use pnp::{PnpRejected, PnpResult, PnpSetting, pnp_ransac};
pub use rectify::{RectifiedPair, Rectifier, rectify_pair};
pub use search::{Found, Target, consistent_rotation, search};
pub use stereo::StereoSetting;
pub use triangulate::{
    NotTriangulated, TriangulateGate, Triangulated, correct, essential, midpoint, triangulate_checked,
    triangulate_views,
};
pub use two_view::{
    TwoView, TwoViewModel, TwoViewReason, TwoViewRejected, TwoViewSetting, Verified, essential_motions,
    five_point, four_point, homography_motions, two_view, verify_two_views,
};
