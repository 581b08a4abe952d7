//! Starting an engine in a saved map, and saving its map.

use crate::{Config, Engine, Runner, SensorMode};
use cairn_atlas::store::{About, MapFile};
use cairn_sensor::{Rig, RigError};
use cairn_vision::FrontEnd;
use std::collections::BTreeMap;

/// Why an engine cannot use a saved map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OpenMapError {
    /// The rig cannot serve the mode.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The map was made with another camera or other sensors; described with the numbers of both.
    #[error("{0}")]
    Camera(String),
}

impl Engine {
    /// An engine in a saved map. Tracking starts lost: there is no pose until a place is recognised. Also
    /// returns a description of small differences between the camera of the map and this one.
    ///
    /// # Errors
    ///
    /// [`OpenMapError`] when the rig cannot serve the mode, or the map was made with another camera or other
    /// sensors.
    pub fn in_map(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
        file: &MapFile,
    ) -> Result<(Self, Vec<String>), OpenMapError> {
        let front_end = FrontEnd::new(rig, mode, config.front_end_for(rig))?;
        if file.snapshot.other_cameras().next().is_some() {
            return Self::among_other_cameras(front_end, file, rig, mode, rate_hz, runner, config);
        }
        let file = file.with_depth_weighed_for(front_end.model());
        let notes = file
            .about
            .fits(file.snapshot.octaves(), mode, front_end.model(), front_end.octaves())
            .map_err(OpenMapError::Camera)?;
        Ok((Self::around(front_end, file.snapshot.clone(), rig, mode, rate_hz, runner, config), notes))
    }

    /// An engine in a map of several cameras, of which its own need not be one: it only localises.
    fn among_other_cameras(
        front_end: FrontEnd,
        file: &MapFile,
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
    ) -> Result<(Self, Vec<String>), OpenMapError> {
        let (camera, octaves) = (*front_end.model(), (file.snapshot.octaves(), front_end.octaves()));
        if octaves.0 != octaves.1 {
            let why = format!("the map has {:?}, this run {:?}", octaves.0, octaves.1);
            return Err(OpenMapError::Camera(why));
        }
        if !(camera.has_depth() || file.snapshot.is_gravity_aligned_throughout()) {
            let why = "it was made with several cameras; a run without depth finds its way in it only where gravity is known";
            return Err(OpenMapError::Camera(why.into()));
        }
        let snapshot = file.in_atlas_with(mode, &camera, 0.0).snapshot;
        let engine = Self::around(front_end, snapshot, rig, mode, rate_hz, runner, config).localize_only();
        Ok((engine, vec!["it was made with several cameras: this run only localises in it".into()]))
    }

    /// The same engine that only localises: the map stays unchanged, and no new map is created.
    pub fn localize_only(mut self) -> Self {
        self.localize_only = true;
        self
    }

    /// The latest map with its provenance, for saving; `program` names who saves it, `attached` are further
    /// named parts of the file.
    pub fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        let about =
            About { program: program.to_owned(), sensor: self.mode, camera: *self.front_end().model() };
        MapFile { snapshot: (*self.snapshot()).clone(), about, attached }
    }
}
