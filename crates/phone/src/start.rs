//! How the engine of a walk is begun: at its start, and again once the lens of its phone is known.

use crate::setup::Setup;
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, FlowClocks, Host, OpenMapError, Runner, SensorMode};
use cairn_sensor::{Rig, RigError};
use cairn_session::LibraryCamera;
use cairn_session::lens_watch::{LensWatch, kept};

/// What the engine is begun with.
pub(crate) struct Start {
    rig: Rig,
    rate_hz: f64,
    config: Config,
}

impl Start {
    /// For a setup; and who watches for its lens, where nobody gives one.
    pub fn of(setup: &Setup) -> (Self, Option<LensWatch>) {
        let mut config = Config::default();
        config.inertial.enabled = setup.motion;
        if setup.motion {
            config.expect_phone(setup.pinhole.is_some());
        }
        let mut start = Self { rig: setup.rig(), rate_hz: setup.rate_hz, config };
        let watch = setup.phone.as_ref().filter(|_| setup.pinhole.is_none()).map(|phone| {
            let (folder, guess) = (&setup.library.folder, start.rig.cameras[0].camera);
            LensWatch::new(Some(folder.clone()), phone.clone(), guess, kept(folder, phone, &guess))
        });
        watch.iter().for_each(|watch| start.reads_with(watch, None));
        (start, watch)
    }

    /// Images are read with the lens of this watch from the next begin on, and motion with these clocks, where they are known.
    pub fn reads_with(&mut self, watch: &LensWatch, clocks: Option<FlowClocks>) {
        self.rig.cameras[0].camera = watch.camera();
        self.config.tracker.clocks = clocks;
    }

    /// The sensors.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Its camera, for a folder of routes.
    ///
    /// # Errors
    /// When the rig cannot be used.
    pub fn camera(&self, is_calibrated: bool) -> Result<LibraryCamera, RigError> {
        LibraryCamera::of(&self.rig, SensorMode::Mono, &self.config, is_calibrated)
    }

    /// Begins it, in a map where there is one; with what the user should know of the map.
    ///
    /// # Errors
    /// When the rig or the map cannot be used.
    pub fn engine(&self, map: Option<&MapFile>) -> Result<(Engine, Vec<String>), OpenMapError> {
        let (rig, mode, host, runner) = (&self.rig, SensorMode::Mono, Host::bare(), Runner::Sliced);
        match map {
            Some(file) => Engine::in_map(rig, mode, self.rate_hz, runner, &self.config, &host, file),
            None => Ok((Engine::new(rig, mode, self.rate_hz, runner, &self.config, &host)?, Vec::new())),
        }
    }
}
