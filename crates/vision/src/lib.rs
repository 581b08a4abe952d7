//! From pixels to features with depth, and from matched features to geometry.

mod frame;
pub mod orb;

pub use frame::{Descriptor, EyeModel, Frame, Octaves};
pub use orb::{BestTwo, Features, OrbExtractor, OrbSetting, Pyramid, best_two, best_two_of, hamming};
