//! EuRoC MH_01: metric accuracy, the first metric pose, standstill at the end; and the cost of the IMU.

use super::ran::{Figures, run};
use crate::MeasureError;
use crate::{RunOptions, Sensors};
use cairn_engine::SensorMode;
use cairn_eval::Percentiles;
use cairn_sources::{OpenOptions, open};
use serde::Serialize;
use std::path::Path;

/// Duration of the standstill at its end, seconds.
const STILL_S: f64 = 5.0;

/// Result for the recording with one sensor mode.
#[derive(Clone, Debug, Serialize)]
pub struct Recorded {
    /// The figures of the run.
    pub figures: Figures,
    /// Movement in the last five seconds, metres: live poses, ground truth, and one relative to the other.
    pub still_m: Option<[f64; 3]>,
}

/// Times with and without IMU.
#[derive(Clone, Debug, Serialize)]
pub struct Cost {
    /// Cameras.
    pub sensor: String,
    /// Image to pose without and with IMU: median of the fastest run, milliseconds.
    pub step_ms: [f64; 2],
    /// The part from features to pose.
    pub track_ms: [f64; 2],
}

fn once(data: &Path, options: &RunOptions) -> Result<Recorded, MeasureError> {
    let folder = data.join("euroc-mh01");
    let mut source = open(&folder.to_string_lossy(), OpenOptions::default())?;
    let ran = run(source.as_mut(), options)?;
    let last = ran.stamps.last().copied().unwrap_or_default();
    let still_m = ran.wanders(last.plus_seconds(-STILL_S), last)?;
    Ok(Recorded { figures: ran.figures("euroc-mh01", options, 0.0)?, still_m })
}

/// Mono and stereo with IMU; empty if the recording is missing.
///
/// # Errors
/// When a run fails.
pub fn measure(data: &Path, options: &[RunOptions]) -> Result<Vec<Recorded>, MeasureError> {
    if !data.join("euroc-mh01").exists() {
        eprintln!("skipped: euroc-mh01 is not in {}", data.display());
        return Ok(Vec::new());
    }
    options.iter().filter(|a| a.sensor.mode() != SensorMode::Rgbd).map(|a| once(data, a)).collect()
}

/// Alternates runs with and without IMU, so that other load on the machine affects both.
///
/// # Errors
/// When a run fails.
pub fn cost(data: &Path, pair: [Sensors; 2], times: usize) -> Result<Option<Cost>, MeasureError> {
    if !data.join("euroc-mh01").exists() {
        return Ok(None);
    }
    let mut best = [[f64::INFINITY; 2]; 2];
    for _ in 0..times.max(1) {
        for (which, sensor) in pair.into_iter().enumerate() {
            let f = once(data, &RunOptions::new(sensor))?.figures;
            let p50 = |p: &Percentiles| p.p50;
            best[0][which] = best[0][which].min(p50(&f.step_ms));
            best[1][which] = best[1][which].min(p50(&f.track_ms));
        }
    }
    Ok(Some(Cost { sensor: pair[0].name().into(), step_ms: best[0], track_ms: best[1] }))
}
