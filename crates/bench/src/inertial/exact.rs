//! The scale that the readings of a real motion give with exact poses: a bound on what a camera can achieve on it.

use super::data::links;
use crate::MeasureError;
use crate::source::sim_config;
use cairn_geometry::Se3;
use cairn_inertial::{Bias, ImuBuffer, InitialiseConfig, Scale, Seen, SeenPose, initialise};
use cairn_sensor::{Source, Stamp};
use cairn_sim::{ImuTroubles, SimSource};

/// Seconds between the key frames.
const STEP_S: f64 = 0.25;

/// Deviation of scale from 1, and its standard deviation, percent, on the rendered motion of an address with real readings.
///
/// # Errors
/// When it cannot be simulated, or has no readings.
pub fn exact_scale(address: &str) -> Result<[f64; 2], MeasureError> {
    let (mut config, _) = sim_config(address)?;
    config.troubles = ImuTroubles::default();
    let source = SimSource::new(&config)?;
    let samples = cairn_sources::read_imu(config.readings.ok_or("the walk has no real readings")?)?;
    let mut buffer = ImuBuffer::new(&source.rig().imu.clone().ok_or("the rig has no IMU")?, 0.1);
    buffer.push(&samples);
    let span = source.motion().end() - 1.0;
    let seconds = config.duration_s.unwrap_or(span).min(span);
    let stamps: Vec<Stamp> =
        (0..(seconds / STEP_S) as usize).map(|k| source.epoch().plus_seconds(STEP_S * k as f64)).collect();
    let pose = |t: &Stamp| source.motion().pose(*t - source.epoch());
    let poses: Vec<SeenPose> =
        stamps.iter().map(|t| SeenPose { stamp: *t, world_from_camera: pose(t) }).collect();
    let links = links(&buffer, Bias::default(), &stamps).ok_or("IMU samples are missing")?;
    let seen = Seen { poses: &poses, rotation_sigma: 1e-3, position_sigma: 1e-3 };
    let attempt = initialise(&seen, &links, &Se3::identity(), Scale::Free, &InitialiseConfig::default());
    let found = attempt.found.ok_or("initialisation with exact poses failed")?;
    Ok([100.0 * (found.scale - 1.0).abs(), 100.0 * found.scale_sigma])
}
