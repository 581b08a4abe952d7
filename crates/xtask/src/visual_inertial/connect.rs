//! How the trials ask the engine for its inertial sensor: the one place that knows.

use crate::Sensor;
use cairn_engine::{Config, Engine, Runner};
use cairn_sensor::Rig;

/// An engine in lockstep; it uses the rig's inertial sensor where the sensors have one.
///
/// # Errors
/// When the rig does not serve the sensors.
pub fn engine(rig: &Rig, sensor: Sensor, rate_hz: f64, config: &Config) -> Result<Engine, String> {
    let mut config = config.clone();
    config.inertial.enabled = sensor.is_inertial();
    Engine::new(rig, sensor.mode(), rate_hz, Runner::Lockstep, &config).map_err(|e| e.to_string())
}

/// Seconds to add to an IMU stamp to get the image clock, as the engine has found it; 0 where it has found none.
pub fn offset_s(engine: &Engine, sensor: Sensor) -> Option<f64> {
    sensor.is_inertial().then(|| engine.snapshot().imu_offset())
}
