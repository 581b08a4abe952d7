//! `revisit`: walks that return to earlier places. Laps with and without loop closing; a camera covered around a
//! corner; rooms that look alike.

use crate::darkened::Darkened;
use crate::{MeasureError, Measured, RunOptions, Sensors, measure};
use cairn_engine::Config;
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{Source, Stamp};
use cairn_sim::{CameraPath, SimConfig, SimSource, WorldKind};
use serde::Serialize;
use std::fmt::Write;

/// Frames per second.
const RATE_HZ: f64 = 12.0;
/// Seconds for which the camera is covered.
const DARK_S: f64 = 5.0;

/// The kind of walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
pub enum Trial {
    /// Two laps.
    Laps,
    /// Two laps with loop closing disabled.
    LapsOpen,
    /// Two laps with the camera covered around a corner of the first.
    Dark,
    /// An office whose rooms look alike.
    Alike,
}

/// Configuration of one walk.
#[derive(Clone, Copy, Debug)]
pub struct Revisit {
    /// The kind of walk.
    pub trial: Trial,
    /// The world.
    pub world: WorldKind,
    /// The sensors.
    pub sensor: Sensors,
    /// Seed of world and noise.
    pub seed: u64,
}

/// Result of a walk.
#[derive(Clone, Debug, Serialize)]
pub struct Revisited {
    /// The kind of walk.
    pub trial: Trial,
    /// World.
    pub world: String,
    /// Seed.
    pub seed: u64,
    /// When the camera was covered, seconds after the first frame.
    pub dark_s: Option<[f64; 2]>,
    /// When, after that, the camera first came near a place visited before it, seconds after the first frame.
    pub known_s: Option<f64>,
    /// Figures of the run.
    pub measured: Measured,
}

impl Revisit {
    /// The source with the rendered walk.
    ///
    /// # Errors
    /// When the world is unsuitable.
    pub fn source(&self) -> Result<SimSource, MeasureError> {
        let mut sim = SimConfig::new(self.world, self.seed);
        sim.rate_hz = RATE_HZ;
        if !self.sensor.has_imu() {
            sim.imu = None;
        }
        sim.walker.speed = 1.1;
        sim.options.detail = 0.6;
        sim.options.look_alike = self.trial == Trial::Alike;
        sim.sensor = crate::run::simulated(self.sensor);
        let plain = SimSource::new(&sim)?;
        if self.trial != Trial::Alike {
            sim.route = CameraPath::Points(laps(&plain, self.world)?);
        }
        Ok(SimSource::in_world(&sim, plain.world().clone())?)
    }

    /// Runs the engine on the walk.
    ///
    /// # Errors
    /// As [`measure()`].
    pub fn run(&self, config: &Config, verbose: bool) -> Result<Revisited, MeasureError> {
        let inner = self.source()?;
        let dark_s = (self.trial == Trial::Dark).then(|| around_a_corner(&inner.info().truth)).flatten();
        let known_s = dark_s.and_then(|dark| back_at(&inner.info().truth, dark));
        let mut source = Darkened::new(Box::new(inner), dark_s);
        let mut config = config.clone();
        config.closer.enabled &= self.trial != Trial::LapsOpen;
        let measured = measure(&mut source, &RunOptions { verbose, config, ..RunOptions::new(self.sensor) })?;
        let (trial, world, seed) = (self.trial, self.world.to_string(), self.seed);
        Ok(Revisited { trial, world, seed, dark_s, known_s, measured })
    }
}

/// The closed route of a world, twice.
fn laps(source: &SimSource, world: WorldKind) -> Result<Vec<Vec2>, MeasureError> {
    let name = match world {
        WorldKind::Street => "block",
        _ => "loop",
    };
    let route = source.world().route(name).ok_or(format!("sim:{world} has no route {name}"))?;
    Ok(route.points.iter().chain(&route.points[1..]).copied().collect())
}

fn yaw(pose: &Se3) -> f64 {
    let ahead = pose.rotation * Vec3::z();
    ahead.y.atan2(ahead.x)
}

/// The time around the sharpest turn between one fifth and two fifths of the walk.
fn around_a_corner(truth: &[(Stamp, Se3)]) -> Option<[f64; 2]> {
    let step = RATE_HZ as usize;
    let (a, b) = (truth.len() / 5, 2 * truth.len() / 5);
    let turned = |i: usize| {
        let d = yaw(&truth[i + step].1) - yaw(&truth[i].1);
        d.sin().atan2(d.cos()).abs()
    };
    let i = (a..b).max_by(|i, j| turned(*i).total_cmp(&turned(*j)))?;
    let middle = truth[i + step / 2].0 - truth[0].0;
    Some([middle - 0.5 * DARK_S, middle + 0.5 * DARK_S])
}

/// When the true pose, after the dark, first comes within a metre and 20 degrees of one before the dark.
fn back_at(truth: &[(Stamp, Se3)], dark: [f64; 2]) -> Option<f64> {
    let at = |i: usize| truth[i].0 - truth[0].0;
    let before: Vec<&Se3> = (0..truth.len()).filter(|i| at(*i) < dark[0]).map(|i| &truth[i].1).collect();
    (0..truth.len())
        .filter(|i| at(*i) > dark[1])
        .find(|i| {
            let here = &truth[*i].1;
            before.iter().any(|b| {
                (b.translation - here.translation).norm() < 1.0
                    && (b.rotation.inverse() * here.rotation).angle() < 20_f64.to_radians()
            })
        })
        .map(at)
}

/// One walk as a line of text.
pub fn line(r: &Revisited) -> String {
    let m = &r.measured;
    let mut text = format!("{:?} {} seed {} {}: ", r.trial, r.world, r.seed, m.sensor.name());
    text.push_str(&crate::walks::line(m));
    // Writing to a string cannot fail.
    if let (Some([from, to]), Some(known)) = (r.dark_s, r.known_s) {
        let after = m.joined_s.iter().find(|t| **t > to).map(|t| t - known);
        let _ = write!(
            text,
            ", covered {from:.1}-{to:.1} s, near a known place at {known:.1} s, joined {after:.2?} s later"
        );
    }
    text
}
