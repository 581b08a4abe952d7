//! The camera of key frames that were not made with that of their atlas (see `cameras.rs`).

use cairn_vision::{RectifiedCamera, SensorMode};

/// A camera that is not that of the atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherCamera {
    /// What depth comes from.
    pub sensor: SensorMode,
    /// The camera.
    pub camera: RectifiedCamera,
    /// Its focal length over that of the atlas's camera.
    pub focal_ratio: f64,
}
