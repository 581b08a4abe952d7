//! How SLAM is begun for the session's camera, at its start and again where its lens becomes known.

use crate::config::{SlamSetup, StartSlam, StartedSlam};
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, SensorMode};
use cairn_sensor::Rig;
use cairn_session::{LibraryCamera, LibraryError};

/// What SLAM is begun with.
pub(crate) struct Start {
    pub begin: StartSlam,
    pub name: String,
    pub rig: Rig,
    pub mode: SensorMode,
    pub has_imu: bool,
    pub rate_hz: f64,
    pub config: Config,
    pub dense: bool,
}

impl Start {
    /// Its camera, for a folder of routes.
    ///
    /// # Errors
    /// When the rig cannot serve the mode.
    pub fn camera(&self, is_calibrated: bool) -> Result<LibraryCamera, LibraryError> {
        Ok(LibraryCamera::of(&self.rig, self.mode, &self.config, is_calibrated)?)
    }

    /// Begins it, in a map where there is one.
    pub fn slam(&mut self, map: Option<&MapFile>) -> StartedSlam {
        let with = SlamSetup {
            name: &self.name,
            rig: &self.rig,
            mode: self.mode,
            imu: self.has_imu,
            rate_hz: self.rate_hz,
            config: &self.config,
            dense: self.dense,
        };
        (self.begin)(&with, map)
    }
}
