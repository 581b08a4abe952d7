//! From pixels to features with depth, and from matched features to geometry.

mod frame;

pub use frame::{Descriptor, EyeModel, Frame, Octaves};
