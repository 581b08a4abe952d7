//! Opening the map of --map-in and saving the map of --map-out.

use super::arguments::Arguments;
use super::sink::{Ended, Sink, Step};
use crate::commands::map::{failed, open};
use crate::failure::Failure;
use crate::output::warn;
use crate::progress::Progress;
use cairn::map_file;
use cairn_atlas::store::{MapFile, StoreError};
use cairn_engine::{Config, Engine, OpenMapError, Runner, SensorMode};
use cairn_sensor::Rig;
use cairn_sources::std_host;
use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;
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
    to: &'a Path,
    every: Duration,
    /// The attachments of the map of --map-in.
    attached: BTreeMap<String, Vec<u8>>,
    last: Instant,
    /// The save in progress, on its own thread: the run does not wait for the disk.
    work: Option<JoinHandle<Result<u64, StoreError>>>,
    progress: Rc<Progress>,
}

impl<'a> Saver<'a> {
    /// Saves to the checked file of --map-out as the arguments say, if there is one; what was attached to the map of
    /// --map-in is kept.
    pub fn begin(
        a: &Arguments,
        to: Option<&'a Path>,
        attached: BTreeMap<String, Vec<u8>>,
        progress: Rc<Progress>,
    ) -> Option<Self> {
        let every = Duration::try_from_secs_f64(a.map_every).unwrap_or(Duration::MAX);
        Some(Self { to: to?, every, attached, last: Instant::now(), work: None, progress })
    }

    fn is_due(&self) -> bool {
        self.last.elapsed() >= self.every && self.work.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Sink for Saver<'_> {
    /// Starts a save if one is due and the previous one is done, with the depth of key frames where there is a dense map.
    /// Failures are reported and retried.
    fn step(&mut self, step: &mut Step) {
        let Some((session, dense)) = step.here.as_mut().filter(|_| self.is_due()) else { return };
        self.last = Instant::now();
        if let Some(Ok(Err(e))) = self.work.take().map(JoinHandle::join) {
            self.progress.warn(&failed(self.to, &e).to_string());
        }
        let Some(mut file) = map_file(session, &self.attached) else { return };
        let depth = dense.as_mut().map_or_else(Vec::new, |dense| dense.to_save(&file.snapshot));
        let path = self.to.to_owned();
        let save = move || {
            file.add_depth(&depth);
            file.save(&path)
        };
        self.work = std::thread::Builder::new().name("cairn-save".into()).spawn(save).ok();
    }

    /// Saves the final map. A map without a key frame is not saved.
    fn end(mut self: Box<Self>, ended: &mut Ended) -> Result<(), Failure> {
        // If that save failed, the one below is the retry.
        drop(self.work.take().map(JoinHandle::join));
        let Some(file) = ended.run.map(&self.attached) else {
            warn(&format!("{}: not written because the map is empty", self.to.display()));
            return Ok(());
        };
        file.save(self.to).map(drop).map_err(|e| failed(self.to, &e))
    }
}
