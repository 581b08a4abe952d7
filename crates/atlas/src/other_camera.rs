//! The camera of key frames that were not made with that of their atlas (see `cameras.rs`).

use cairn_geometry::Se3;
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
    /// Its pose on the IMU of its IMU factors, metres, while maps are joined; `None` where there is none, it is not known, or the map is
    /// read from a file.
    pub imu_from_camera: Option<Se3>,
}
