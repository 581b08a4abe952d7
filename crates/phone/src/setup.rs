//! What a page says of its phone before the first image.

use cairn_guide::PhraseConfig;
use cairn_phrases::{Language, UnknownLanguage};
use cairn_sensor::{Camera, Distortion, ImuSensor, Rig};
use cairn_session::{RouteListed, WallClock, WallTime, routes_in};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

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
    /// Which phone it is: its lens, where nobody gives one, is learned and kept by this name; by none it stays a guess.
    #[serde(default)]
    pub phone: Option<String>,
    /// Where routes and maps are kept, and how is spoken of them.
    pub library: Library,
}

/// A folder of routes and maps, and how is spoken of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Library {
    /// The folder.
    pub folder: PathBuf,
    /// The language, `en`, `de` or `es`; English where nothing is said.
    #[serde(default)]
    pub language: Option<String>,
    /// Minutes that the walker's local time is ahead of UTC.
    #[serde(default)]
    pub zone_min: i16,
}

impl Library {
    /// How is spoken.
    ///
    /// # Errors
    /// A language that is not there.
    pub fn phrases(&self) -> Result<PhraseConfig, UnknownLanguage> {
        let language = self.language.as_deref().map_or(Ok(Language::default()), str::parse)?;
        Ok(PhraseConfig { language, ..PhraseConfig::default() })
    }

    /// The time of day where the walker is.
    pub fn clock(&self) -> WallClock {
        // No place on Earth is farther from UTC than fourteen hours.
        let offset_s = 60 * i32::from(self.zone_min).clamp(-14 * 60, 14 * 60);
        Arc::new(move || WallTime { offset_s, ..WallTime::now() })
    }

    /// The routes in it, newest first.
    ///
    /// # Errors
    /// A language that is not there.
    pub fn routes(&self) -> Result<Vec<RouteListed>, UnknownLanguage> {
        Ok(routes_in(&self.folder, self.clock()(), &self.phrases()?))
    }
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
