//! EuRoC MH_01: metres, the first of them, and standing still at the end; and what the inertial sensor costs.

use super::ran::{Asked, Figures, run};
use crate::Sensor;
use cairn_engine::SensorMode;
use cairn_eval::Percentiles;
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::path::Path;

/// It stands still for so long at its end, seconds.
const STILL_S: f64 = 5.0;

/// The recording with some sensors.
#[derive(Clone, Debug, Serialize)]
pub struct Recorded {
    /// As of every run.
    pub figures: Figures,
    /// In the last five seconds, metres: how far the poses told at the time wander, the truth, and the one from the other.
    pub still_m: Option<[f64; 3]>,
}

/// What tracking takes with the inertial sensor and without.
#[derive(Clone, Debug, Serialize)]
pub struct Cost {
    /// Cameras.
    pub sensor: String,
    /// Without and with: median of the quietest run, milliseconds a frame.
    pub step_ms: [f64; 2],
    /// The part of it from features to pose.
    pub track_ms: [f64; 2],
}

fn once(data: &Path, asked: &Asked) -> Result<Recorded, String> {
    let folder = data.join("euroc-mh01");
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default()).map_err(|e| e.to_string())?;
    let ran = run(source.as_mut(), asked)?;
    let last = ran.stamps.last().copied().unwrap_or_default();
    let still_m = ran.wanders(last.plus_seconds(-STILL_S), last)?;
    Ok(Recorded { figures: ran.figures("euroc-mh01", asked, 0.0)?, still_m })
}

/// Mono and stereo with the inertial sensor; none where the recording is not there.
///
/// # Errors
/// When a run fails.
pub fn measure(data: &Path, asked: &[Asked]) -> Result<Vec<Recorded>, String> {
    if !data.join("euroc-mh01").exists() {
        eprintln!("skipped: euroc-mh01 is not in {}", data.display());
        return Ok(Vec::new());
    }
    asked.iter().filter(|a| a.sensor.mode() != SensorMode::Rgbd).map(|a| once(data, a)).collect()
}

/// Runs with and without take turns, so that whatever else the machine does meets both.
///
/// # Errors
/// When a run fails.
pub fn cost(data: &Path, pair: [Sensor; 2], times: usize) -> Result<Option<Cost>, String> {
    if !data.join("euroc-mh01").exists() {
        return Ok(None);
    }
    let mut best = [[f64::INFINITY; 2]; 2];
    for _ in 0..times.max(1) {
        for (which, sensor) in pair.into_iter().enumerate() {
            let f = once(data, &Asked::new(sensor))?.figures;
            let p50 = |p: &Percentiles| p.p50;
            best[0][which] = best[0][which].min(p50(&f.step_ms));
            best[1][which] = best[1][which].min(p50(&f.track_ms));
        }
    }
    Ok(Some(Cost { sensor: pair[0].name().into(), step_ms: best[0], track_ms: best[1] }))
}
