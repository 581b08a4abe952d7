//! `next-day`: relocalisation in the map of an earlier walk, from starts in its middle: in different light, beside the
//! path, looking in another direction. How often, and how soon, is the place recognised?

use crate::MeasureError;
use crate::Sensors;
use crate::run::simulated;
use cairn_engine::{Config, Engine, Runner};
use cairn_geometry::{Se3, Sim3, So3, Vec3, umeyama};
use cairn_random::Random;
use cairn_sensor::{Source, Stamp};
use cairn_sim::{CameraPath, SimConfig, SimSource, WorldKind};
use cairn_sources::std_host;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The worlds, which alternate with the seeds.
const WORLDS: [WorldKind; 4] = [WorldKind::Corridor, WorldKind::Office, WorldKind::Hall, WorldKind::Street];
/// Frames per second.
const RATE_HZ: f64 = 12.0;
/// Seconds of the first day's walk.
const WALK_S: f64 = 45.0;
/// Time within which the place should be recognised, seconds.
const SOON_S: f64 = 2.0;
/// Largest error of a correct pose, metres.
const RIGHT_M: f64 = 0.5;

/// Lateral distances from the path, metres.
pub const BESIDE_M: [f64; 4] = [0.0, 0.5, 1.0, 1.5];
/// Angles of the view to the side, degrees.
pub const ASIDE_DEG: [f64; 5] = [0.0, 15.0, 30.0, 45.0, 60.0];

/// Result of one start.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// Lateral distance from the path, metres.
    pub beside_m: f64,
    /// Angle of the view to the side, degrees.
    pub aside_deg: f64,
    /// Seconds until the first correct pose.
    pub known_s: Option<f64>,
    /// Number of wrong poses.
    pub wrong: usize,
}

/// A map of one walk.
pub struct Day {
    config: SimConfig,
    source: SimSource,
    engine: Engine,
    sensor: Sensors,
    /// From the map's frame to the ground-truth frame.
    true_from_map: Sim3,
}

impl Day {
    /// Maps the first route of a world.
    ///
    /// # Errors
    /// When the world cannot be rendered or nothing was mapped.
    pub fn walk(world: WorldKind, sensor: Sensors, seed: u64) -> Result<Self, MeasureError> {
        let mut config = SimConfig::new(world, seed);
        config.rate_hz = RATE_HZ;
        config.imu = None;
        config.duration_s = Some(WALK_S);
        config.walker.speed = 1.1;
        config.options.detail = 0.6;
        config.sensor = simulated(sensor);
        let mut source = SimSource::new(&config)?;
        let rig = source.rig().clone();
        let mut engine =
            Engine::new(&rig, sensor.mode(), RATE_HZ, Runner::Lockstep, &Config::default(), &std_host())?;
        while let Some(packet) = source.next_packet()? {
            engine.on_packet(&packet)?;
        }
        engine.finish();
        let truth: BTreeMap<Stamp, Se3> = engine.comparable(&source.info().truth).into_iter().collect();
        let pairs = engine
            .trajectory()
            .into_iter()
            .filter_map(|(t, p)| Some((truth.get(&t)?.translation, p.translation)));
        let (target, from): (Vec<Vec3>, Vec<Vec3>) = pairs.unzip();
        let true_from_map = umeyama(&target, &from, sensor == Sensors::Mono)
            .map_err(|e| format!("nothing was mapped: {e}"))?;
        Ok(Self { config, source, engine, sensor, true_from_map })
    }

    /// Starts again at `share` of the path, beside it and looking to the side, with image gamma `gamma`.
    ///
    /// # Errors
    /// When the walk cannot be rendered.
    pub fn start(
        &self,
        share: f64,
        beside_m: f64,
        aside_deg: f64,
        gamma: f64,
    ) -> Result<Option<Start>, MeasureError> {
        let truth = &self.source.info().truth;
        let frames = (SOON_S * RATE_HZ) as usize + 1;
        let first = (share * truth.len().saturating_sub(frames) as f64) as usize;
        // In the camera frame right is +x; in the world frame up is +z.
        let turn = So3::exp(&Vec3::new(0.0, 0.0, aside_deg.to_radians()));
        let poses: Vec<(Stamp, Se3)> = truth[first..(first + frames).min(truth.len())]
            .iter()
            .map(|(t, p)| {
                (*t, Se3::new(turn * p.rotation, p.translation + p.rotation * Vec3::new(beside_m, 0.0, 0.0)))
            })
            .collect();
        // Poses inside walls or furniture are skipped.
        if !poses.iter().all(|(_, p)| self.source.world().clearance(p.translation.x, p.translation.y) > 0.25)
        {
            return Ok(None);
        }
        let mut config = self.config.clone();
        config.route = CameraPath::Poses(poses);
        config.duration_s = None;
        let mut source = SimSource::in_world(&config, self.source.world().clone())?;
        let file = self.engine.to_save("bench", BTreeMap::new());
        let rig = source.rig().clone();
        let (engine, _) = Engine::in_map(
            &rig,
            self.sensor.mode(),
            RATE_HZ,
            Runner::Lockstep,
            &Config::default(),
            &std_host(),
            &file,
        )?;
        let mut engine = engine.localize_only();
        let truth: BTreeMap<Stamp, Se3> = engine.comparable(&source.info().truth).into_iter().collect();
        let gamma_table: Vec<u8> =
            (0..=255u8).map(|v| (255.0 * (f64::from(v) / 255.0).powf(gamma)) as u8).collect();
        let mut outcome = Start { beside_m, aside_deg, known_s: None, wrong: 0 };
        let mut began = None;
        while let Some(mut packet) = source.next_packet()? {
            let began = *began.get_or_insert(packet.stamp);
            for image in &mut packet.images {
                std::sync::Arc::make_mut(image)
                    .data_mut()
                    .iter_mut()
                    .for_each(|v| *v = gamma_table[usize::from(*v)]);
            }
            let out = engine.on_packet(&packet)?;
            let (Some(pose), Some(truth)) = (out.world_from_body(), truth.get(&packet.stamp)) else {
                continue;
            };
            let off = (self.true_from_map * pose.se3.translation - truth.translation).norm();
            match off < RIGHT_M {
                true => outcome.known_s = outcome.known_s.or(Some(packet.stamp - began)),
                false => outcome.wrong += 1,
            }
        }
        Ok(Some(outcome))
    }
}

