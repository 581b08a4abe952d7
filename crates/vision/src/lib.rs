//! From pixels to features with depth, and from matched features to geometry.

mod depth;
mod eye;
mod frame;
pub mod orb;
mod rectify;
mod search;
mod stereo;

pub use depth::DepthSetting;
pub use eye::{Eye, EyeSetting, SeeError, SensorMode};
pub use frame::{Descriptor, EyeModel, Frame, Octaves};
pub use orb::{BestTwo, Features, OrbExtractor, OrbSetting, Pyramid, best_two, best_two_of, hamming};
pub use rectify::{RectifiedPair, Rectifier, rectify_pair};
pub use search::{Found, Target, consistent_rotation, search};
pub use stereo::StereoSetting;
