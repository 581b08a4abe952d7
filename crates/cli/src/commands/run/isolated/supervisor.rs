//! Runs the processes, and writes the results.

use super::super::arguments::Arguments;
use super::super::sinks::Sinks;
use super::super::tally::Tally;
use super::super::{map, results, route, source, surface, walker};
use super::monitor::Monitor;
use super::saver::Saver;
use super::several::Several;
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
use cairn_workers::{RunFolder, SuperviseError, Supervision};
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
    let config = source::config_of(a)?;
    check(a)?;
    let say = walker::say_of(a, a.guide.is_some())?;
    if let (Some(path), Some(map)) = (a.record.as_ref().filter(|path| path.exists()), map::opened(a)?) {
        // It fits, or the run ends here.
        route::resume(path, &map, config.route.recorder)?;
    }
    let folder = folder_in(parent)?;
    let Attached { whole, kept } = begin_in(a, &folder)?;
    interrupt::in_order();
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::sets(stop.clone());
    let mut sinks = Sinks::new(Progress::new(None));
    sinks.add(Some(say.voice(walker::speech_of(a), outputs.file("--say wav:"), output.is_json())?));
    sinks.at_end(|ended| ended.run.close_recording());
    let to = outputs.file("--map-out");
    sinks.add(Saver::begin(a, folder.path(), to, whole, sinks.progress.clone()));
    sinks.add(map::Saver::begin(a, to, kept, sinks.progress.clone()));
    results::add(&mut sinks, a, outputs);
    let mut tally = Tally::new(began);
    let mut monitor = Monitor::new(a, &mut sinks, &mut tally);
    let run = cairn_workers::supervise(&supervision(a), &folder, &stop, &mut |told| monitor.tell(&told));
    let run = run.map_err(|e| match e {
        SuperviseError::Worker(e) => Failure::new(e.what, e.why, e.cure),
        e => Failure::new("the run", e.to_string(), "run without --isolated to see where it fails"),
    })?;
    // Without the source there is no ground truth, and the run is none the worse for it.
    let opened = source::open_source(a, &mut config.engine.clone(), None).ok().map(|(source, _)| source);
    let cam0 = opened.as_ref().and_then(|opened| source::cam0(a, opened.rig()));
    let truth = opened.map_or_else(Vec::new, |source| source.info().truth.clone());
    let mut several = Several { a, run, folder, tally, config, cam0, truth };
    // With --mesh that is said when the surface is to be written.
    let no_surfaces = several.surfaces().err().filter(|_| a.mesh.is_none());
    results::conclude(a, output, sinks.end(&mut several, no_surfaces))
}

/// Checks before anything is opened what needs no input.
fn check(a: &Arguments) -> Result<(), Failure> {
    a.guide.as_deref().map(route::check).transpose()?;
    a.mesh.as_deref().map(form).transpose()?;
    if a.colour && !surface::is_wanted(a) {
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
    Ok(())
}

fn supervision(a: &Arguments) -> Supervision {
    let hang_limit = hang_limit(a);
    Supervision {
        command: Box::new(this_program),
        hang_limit,
        late_limit: if a.realtime { LATE } else { hang_limit },
        guide: a.guide.is_some() || a.record.is_some(),
        records: a.record.is_some(),
        surfaces: surface::is_wanted(a).then_some(match a.colour {
            true => SurfaceInput::DepthAndGray,
            false => SurfaceInput::Depth,
        }),
    }
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
    if surface::is_wanted(a) {
        // Dense goes on from it, and gives it back with what it adds.
        let path = a.map_in.as_deref().unwrap_or(Path::new("--map-in"));
        file.take_depth().map_err(|e| failed(path, &e))?;
    }
    Ok(Attached { whole, kept: file.attached })
}
