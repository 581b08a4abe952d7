//! `walks`: simulated walks with rendered images. Some have walls with little texture, some motion blur, in some a
//! passer-by crosses the view, depending on the seed.

use crate::MeasureError;
use crate::{Measured, RunOptions, Sensors, measure};
use cairn_random::Random;
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::fmt::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The default worlds.
pub const WORLDS: [WorldKind; 4] =
    [WorldKind::Corridor, WorldKind::Office, WorldKind::Hall, WorldKind::Street];

/// Frames per second.
const RATE_HZ: f64 = 15.0;

/// Configuration of one walk.
#[derive(Clone, Copy, Debug)]
pub struct Walk {
    /// The world.
    pub world: WorldKind,
    /// The sensors.
    pub sensor: Sensors,
    /// Seed of world, noise and difficulties.
    pub seed: u64,
    /// Share of plain walls.
    pub poor: f64,
    /// Number of passers-by.
    pub passers: usize,
    /// Exposure time in milliseconds.
    pub blur_ms: f64,
}

impl Walk {
    /// A walk with the difficulties of its seed: of four, one has none, one plain walls, one a passer-by, one both;
    /// every third is blurred.
    pub fn new(world: WorldKind, sensor: Sensors, seed: u64) -> Self {
        // The worlds alternate with the seeds, so the difficulties depend on the round.
        let round = seed / 4;
        let poor = if round % 2 == 1 { 0.35 } else { 0.0 };
        let passers = (round / 2 % 2) as usize;
        let blur_ms = if round % 3 == 2 { 8.0 } else { 0.0 };
        Self { world, sensor, seed, poor, passers, blur_ms }
    }

    /// The same kind of walk with a seed drawn from a number: world, plain walls, passers-by and blur stay, all else is another.
    pub fn drawn(self, from: u64) -> Self {
        // After 48 seeds worlds and difficulties come again.
        let periods = 1 + Random::stream(from, self.seed).below(1_000_000) as u64;
        Self { seed: self.seed + 48 * periods, ..self }
    }

    /// The source's address for the first `seconds` of the walk.
    pub fn address(&self, seconds: f64) -> String {
        let Self { world, sensor, seed, poor, passers, blur_ms } = self;
        let sensor = sensor.name();
        format!(
            "sim:{world}?seed={seed}&sensor={sensor}&rate={RATE_HZ}&duration={seconds}&poor={poor}&passers={passers}&blur={blur_ms}"
        )
    }

    /// Runs the engine on the walk.
    ///
    /// # Errors
    /// As [`measure()`].
    pub fn run(&self, seconds: f64) -> Result<Measured, MeasureError> {
        let address = self.address(seconds);
        let mut source = open(&address, OpenOptions::default()).map_err(|e| MeasureError::of(&address, e))?;
        measure(source.as_mut(), &RunOptions::new(self.sensor)).map_err(|e| MeasureError::of(&address, e))
    }
}

/// Result of a walk.
#[derive(Clone, Debug, Serialize)]
pub struct Walked {
    /// World.
    pub world: String,
    /// Seed.
    pub seed: u64,
    /// The source's address: `one ADDRESS` repeats the walk.
    pub address: String,
    /// Figures of the run.
    pub measured: Measured,
}

/// Runs all walks, `jobs` in parallel; results in the order of the walks, progress on stderr.
///
/// # Errors
/// The first walk that failed, in order.
pub fn run(walks: &[Walk], seconds: f64, jobs: usize) -> Result<Vec<Walked>, MeasureError> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<Result<Walked, MeasureError>>>> =
        Mutex::new(walks.iter().map(|_| None).collect());
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(walk) = walks.get(i) else { return };
            let address = walk.address(seconds);
            let result = walk.run(seconds);
            match &result {
                Ok(m) => eprintln!("{address}: {}", line(m)),
                Err(e) => eprintln!("{address}: {e}"),
            }
            let walked = result.map(|measured| Walked {
                world: walk.world.to_string(),
                seed: walk.seed,
                address,
                measured,
            });
            if let Ok(mut slots) = results.lock() {
                slots[i] = Some(walked);
            }
        }
    };
    std::thread::scope(|scope| {
        (0..jobs.clamp(1, 64)).for_each(|_| {
            scope.spawn(work);
        });
    });
    let slots = results.into_inner().map_err(|_| MeasureError::Program("a walk panicked".into()))?;
    slots.into_iter().map(|s| s.unwrap_or_else(|| Err("a walk was not run".into()))).collect()
}

/// One walk as a line of text.
pub fn line(m: &Measured) -> String {
    let ate = m.ate_m.map_or("none".into(), |a| format!("{a:.3} m"));
    let drift = m.drift().map_or("none".into(), |d| format!("{:.2} %", 100.0 * d));
    format!(
        "ATE {ate} of {:.1} m ({drift}), coverage {:.3}, lost {:?}, from {:?}, scale {:.3}, step {:.1} ms, {} key frames, {} landmarks, {} maps, {} loops, {} merges, {} rejected, false {:?}",
        m.path_m,
        m.coverage(),
        m.lost,
        m.started,
        m.scale,
        m.step_ms.p50,
        m.key_frames,
        m.landmarks,
        m.worlds,
        m.loops,
        m.merges,
        m.refused,
        m.false_joins
    )
}