/// All starts of a day: ordinary ones half a metre beside the path, and a grid of distances and angles.
///
/// # Errors
/// As [`Day::start`].
fn starts(day: &Day, seed: u64, ordinary: usize, each: usize) -> Result<Vec<Start>, MeasureError> {
    let mut rng = Random::stream(seed, 77);
    let mut found = Vec::new();
    let mut go = |beside: f64, aside: f64, wanted: usize| -> Result<(), MeasureError> {
        let mut done = 0;
        // Where there is no room beside the path, another place is tried.
        for _ in 0..10 * wanted {
            if done == wanted {
                break;
            }
            let side = if rng.unit() < 0.5 { -1.0 } else { 1.0 };
            let (share, gamma) = (rng.unit(), (0.35 * rng.uniform(-1.0, 1.0)).exp());
            if let Some(start) =
                day.start(share, side * beside, aside * if rng.unit() < 0.5 { -1.0 } else { 1.0 }, gamma)?
            {
                found.push(Start { beside_m: beside, aside_deg: aside, ..start });
                done += 1;
            }
        }
        Ok(())
    };
    go(0.5, 0.0, ordinary)?;
    for beside in BESIDE_M {
        for aside in ASIDE_DEG {
            go(beside, aside, each)?;
        }
    }
    Ok(found)
}

/// The tables of each sensor, over so many seeds; progress on stderr.
///
/// # Errors
/// As [`Day::walk`] and [`Day::start`].
pub fn tables(seeds: u64, sensors: &[Sensors], ordinary: usize, each: usize) -> Result<String, MeasureError> {
    let mut out = String::new();
    for sensor in sensors {
        let mut all = Vec::new();
        for seed in 1..=seeds {
            let world = WORLDS[seed as usize % WORLDS.len()];
            let found = starts(&Day::walk(world, *sensor, seed)?, seed, ordinary, each)?;
            eprintln!("{world} seed {seed} {}:\n{}", sensor.name(), table(&found));
            all.extend(found);
        }
        let _ = writeln!(out, "{}:\n{}", sensor.name(), table(&all));
    }
    Ok(out)
}

/// Recall within two seconds, by distance and angle.
fn table(starts: &[Start]) -> String {
    let mut t = String::from("| beside the path |");
    // Writing to a string cannot fail.
    ASIDE_DEG.iter().for_each(|a| {
        let _ = write!(t, " {a:.0} deg |");
    });
    t.push_str("\n|---|---|---|---|---|---|\n");
    for beside in BESIDE_M {
        let _ = write!(t, "| {beside:.1} m |");
        for aside in ASIDE_DEG {
            let of: Vec<&Start> =
                starts.iter().filter(|s| s.beside_m == beside && s.aside_deg == aside).collect();
            let known = of.iter().filter(|s| s.known_s.is_some()).count();
            let _ = match of.len() {
                0 => write!(t, " - |"),
                n => write!(t, " {known} of {n} |"),
            };
        }
        t.push('\n');
    }
    let ordinary: Vec<&Start> = starts.iter().filter(|s| s.beside_m == 0.5 && s.aside_deg == 0.0).collect();
    let known = ordinary.iter().filter(|s| s.known_s.is_some()).count();
    let wrong = starts.iter().filter(|s| s.wrong > 0).count();
    let _ = writeln!(
        t,
        "half a metre beside, different light: {known} of {} starts relocalized within {SOON_S} s; starts with a wrong pose: {wrong} of {}",
        ordinary.len(),
        starts.len()
    );
    t
}
