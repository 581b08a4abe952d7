//! Simulated walkers: a turn about before plain walls, and a minute of standing still, with eyes open and without.

use super::ran::{Asked, Figures, run};
use crate::revisit::Darkened;
use cairn_geometry::Vec2;
use cairn_sensor::{Source, Stamp};
use cairn_sim::{CameraPath, SimConfig, SimSource, WorldKind};
use serde::Serialize;
use std::f64::consts::PI;

/// A walk out, a turn, and home.
#[derive(Clone, Debug, Serialize)]
pub struct Turn {
    /// As of every run.
    pub figures: Figures,
    /// Seed.
    pub seed: u64,
    /// Seconds that the turn takes.
    pub turn_s: f64,
    /// The last pose against the truth, when the way out is laid on the truth, metres: in the final map, as told at the time.
    pub end_m: [Option<f64>; 2],
    /// Seconds without a pose told between the begin of the turn and the end.
    pub blind_s: f64,
}

/// A minute of standing still.
#[derive(Clone, Debug, Serialize)]
pub struct Rest {
    /// As of every run.
    pub figures: Figures,
    /// Whether the lens was black meanwhile.
    pub dark: bool,
    /// How far the poses told at the time wander within the minute, metres; none without any.
    pub wanders_m: Option<f64>,
    /// Share of the minute's packets with a pose told.
    pub covered: f64,
}

/// Turns take from 2 to 4 s over this many seeds.
const TURNS: u64 = 20;
/// Seconds of standing still.
const REST_S: f64 = 60.0;

/// Walks 20 m out, turns about in 2 to 4 s and walks home.
///
/// # Errors
/// When the run fails.
pub fn turn(seed: u64, asked: &Asked) -> Result<Turn, String> {
    let turn_s = 2.0 + 2.0 * (seed.saturating_sub(1) % TURNS) as f64 / (TURNS - 1) as f64;
    let mut config = SimConfig::new(WorldKind::DeadEnd, seed);
    config.sensor = asked.sensor.simulated();
    config.walker.turn_rate = PI / turn_s;
    config.walker.speed = 1.0;
    let mut source = SimSource::new(&config).map_err(|e| e.to_string())?;
    let truth = source.info().truth.clone();
    let rate = |t: Stamp, source: &SimSource| source.motion().state(t - truth[0].0).rate.norm();
    let turning = truth.iter().map(|p| p.0).find(|t| *t - truth[0].0 > 5.0 && rate(*t, &source) > 0.4);
    let turning = turning.ok_or("the walker never turns")?;
    let ran = run(&mut source as &mut dyn Source, asked)?;
    let told = ran.live.iter().filter(|(t, _)| *t >= turning).count();
    let all = ran.stamps.iter().filter(|t| **t >= turning).count();
    Ok(Turn {
        figures: ran.figures(&format!("turn in {turn_s:.1} s, seed {seed}"), asked, 0.0)?,
        seed,
        turn_s,
        end_m: [ran.end_error(turning, &ran.poses)?, ran.end_error(turning, &ran.live)?],
        blind_s: (all - told.min(all)) as f64 / config.rate_hz,
    })
}

/// Walks 12 m, and stands still for a minute.
///
/// # Errors
/// When the run fails.
pub fn rest(seed: u64, asked: &Asked, dark: bool) -> Result<Rest, String> {
    let mut config = SimConfig::new(WorldKind::Hall, seed);
    config.sensor = asked.sensor.simulated();
    config.walker.rest_s = REST_S + 1.0;
    config.start_s = REST_S;
    let plain = SimSource::new(&config).map_err(|e| e.to_string())?;
    let route = plain.world().route("loop").ok_or("the hall has no loop")?.points.clone();
    config.route = CameraPath::Points(cut(&route, 12.0));
    let inner = SimSource::in_map(&config, plain.world().clone()).map_err(|e| e.to_string())?;
    let truth = &inner.info().truth;
    let end = truth.last().ok_or("no frames")?.0;
    let (first, from) = (truth[0].0, end.plus_seconds(-REST_S));
    // The last look around takes a second and a half.
    let dark_s = dark.then(|| [from - first + 1.5, f64::INFINITY]);
    let mut source = Darkened { inner, dark_s };
    let ran = run(&mut source as &mut dyn Source, asked)?;
    let count = |list: &mut dyn Iterator<Item = Stamp>| list.filter(|t| *t >= from).count() as f64;
    let told = count(&mut ran.live.iter().map(|p| p.0));
    let name = if dark { "a minute of standing, lens black" } else { "a minute of standing" };
    Ok(Rest {
        figures: ran.figures(name, asked, 0.0)?,
        dark,
        wanders_m: ran.wanders(from, end)?.map(|w| w[0]),
        covered: told / count(&mut ran.stamps.iter().copied()).max(1.0),
    })
}

/// The first metres of a way.
fn cut(route: &[Vec2], most: f64) -> Vec<Vec2> {
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
