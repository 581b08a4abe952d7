//! Opening the map of --map-in and saving the map of --map-out.

use super::Arguments;
use crate::commands::map::{failed, open};
use crate::failure::Failure;
use crate::output::warn;
use cairn::map_file;
use cairn_atlas::store::{MapFile, StoreError};
use cairn_engine::{Config, DenseMapper, Engine, OpenMapError, Runner, SensorMode};
use cairn_sensor::Rig;
use cairn_session::Session;
use cairn_sources::std_host;
use std::collections::BTreeMap;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const CHOOSE: &str = "choose another --sensor, or give a calibration with --rig";

/// Opens the map of --map-in.
///
/// # Errors
/// When it cannot be read, is damaged or empty.
pub fn opened(a: &Arguments) -> Result<Option<MapFile>, Failure> {
    let Some(path) = &a.map_in else { return Ok(None) };
    let file = open(path)?;
    if file.snapshot.key_frame_count() == 0 {
        let shown = path.display().to_string();
        return Err(Failure::new(
            shown,
            "the map is empty",
            "give a map with key frames, or leave out --map-in",
        ));
    }
    Ok(Some(file))
}

/// The engine, started in the opened map if there is one.
///
/// # Errors
/// When the rig does not fit the sensor mode or the map.
pub fn engine(
    a: &Arguments,
    file: Option<&MapFile>,
    rig: &Rig,
    mode: SensorMode,
    rate_hz: f64,
    runner: Runner,
    config: &Config,
) -> Result<Engine, Failure> {
    let unsuitable = |why: String| Failure::new(&a.source, why, CHOOSE);
    let (Some(file), Some(path)) = (file, &a.map_in) else {
        return Engine::new(rig, mode, rate_hz, runner, config, &std_host())
            .map_err(|e| unsuitable(e.to_string()));
    };
    let shown = path.display().to_string();
    let opened = Engine::in_map_of_any_camera(rig, mode, rate_hz, runner, config, &std_host(), file);
    let (engine, notes) = opened.map_err(|e| match e {
        OpenMapError::Rig(e) => unsuitable(e.to_string()),
        why => Failure::new(&shown, why.to_string(), "use the camera and --sensor the map was made with"),
    })?;
    notes.iter().for_each(|text| warn(&format!("{shown}: {text}")));
    Ok(if a.localize_only { engine.localize_only() } else { engine })
}

/// Saves the map to --map-out, periodically and at the end.
pub struct Saver<'a> {
    to: Option<&'a Path>,
    every: Duration,
    /// The attachments of the map of --map-in.
    attached: BTreeMap<String, Vec<u8>>,
    last: Instant,
    /// The save in progress, on its own thread: the run does not wait for the disk.
    work: Option<JoinHandle<Result<u64, StoreError>>>,
}

impl<'a> Saver<'a> {
    /// Saves to the checked file of --map-out as the arguments say; the attachments of the map of --map-in are kept.
    pub fn new(a: &Arguments, to: Option<&'a Path>, before: Option<MapFile>) -> Self {
        Self {
            to,
            every: Duration::try_from_secs_f64(a.map_every).unwrap_or(Duration::MAX),
            attached: before.map_or_else(BTreeMap::new, |file| file.attached),
            last: Instant::now(),
            work: None,
        }
    }

    /// Starts a save if one is due and the previous one is done, with the depth of key frames where there is a dense map.
    /// Failures are reported and retried.
    pub fn save_if_due(&mut self, session: &Session, dense: Option<&mut DenseMapper>, warn: impl Fn(&str)) {
        let Some(path) = self.to else { return };
        if self.last.elapsed() < self.every || self.work.as_ref().is_some_and(|work| !work.is_finished()) {
            return;
        }
        self.last = Instant::now();
        if let Some(Ok(Err(e))) = self.work.take().map(JoinHandle::join) {
            warn(&failed(path, &e).to_string());
        }
        let Some(mut file) = self.file(session) else { return };
        let depth = dense.map_or_else(Vec::new, |dense| dense.to_save(&file.snapshot));
        let path = path.to_owned();
        let save = move || {
            file.add_depth(&depth);
            file.save(&path)
        };
        self.work = std::thread::Builder::new().name("cairn-save".into()).spawn(save).ok();
    }

    /// Saves the final map. A map without a key frame is not saved.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn end(mut self, session: &Session, dense: Option<&mut DenseMapper>) -> Result<(), Failure> {
        let Some(path) = self.to else { return Ok(()) };
        // If that save failed, the one below is the retry.
        drop(self.work.take().map(JoinHandle::join));
        let Some(mut file) = self.file(session) else {
            warn(&format!("{}: not written because the map is empty", path.display()));
            return Ok(());
        };
        if let Some(dense) = dense {
            let depth = dense.to_save(&file.snapshot);
            file.add_depth(&depth);
        }
        file.save(path).map(drop).map_err(|e| failed(path, &e))
    }

    /// The current map with its attachments; `None` while it is empty.
    fn file(&self, session: &Session) -> Option<MapFile> {
        map_file(session, &self.attached)
    }
}
