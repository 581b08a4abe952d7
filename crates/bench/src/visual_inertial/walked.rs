//! Simulated walkers: turning round in front of plain walls, and one minute of standing still, with the camera open and
//! covered.

use super::ran::{Figures, run};
use crate::MeasureError;
use crate::RunOptions;
use crate::darkened::Darkened;
use cairn_geometry::Vec2;
use cairn_sensor::{Source, Stamp};
use cairn_sim::{CameraPath, SimConfig, SimSource, WorldKind};
use serde::Serialize;
use std::f64::consts::PI;

/// Result of a walk out, a turn, and the walk back.
#[derive(Clone, Debug, Serialize)]
pub struct Turn {
    /// The figures of the run.
    pub figures: Figures,
    /// Seed.
    pub seed: u64,
    /// Duration of the turn, seconds.
    pub turn_s: f64,
    /// Error of the last pose after aligning the outbound walk with the ground truth, metres: final pose, live pose.
    pub end_m: [Option<f64>; 2],
    /// Seconds without a live pose from the start of the turn to the end.
    pub blind_s: f64,
}

/// Result of one minute of standing still.
#[derive(Clone, Debug, Serialize)]
pub struct Rest {
    /// The figures of the run.
    pub figures: Figures,
    /// Whether the camera was covered.
    pub dark: bool,
    /// Largest movement of the live poses within the minute, metres; `None` without poses.
    pub wanders_m: Option<f64>,
    /// Share of the minute's packets with a live pose.
    pub covered: f64,
}

/// Turns take from 2 to 4 s over this many seeds.
const TURNS: u64 = 20;
/// Seconds of standing still.
const REST_S: f64 = 60.0;

/// Walks 20 m out, turns round in 2 to 4 s and walks back.
///
/// # Errors
/// When the run fails.
pub fn turn(seed: u64, options: &RunOptions) -> Result<Turn, MeasureError> {
    let turn_s = 2.0 + 2.0 * (seed.saturating_sub(1) % TURNS) as f64 / (TURNS - 1) as f64;
    let mut config = SimConfig::new(WorldKind::DeadEnd, seed);
    config.sensor = crate::run::simulated(options.sensor);
    config.walker.turn_rate = PI / turn_s;
    config.walker.speed = 1.0;
    let mut source = SimSource::new(&config)?;
    let truth = source.info().truth.clone();
    let rate = |t: Stamp, source: &SimSource| source.motion().state(t - truth[0].0).rate.norm();
    let turning = truth.iter().map(|p| p.0).find(|t| *t - truth[0].0 > 5.0 && rate(*t, &source) > 0.4);
    let turning = turning.ok_or("the walker never turns")?;
    let ran = run(&mut source as &mut dyn Source, options)?;
    let live = ran.live.iter().filter(|(t, _)| *t >= turning).count();
    let all = ran.stamps.iter().filter(|t| **t >= turning).count();
    Ok(Turn {
        figures: ran.figures(&format!("turn in {turn_s:.1} s, seed {seed}"), options, 0.0)?,
        seed,
        turn_s,
        end_m: [ran.end_error(turning, &ran.poses)?, ran.end_error(turning, &ran.live)?],
        blind_s: (all - live.min(all)) as f64 / config.rate_hz,
    })
}

/// Walks 12 m, and stands still for a minute.
///
/// # Errors
/// When the run fails.
pub fn rest(seed: u64, options: &RunOptions, dark: bool) -> Result<Rest, MeasureError> {
    let mut config = SimConfig::new(WorldKind::Hall, seed);
    config.sensor = crate::run::simulated(options.sensor);
    config.walker.rest_s = REST_S + 1.0;
    config.start_s = REST_S;
    let plain = SimSource::new(&config)?;
    let route = plain.world().route("loop").ok_or("the hall has no loop")?.points.clone();
    config.route = CameraPath::Points(cut(&route, 12.0));
    let inner = SimSource::in_world(&config, plain.world().clone())?;
    let truth = &inner.info().truth;
    let end = truth.last().ok_or("no frames")?.0;
    let (first, from) = (truth[0].0, end.plus_seconds(-REST_S));
    // The walker still looks around for the first 1.5 s.
    let dark_s = dark.then(|| [from - first + 1.5, f64::INFINITY]);
    let mut source = Darkened::new(Box::new(inner), dark_s);
    let ran = run(&mut source as &mut dyn Source, options)?;
    let count = |list: &mut dyn Iterator<Item = Stamp>| list.filter(|t| *t >= from).count() as f64;
    let live = count(&mut ran.live.iter().map(|p| p.0));
    let name = if dark { "one minute of standing, camera covered" } else { "one minute of standing" };
    Ok(Rest {
        figures: ran.figures(name, options, 0.0)?,
        dark,
        wanders_m: ran.wanders(from, end)?.map(|w| w[0]),
        covered: live / count(&mut ran.stamps.iter().copied()).max(1.0),
    })
}

/// The first `most` metres of a route.
pub(super) fn cut(route: &[Vec2], most: f64) -> Vec<Vec2> {
    let (mut out, mut left) = (route.first().copied().into_iter().collect::<Vec<_>>(), most);
    for w in route.windows(2) {
        let length = (w[1] - w[0]).norm();
        let part = (left / length.max(1e-9)).min(1.0);
        if left <= 0.0 {
            break;
        }
        out.push(w[0] + (w[1] - w[0]) * part);
        left -= length;
    }
    out
}
