//! What a page says of its phone before the first image.

use cairn_sensor::{Camera, Distortion, ImuSensor, Rig};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A phone and how it is used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Width of the images, pixels.
    pub width: usize,
    /// Height of the images, pixels.
    pub height: usize,
    /// Images per second.
    pub rate_hz: f64,
    /// Focal lengths and centre (fx, fy, cx, cy), pixels; guessed where nobody knows them.
    #[serde(default)]
    pub pinhole: Option<[f64; 4]>,
    /// Radial and tangential distortion (k1, k2, p1, p2, k3).
    #[serde(default)]
    pub distortion: Option<[f64; 5]>,
    /// Whether the page delivers motion, in the axes of its images.
    #[serde(default)]
    pub motion: bool,
    /// Where routes and maps are kept.
    pub folder: PathBuf,
    /// The language of what is said, `en`, `de` or `es`; English where nothing is said.
    #[serde(default)]
    pub language: Option<String>,
}

impl Setup {
    /// The sensors.
    pub fn rig(&self) -> Rig {
        let mut camera = Camera::guessed(self.width, self.height);
        if let Some([fx, fy, cx, cy]) = self.pinhole {
            camera = Camera::pinhole(self.width, self.height, fx, fy, cx, cy);
        }
        if let Some(k) = self.distortion {
            camera.distortion = Distortion::RadialTangential(k);
        }
        Rig { imu: self.motion.then(ImuSensor::of_phone), ..Rig::mono(camera) }
    }
}