/// Drift and coverage by world and sensor: minimum, median and maximum.
pub fn table(walked: &[Walked]) -> String {
    let mut t = String::from(
        "| world | sensor | walks | ATE % of path length: min / median / max | coverage: min / median | tracking lost temporarily |\n|---|---|---|---|---|---|\n",
    );
    let mut groups: Vec<(String, Sensors)> = Vec::new();
    for w in walked {
        let key = (w.world.clone(), w.measured.sensor);
        if !groups.contains(&key) {
            groups.push(key);
        }
    }
    for sensor in Sensors::VISUAL {
        groups.push(("all".into(), sensor));
    }
    for (world, sensor) in groups {
        let of: Vec<&Measured> = walked
            .iter()
            .filter(|w| (w.world == world || world == "all") && w.measured.sensor == sensor)
            .map(|w| &w.measured)
            .collect();
        if of.is_empty() {
            continue;
        }
        let mut drift: Vec<f64> = of.iter().map(|m| m.drift().map_or(f64::INFINITY, |d| 100.0 * d)).collect();
        let mut coverage: Vec<f64> = of.iter().map(|m| m.coverage()).collect();
        drift.sort_by(f64::total_cmp);
        coverage.sort_by(f64::total_cmp);
        let lost = of.iter().filter(|m| !m.lost.is_empty()).count();
        let _ = writeln!(
            t,
            "| {world} | {} | {} | {:.2} / {:.2} / {:.2} | {:.3} / {:.3} | {lost} |",
            sensor.name(),
            of.len(),
            drift[0],
            drift[drift.len() / 2],
            drift[drift.len() - 1],
            coverage[0],
            coverage[coverage.len() / 2],
        );
    }
    t
}

/// The same walks with fixed and with drawn seeds, by world and sensor: a row whose median is better on the fixed seeds by more than a
/// fifth is marked, since something may have been fitted to them.
pub fn compared(fixed: &[Walked], drawn: &[Walked]) -> String {
    let mut t = String::from(
        "| world | sensor | walks | ATE % of path length, fixed seeds: median / max | drawn seeds: median / max | least coverage, fixed / drawn | better on fixed seeds by over 20 % |\n|---|---|---|---|---|---|---|\n",
    );
    let mut groups: Vec<(&str, Sensors)> =
        fixed.iter().map(|w| (w.world.as_str(), w.measured.sensor)).collect();
    groups.sort_by_key(|(world, sensor)| (*world, sensor.name()));
    groups.dedup();
    for sensor in Sensors::VISUAL {
        groups.extend(groups.iter().any(|g| g.1 == sensor).then_some(("all", sensor)));
    }
    for (world, sensor) in groups {
        let of = |walks: &[Walked]| -> Vec<(f64, f64)> {
            let here = |w: &&Walked| (w.world == world || world == "all") && w.measured.sensor == sensor;
            let drift = |w: &Walked| w.measured.drift().map_or(f64::INFINITY, |d| 100.0 * d);
            let mut all: Vec<(f64, f64)> =
                walks.iter().filter(here).map(|w| (drift(w), w.measured.coverage())).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            all
        };
        let [fixed, drawn] = [of(fixed), of(drawn)].map(|all| {
            let coverage = all.iter().map(|w| w.1).fold(1.0, f64::min);
            (all[all.len() / 2].0, all[all.len() - 1].0, coverage, all.len())
        });
        let mark = if drawn.0 > 1.2 * fixed.0 { "**yes**" } else { "no" };
        let _ = writeln!(
            t,
            "| {world} | {} | {} | {:.2} / {:.2} | {:.2} / {:.2} | {:.3} / {:.3} | {mark} |",
            sensor.name(),
            fixed.3,
            fixed.0,
            fixed.1,
            drawn.0,
            drawn.1,
            fixed.2,
            drawn.2
        );
    }
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_cover_every_difficulty_in_every_world() {
        let walks: Vec<Walk> = (0..24).map(|s| Walk::new(WORLDS[s % 4], Sensors::Mono, s as u64)).collect();
        for world in WORLDS {
            let here: Vec<&Walk> = walks.iter().filter(|w| w.world == world).collect();
            assert!(here.iter().any(|w| w.poor > 0.0 && w.passers == 0));
            assert!(here.iter().any(|w| w.passers > 0));
            assert!(here.iter().any(|w| w.blur_ms > 0.0));
            assert!(here.iter().any(|w| w.poor == 0.0 && w.passers == 0 && w.blur_ms == 0.0));
        }
    }

    #[test]
    fn a_drawn_walk_is_of_the_same_kind_and_another() {
        for seed in 0..48 {
            let walk = Walk::new(WORLDS[seed as usize % 4], Sensors::Mono, seed);
            let other = walk.drawn(20_261_129);
            assert!(other.seed >= 48 && other.seed != walk.drawn(20_261_130).seed);
            let same = Walk::new(WORLDS[other.seed as usize % 4], Sensors::Mono, other.seed);
            let kind = |w: &Walk| (w.world, w.poor.to_bits(), w.passers, w.blur_ms.to_bits());
            assert_eq!((kind(&same), kind(&other)), (kind(&walk), kind(&walk)));
        }
    }
}
