//! What every run of the engine over a source has in common: its engine, its next frame, and poses against the truth.

use crate::{MeasureError, Sensors};
use cairn_engine::{Config, Engine, Output, Runner, SensorMode};
use cairn_eval::{Align, EvalOptions, Evaluation, evaluate};
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::{FramePacket, Rig, Source, Stamp};
use cairn_sim::SimSensor;
use cairn_sources::std_host;

/// An engine; it uses the rig's IMU if the sensor mode includes it.
///
/// # Errors
/// When the rig does not have the sensors.
pub(crate) fn engine(
    rig: &Rig,
    sensor: Sensors,
    rate_hz: f64,
    runner: Runner,
    config: &Config,
) -> Result<Engine, MeasureError> {
    let mut config = config.clone();
    config.inertial.enabled = sensor.has_imu();
    Ok(Engine::new(rig, sensor.mode(), rate_hz, runner, &config, &std_host())?)
}

/// What a simulated rig has for these sensors, the IMU left aside.
pub(crate) fn simulated(sensors: Sensors) -> SimSensor {
    match sensors.mode() {
        SensorMode::Mono => SimSensor::Mono,
        SensorMode::Stereo => SimSensor::Stereo,
        SensorMode::Rgbd => SimSensor::Rgbd,
    }
}

/// Tracks the next packet of a source, the `number`th; `None` at its end.
///
/// # Errors
/// When the source or a stage fails, or the packet does not fit the rig.
pub(crate) fn step(
    source: &mut dyn Source,
    engine: &mut Engine,
    number: usize,
) -> Result<Option<(FramePacket, Output)>, MeasureError> {
    let Some(packet) = source.next_packet()? else { return Ok(None) };
    let out = engine.on_packet(&packet)?;
    match out.stage_failed() {
        Some(cause) => {
            Err(MeasureError::of(format!("frame {number}"), MeasureError::Stage(cause.to_owned())))
        }
        None => Ok(Some((packet, out))),
    }
}

/// Poses after alignment with the truth; `None` with too few of them.
///
/// # Errors
/// When the times of one of them do not increase.
pub(crate) fn aligned(
    truth: &[(Stamp, Se3)],
    poses: &[(Stamp, Se3)],
    align: Align,
) -> Result<Option<Evaluation>, MeasureError> {
    let trajectory =
        |poses: &[(Stamp, Se3)]| Trajectory::from_unsorted(poses.iter().map(|(t, p)| (t.0, *p)).collect());
    let options = EvalOptions { align, ..EvalOptions::default() };
    Ok(evaluate(&trajectory(truth)?, &trajectory(poses)?, &options).ok())
}
