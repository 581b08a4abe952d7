//! Creates the engine of the trials with or without IMU.

use crate::MeasureError;
use crate::Sensor;
use cairn_engine::{Config, Engine, Runner};
use cairn_sensor::Rig;

/// An engine; it uses the rig's IMU if the sensor mode includes it.
///
/// # Errors
/// When the rig does not have the sensors.
pub fn engine(
    rig: &Rig,
    sensor: Sensor,
    rate_hz: f64,
    runner: Runner,
    config: &Config,
) -> Result<Engine, MeasureError> {
    let mut config = config.clone();
    config.inertial.enabled = sensor.is_inertial();
    Ok(Engine::new(rig, sensor.mode(), rate_hz, runner, &config)?)
}

/// Seconds to add to an IMU stamp to get the image clock, as estimated by the engine (0 if it estimated none); `None`
/// without IMU.
pub fn offset_s(engine: &Engine, sensor: Sensor) -> Option<f64> {
    sensor.is_inertial().then(|| engine.snapshot().imu_offset())
}
