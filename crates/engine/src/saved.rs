//! Starting an engine in a saved map, and saving its map.

use crate::assembly::Setup;
use crate::{Config, Engine, Runner, SensorMode};
use cairn_atlas::store::{About, CameraMismatch, MapFile};
use cairn_atlas::{MapId, Snapshot};
use cairn_sensor::{Host, Rig, RigError};
use cairn_vision::FrontEnd;
use std::collections::BTreeMap;

/// Why another camera cannot use a map, by what is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnfitMap {
    /// Features of the same scales.
    #[error("its features are of other scales")]
    Octaves,
    /// Lengths in metres.
    #[error("another camera needs a map whose lengths are metres")]
    NotMetric,
    /// Gravity, as it measures no depth.
    #[error("another camera without depth needs a map that is aligned with gravity")]
    NotGravityAligned,
    /// Depth or an IMU, to go on with it rather than to be localised in it.
    #[error("another camera that has neither depth nor an IMU cannot continue it")]
    OnlyLocalises,
}

/// Why an engine cannot use a saved map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OpenMapError {
    /// The rig cannot serve the mode.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The map was made with another camera or other sensors, and is of no use to this one.
    #[error("{mismatch}; {why}")]
    OtherCamera {
        /// In what they differ.
        mismatch: CameraMismatch,
        /// What another camera would need.
        why: UnfitMap,
    },
    /// Where the engine is another process: it could not be begun there.
    #[error("{0}")]
    Process(String),
}

impl Engine {
    /// An engine that continues a saved map: one of its own camera, or of another where both have metres. A map in metres is
    /// continued by another camera with depth, and one that is aligned with gravity by another camera with an IMU: its key
    /// frames keep the camera they were made with. Maps without metres beside such a one, as a moment of lost tracking leaves them
    /// behind, are kept as they are. Tracking starts lost: there is no pose until a place is recognised. Also
    /// returns a description of the differences between the camera of the map and this one, and what is not used.
    ///
    /// # Errors
    ///
    /// [`OpenMapError`] when the rig cannot serve the mode, or the map cannot be continued by this camera.
    pub fn in_map(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
        host: &Host,
        file: &MapFile,
    ) -> Result<(Self, Vec<String>), OpenMapError> {
        let opened = Opened::new(rig, mode, config, file)?;
        if let Some(mismatch) = opened.only_localises {
            return Err(OpenMapError::OtherCamera { mismatch, why: UnfitMap::OnlyLocalises });
        }
        let Opened { front_end, snapshot, notes, .. } = opened;
        Ok((Self::around(front_end, snapshot, Setup { rig, mode, rate_hz, runner, config, host }), notes))
    }

    /// The same; a camera that has neither depth nor an IMU only localises in a map of another that is aligned with gravity.
    ///
    /// # Errors
    ///
    /// [`OpenMapError`] when the rig cannot serve the mode, or the map is of no use to this camera.
    pub fn in_map_of_any_camera(
        rig: &Rig,
        mode: SensorMode,
        rate_hz: f64,
        runner: Runner,
        config: &Config,
        host: &Host,
        file: &MapFile,
    ) -> Result<(Self, Vec<String>), OpenMapError> {
        let Opened { front_end, snapshot, notes, only_localises } = Opened::new(rig, mode, config, file)?;
        let engine = Self::around(front_end, snapshot, Setup { rig, mode, rate_hz, runner, config, host });
        Ok((if only_localises.is_some() { engine.localize_only() } else { engine }, notes))
    }

    /// The same engine that only localises: the map stays unchanged, and no new map is created.
    pub fn localize_only(mut self) -> Self {
        (self.localize_only, self.observers.status.mapping) = (true, false);
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

/// The maps of a file, ready for a camera.
struct Opened {
    front_end: FrontEnd,
    snapshot: Snapshot,
    notes: Vec<String>,
    /// In what the cameras differ, where this one cannot continue them.
    only_localises: Option<CameraMismatch>,
}

impl Opened {
    fn new(rig: &Rig, mode: SensorMode, config: &Config, file: &MapFile) -> Result<Self, OpenMapError> {
        let front_end = FrontEnd::new(rig, mode, config.front_end_for(rig))?;
        let has_imu = rig.imu.is_some() && config.inertial.enabled;
        let mismatch = match for_own_camera(file, mode, &front_end) {
            Ok((snapshot, notes)) => return Ok(Self { front_end, snapshot, notes, only_localises: None }),
            Err(mismatch) => mismatch,
        };
        match for_other_camera(file, mode, &front_end, has_imu) {
            Ok((snapshot, continues)) => {
                let how = match continues {
                    true => "its key frames keep their camera, new ones have this one",
                    false => "this run only localises in it",
                };
                let mut notes = vec![format!("{mismatch}; {how}")];
                notes.extend(without_metres(file));
                Ok(Self { front_end, snapshot, notes, only_localises: (!continues).then_some(mismatch) })
            }
            Err(why) => Err(OpenMapError::OtherCamera { mismatch, why }),
        }
    }
}

/// The maps of a file of this camera, and small differences.
fn for_own_camera(
    file: &MapFile,
    mode: SensorMode,
    front_end: &FrontEnd,
) -> Result<(Snapshot, Vec<String>), CameraMismatch> {
    let file = file.with_depth_weighed_for(front_end.model());
    let notes = file.about.fits(file.snapshot.octaves(), mode, front_end.model(), front_end.octaves())?;
    Ok((file.snapshot.clone(), notes))
}

/// The maps of a file that have metres, and those that have none.
fn by_metres(file: &MapFile) -> (Vec<MapId>, Vec<MapId>) {
    let maps = file.snapshot.maps().map(|(map, _)| map);
    maps.partition(|map| file.snapshot.is_metric_in(*map, &file.about.camera))
}

/// A sentence on the maps of a file that have no metres, where there are any.
fn without_metres(file: &MapFile) -> Option<String> {
    let (with, without) = by_metres(file);
    let key_frames: usize = without.iter().map(|map| file.snapshot.key_frames_of(*map).count()).sum();
    let (maps, all) = (with.len() + without.len(), file.snapshot.key_frame_count());
    let [has, it] = if without.len() == 1 { ["has", "it is"] } else { ["have", "they are"] };
    (!without.is_empty()).then(|| {
        format!(
            "{} of its {maps} maps, with {key_frames} of {all} key frames, {has} no metres: {it} kept, and no length is taken from there",
            without.len()
        )
    })
}

/// The maps of a file in an atlas of another camera, and whether it may continue them, or only localise in them. One map with metres is
/// enough: tracking that was lost for a moment leaves maps behind that have none.
///
/// # Errors
/// Why they are of no use to it.
fn for_other_camera(
    file: &MapFile,
    mode: SensorMode,
    front_end: &FrontEnd,
    has_imu: bool,
) -> Result<(Snapshot, bool), UnfitMap> {
    let camera = front_end.model();
    if file.snapshot.octaves() != front_end.octaves() {
        return Err(UnfitMap::Octaves);
    }
    let (metric, _) = by_metres(file);
    if metric.is_empty() {
        return Err(UnfitMap::NotMetric);
    }
    if !(camera.has_depth() || metric.iter().all(|map| file.snapshot.is_gravity_aligned(*map))) {
        return Err(UnfitMap::NotGravityAligned);
    }
    Ok((file.in_atlas_with(mode, camera, 0.0).snapshot, camera.has_depth() || has_imu))
}
