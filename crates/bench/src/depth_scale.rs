//! `depth-scale`: the size of the maps that are made with structured light, on simulated walks.

use crate::MeasureError;
use crate::{Measured, RunOptions, Sensors, measure};
use cairn_engine::Config;
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};
use std::fmt::Write;

const WORLDS: [WorldKind; 4] =
    [WorldKind::Office, WorldKind::Hall, WorldKind::Apartment, WorldKind::Corridor];

/// One minute in each of four worlds, for each seed: VGA, 10 Hz, the projector of a Kinect.
///
/// # Errors
/// When a walk cannot be simulated or measured.
pub fn run(seeds: u64, config: &Config) -> Result<Vec<(String, Measured)>, MeasureError> {
    let mut rows = Vec::new();
    for (seed, world) in (1..=seeds).flat_map(|seed| WORLDS.map(|world| (seed, world))) {
        let address = format!("sim:{world}?sensor=rgbd&projector=0.075&seed={seed}&rate=10&duration=60");
        let mut source = open(&address, OpenOptions::default()).map_err(|e| MeasureError::of(&address, e))?;
        let options = RunOptions { config: config.clone(), ..RunOptions::new(Sensors::Rgbd) };
        let measured = measure(source.as_mut(), &options).map_err(|e| MeasureError::of(&address, e))?;
        rows.push((format!("{world} {seed}"), measured));
    }
    Ok(rows)
}

/// Percent by which the map is too large.
fn too_large(m: &Measured) -> f64 {
    (1.0 / m.scale - 1.0) * 100.0
}

/// All walks in a table, then their mean and their worst.
pub fn table(rows: &[(String, Measured)]) -> String {
    let mut t = String::from("| walk | ATE m (SE3) | coverage | map too large % |\n|---|---|---|---|\n");
    for (name, m) in rows {
        let ate = m.ate_m.map_or("-".into(), |v| format!("{v:.4}"));
        // Writing to a string cannot fail.
        let _ = writeln!(t, "| {name} | {ate} | {:.3} | {:.2} |", m.coverage(), too_large(m));
    }
    let n = rows.len().max(1) as f64;
    let ate: f64 = rows.iter().filter_map(|(_, m)| m.ate_m).sum::<f64>() / n;
    let mean: f64 = rows.iter().map(|(_, m)| too_large(m)).sum::<f64>() / n;
    let worst = rows.iter().map(|(_, m)| too_large(m)).fold(f64::NEG_INFINITY, f64::max);
    let _ = writeln!(
        t,
        "\nMean ATE {ate:.4} m; maps too large by {mean:.2} % in the mean, {worst:.2} % at most."
    );
    t
}
