//! Runs the processes, and writes the results.

use super::super::say::Say;
use super::super::{Arguments, map};
use super::monitor::Monitor;
use super::options::{config_of, makes_surfaces};
use super::report::{report, written};
use super::saver::Saver;
use crate::commands::map::failed;
use crate::failure::Failure;
use crate::interrupt;
use crate::map_lock::MapLock;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::processes::{SHARED_MEMORY, folder_in, this_program};
use crate::progress::Progress;
use crate::surface::form;
use cairn_workers::message::SurfaceInput;
use cairn_workers::{RunFolder, Supervision, dense};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// In real time SLAM has done a frame after this time, or the guide says stop.
const LATE: Duration = Duration::from_millis(250);

/// Runs the processes in a folder under `parent`, then writes the results.
///
/// # Errors
/// When an input cannot be used, a process dies again and again, no frame gets a pose, or a result cannot be written.
pub fn supervise(
    a: &Arguments,
    outputs: &Outputs,
    output: &Output,
    began: Instant,
    parent: &Path,
) -> Result<(), Failure> {
    let _lock = outputs.file("--map-out").map(MapLock::take).transpose()?;
    let config = config_of(a)?;
    a.guide.as_deref().map(super::super::route::check).transpose()?;
    a.mesh.as_deref().map(form).transpose()?;
    if a.colour && !makes_surfaces(a) {
        let hint = "add --mesh or --dense";
        return Err(Failure::usage("--colour", "colours are those of surfaces", hint));
    }
    if a.guide.is_some() && a.map_in.is_none() {
        let hint = "load its map with --map-in";
        return Err(Failure::usage("--guide", "the route needs the map it was recorded in", hint));
    }
    if a.guide.is_some() && a.record.is_some() {
        let hint = "record in one run and be guided in another";
        return Err(Failure::usage("--isolated", "one process guides or records", hint));
    }
    let say = a.say.clone().unwrap_or(if a.guide.is_some() { Say::Text } else { Say::None });
    let speech = super::super::speech_of(a);
    say.check(speech)?;
    if let (Some(path), Some(map)) = (a.record.as_ref().filter(|path| path.exists()), map::opened(a)?) {
        // It fits, or the run ends here.
        super::super::route::resume(path, &map, config.route.recorder)?;
    }
    let folder = folder_in(parent)?;
    let Attached { whole, kept } = begin_in(a, &folder)?;
    let mut saver = Saver::new(a, folder.path(), outputs.file("--map-out"), whole);
    interrupt::in_order();
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::sets(stop.clone());
    let hang_limit = hang_limit(a);
    let late_limit = if a.realtime { LATE } else { hang_limit };
    let how = Supervision {
        command: Box::new(this_program),
        hang_limit,
        late_limit,
        guide: a.guide.is_some() || a.record.is_some(),
        records: a.record.is_some(),
        surfaces: makes_surfaces(a).then_some(match a.colour {
            true => SurfaceInput::DepthAndGray,
            false => SurfaceInput::Depth,
        }),
    };
    let voice = say.voice(speech, outputs.file("--say wav:"), output.is_json())?;
    let mut monitor = Monitor::new(a, began, voice);
    let run = cairn_workers::supervise(&how, &folder, &stop, &mut |told| {
        monitor.tell(&told);
        saver.save_if_due().iter().for_each(|why| monitor.progress.warn(why));
    });
    drop(saver);
    let mut run = run.map_err(|e| match e {
        cairn_workers::SuperviseError::Worker(e) => Failure::new(e.what, e.why, e.cure),
        e => Failure::new("the run", e.to_string(), "run without --isolated to see where it fails"),
    })?;
    let heard = monitor.voice.end().map_err(super::super::say::fail);
    run.map.attached.extend(kept);
    drop(std::mem::replace(&mut monitor.progress, Progress::hidden()));
    let report = report(a, &run, &monitor, &config, began);
    let surface = || {
        let path = folder.path().join(dense::SURFACE);
        std::fs::read(&path)
            .map_err(|e| Failure::new("the surface", e.to_string(), "free some shared memory"))
    };
    let written = written(a, outputs, output, &run, &report, &surface);
    heard.and(written)
}

/// Lockstep adjusts whole maps between two frames, which takes seconds in a large one.
fn hang_limit(a: &Arguments) -> Duration {
    Duration::from_secs(if a.realtime { 2 } else { 30 })
}

/// What is attached to the map of --map-in: all of it, and what the map at the end gets of it.
#[derive(Default)]
struct Attached {
    whole: BTreeMap<String, Vec<u8>>,
    kept: BTreeMap<String, Vec<u8>>,
}

/// Begins the journal with the map of --map-in; returns what is attached to it.
fn begin_in(a: &Arguments, folder: &RunFolder) -> Result<Attached, Failure> {
    let Some(mut file) = map::opened(a)? else { return Ok(Attached::default()) };
    let whole = std::mem::take(&mut file.attached);
    cairn_workers::journal::JournalWriter::begin(folder.path(), &file)
        .map_err(|e| Failure::new(SHARED_MEMORY, e.to_string(), "free some of it"))?;
    file.attached = whole.clone();
    if makes_surfaces(a) {
        // Dense goes on from it, and gives it back with what it adds.
        let path = a.map_in.as_deref().unwrap_or(Path::new("--map-in"));
        file.take_depth().map_err(|e| failed(path, &e))?;
    }
    Ok(Attached { whole, kept: file.attached })
}
