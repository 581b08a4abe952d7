//! `revisit`: walks that come back to where they were. Laps with closing and without; a lens that goes black around a
//! corner; rooms that look alike.

use crate::{MeasureOptions, Measured, Sensor, measure};
use cairn_engine::Config;
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{FramePacket, Rig, Source, SourceError, SourceInfo, Stamp};
use cairn_sim::{CameraPath, SimConfig, SimSource, WorldKind};
use serde::Serialize;
use std::fmt::Write;
use std::sync::Arc;

/// Frames a second.
const RATE_HZ: f64 = 12.0;
/// Seconds for which the lens is black.
const DARK_S: f64 = 5.0;

/// What happens on the walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
pub enum Trial {
    /// Two laps.
    Laps,
    /// The same with closing off.
    LapsOpen,
    /// Two laps with a black lens around a corner of the first.
    Dark,
    /// An office whose rooms look alike.
    Alike,
}

/// One walk.
#[derive(Clone, Copy, Debug)]
pub struct Revisit {
    /// What happens.
    pub trial: Trial,
    /// Where.
    pub world: WorldKind,
    /// What sees.
    pub sensor: Sensor,
    /// Seed of world and noise.
    pub seed: u64,
}

/// A walk and what came of it.
#[derive(Clone, Debug, Serialize)]
pub struct Revisited {
    /// What happened.
    pub trial: Trial,
    /// World.
    pub world: String,
    /// Seed.
    pub seed: u64,
    /// When the lens was black, seconds after the first frame.
    pub dark_s: Option<[f64; 2]>,
    /// When, after the dark, a place was first near that had been seen before it, seconds after the first frame.
    pub known_s: Option<f64>,
    /// The run.
    pub measured: Measured,
}

impl Revisit {
    /// What is seen on it.
    ///
    /// # Errors
    /// When the world does not serve.
    pub fn source(&self) -> Result<SimSource, String> {
        let text = |e: SourceError| e.to_string();
        let mut sim = SimConfig::new(self.world, self.seed);
        sim.rate_hz = RATE_HZ;
        if !self.sensor.is_inertial() {
            sim.imu = None;
        }
        sim.walker.speed = 1.1;
        sim.options.detail = 0.6;
        sim.options.look_alike = self.trial == Trial::Alike;
        sim.sensor = self.sensor.simulated();
        let plain = SimSource::new(&sim).map_err(text)?;
        if self.trial != Trial::Alike {
            sim.route = CameraPath::Points(laps(&plain, self.world)?);
        }
        SimSource::in_map(&sim, plain.world().clone()).map_err(text)
    }

    /// Walks it.
    ///
    /// # Errors
    /// As [`measure()`].
    pub fn run(&self, config: &Config, verbose: bool) -> Result<Revisited, String> {
        let inner = self.source()?;
        let dark_s = (self.trial == Trial::Dark).then(|| around_a_corner(&inner.info().truth)).flatten();
        let known_s = dark_s.and_then(|dark| back_at(&inner.info().truth, dark));
        let mut source = Darkened { inner, dark_s };
        let mut config = config.clone();
        config.closer.enabled &= self.trial != Trial::LapsOpen;
        let measured =
            measure(&mut source, &MeasureOptions { verbose, config, ..MeasureOptions::new(self.sensor) })?;
        let (trial, world, seed) = (self.trial, self.world.to_string(), self.seed);
        Ok(Revisited { trial, world, seed, dark_s, known_s, measured })
    }
}

/// The closed way of a world, twice.
fn laps(source: &SimSource, world: WorldKind) -> Result<Vec<Vec2>, String> {
    let name = match world {
        WorldKind::Street => "block",
        _ => "loop",
    };
    let route = source.world().route(name).ok_or(format!("sim:{world} has no way {name}"))?;
    Ok(route.points.iter().chain(&route.points[1..]).copied().collect())
}

fn yaw(pose: &Se3) -> f64 {
    let ahead = pose.rotation * Vec3::z();
    ahead.y.atan2(ahead.x)
}

/// Around the sharpest turn between a fifth and two fifths of the way.
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

/// When, after the dark, the truth first stands within a metre and 20 degrees of where it was before the dark.
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

/// A source whose lens is black for a while.
pub(crate) struct Darkened {
    pub(crate) inner: SimSource,
    /// From when to when, seconds after the first frame.
    pub(crate) dark_s: Option<[f64; 2]>,
}

impl Source for Darkened {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn rig(&self) -> &Rig {
        self.inner.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let first = self.inner.info().truth.first().map(|p| p.0);
        let Some(mut packet) = self.inner.next_packet()? else { return Ok(None) };
        let t = first.map_or(0.0, |first| packet.stamp - first);
        if self.dark_s.is_some_and(|[from, to]| t >= from && t <= to) {
            for image in &mut packet.images {
                Arc::make_mut(image).data_mut().fill(3);
            }
            packet.depth = None;
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        self.inner.skipped()
    }
}

/// One walk in a line.
pub fn line(r: &Revisited) -> String {
    let m = &r.measured;
    let mut text = format!("{:?} {} seed {} {}: ", r.trial, r.world, r.seed, m.sensor.name());
    text.push_str(&crate::walks::line(m));
    // Writing to a string does not fail.
    if let (Some([from, to]), Some(known)) = (r.dark_s, r.known_s) {
        let after = m.joined_s.iter().find(|t| **t > to).map(|t| t - known);
        let _ = write!(
            text,
            ", dark {from:.1}-{to:.1} s, known again at {known:.1} s, joined {after:.2?} s later"
        );
    }
    text
}
