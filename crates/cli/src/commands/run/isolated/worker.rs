//! The work of one process of the run.

use super::super::arguments::Arguments;
use super::super::source::{config_of, open_part, vocabulary};
use super::super::{map, surface, walker};
use crate::failure::Failure;
use crate::output::warn;
use cairn_engine::{DenseMapper, Runner};
use cairn_guide::{Route, Travel};
use cairn_sensor::Source;
use cairn_session::RouteGuide;
use cairn_sources::Validator;
use cairn_workers::capture::{Delivered, rest_of};
use cairn_workers::guide::{RecordTo, Work};
use cairn_workers::message::Failure as WorkerFailure;
use cairn_workers::{Role, dense};
use std::path::Path;

/// A failure as it is told to the supervisor.
fn told(e: Failure) -> WorkerFailure {
    WorkerFailure::new(e.what, e.why, e.hint)
}

/// Does the work of one process.
///
/// # Errors
/// When the role is unknown. What fails later is told to the supervisor.
pub fn work(a: &Arguments) -> Result<(), Failure> {
    let name = a.isolated.worker.as_deref().unwrap_or_default();
    let role = Role::named(name).ok_or_else(|| {
        Failure::usage("--worker", format!("'{name}' is unknown"), "leave it out: --isolated starts workers")
    })?;
    cairn_workers::die_with_parent();
    if let Err(e) = cairn_workers::limit_memory(a.isolated.worker_memory * 1_000_000) {
        warn(&format!("the memory of {name} is not limited: {e}"));
    }
    let mut config = config_of(a)?.engine;
    let (from, to) = (std::io::stdin(), std::io::stdout());
    match role {
        Role::Capture => cairn_workers::capture::run(from, to, a.realtime, |delivered| {
            let map_in = map::opened(a).map_err(told)?;
            let part = delivered.map_or((a.start, a.frames), |d| rest(a, &d));
            let (source, sensor) = open_part(a, part, &mut config, map_in.as_ref()).map_err(told)?;
            let source = match &delivered {
                Some(delivered) => rest_of(source, delivered)?,
                None => source,
            };
            let source: Box<dyn Source> = Box::new(Validator::new(source, warn));
            Ok((source, sensor.name().to_owned()))
        }),
        Role::Slam => {
            if let Some(path) = &a.vocabulary {
                vocabulary(path)?;
            }
            cairn_workers::slam::run(from, to, &config, runner(a));
        }
        Role::Dense => cairn_workers::dense::run(from, to, || dense_of(a)),
        Role::Guide => cairn_workers::guide::run(from, to, a.realtime, || match &a.record {
            Some(path) => Ok(Work::Record(record_to(a, path)?)),
            None => guide_of(a).map(|guide| Work::Guide(Box::new(guide))),
        }),
        // Of `cairn serve` only.
        Role::Walk => {}
    }
    Ok(())
}

/// Where to begin reading again, seconds, and how many frames: a second before what was delivered last, since the first
/// packet of a source has no earlier IMU samples.
fn rest(a: &Arguments, delivered: &Delivered) -> (f64, Option<usize>) {
    let start_s = a.start + (delivered.last - delivered.first - 1.0).max(0.0);
    // With --frames from the beginning: how many frames that second has is not known. A simulated world, too: it would
    // end later.
    match a.frames.is_some() || a.source.starts_with("sim:") {
        true => (a.start, a.frames),
        false => (start_s, None),
    }
}

type Mesh = Box<dyn FnMut(&mut DenseMapper, bool) -> Result<Vec<u8>, WorkerFailure>>;

/// Surfaces, from the depth of --map-in on.
fn dense_of(a: &Arguments) -> Result<dense::Work<Mesh>, WorkerFailure> {
    let saved = match map::opened(a).map_err(told)? {
        Some(mut file) => {
            file.take_depth().map_err(|e| WorkerFailure::new("--map-in", e, "see cairn map repair"))?
        }
        None => Vec::new(),
    };
    let mesh = a.mesh.clone().map(|path| -> Mesh {
        Box::new(move |mapper, gravity_aligned| surface::bytes(mapper, gravity_aligned, &path).map_err(told))
    });
    Ok(dense::Work { config: surface::config(a), saved, surface: mesh })
}

/// The route of --record.
fn record_to(a: &Arguments, path: &Path) -> Result<RecordTo, WorkerFailure> {
    let config = config_of(a).map_err(told)?;
    Ok(RecordTo {
        path: path.to_owned(),
        exists: a.map_in.is_some() && path.exists(),
        without_map: a.map_in.is_none(),
        source: a.source.clone(),
        config: config.route.recorder,
        language: a.speaking.language,
    })
}

/// The guide along the route of --guide.
fn guide_of(a: &Arguments) -> Result<RouteGuide, WorkerFailure> {
    let no_route = |what: String, why: String| {
        WorkerFailure::new(what, why, "give a file that cairn run --record wrote")
    };
    let path = a.guide.as_ref().ok_or_else(|| no_route("--guide".into(), "there is no route".into()))?;
    let shown = path.display().to_string();
    let route = Route::load(path).map_err(|e| no_route(shown.clone(), e.to_string()))?;
    let travel = if a.back { Travel::Home } else { Travel::Again };
    let config = config_of(a).map_err(told)?.route;
    let announcer = walker::announcer_of(a);
    Ok(RouteGuide::new(route, travel, a.facing.facing(), config, a.speaking.phrases(), announcer))
}

fn runner(a: &Arguments) -> Runner {
    if a.realtime { Runner::Threaded } else { Runner::Lockstep }
}
