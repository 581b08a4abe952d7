//! Runs the engine over one source and computes its figures: accuracy, scale, maps, times, and a hash of all bits of the result.

mod accuracy;
mod carried;
mod costs;
mod figures;
mod live_scale;
mod options;
mod pace;
mod record;
mod result;
mod verbose;

pub use accuracy::aligned;
pub use figures::Figures;
pub use live_scale::LiveScale;
pub use options::RunOptions;

use crate::MeasureError;
use crate::error::of;
use cairn_engine::{Engine, SensorMode, Sensors};
use cairn_sensor::{Rig, Source};
use cairn_sim::SimSensor;
use cairn_sources::std_host;
use record::Record;

/// An engine; it uses the rig's IMU if the sensor mode includes it.
fn engine(rig: &Rig, rate_hz: f64, options: &RunOptions) -> Result<Engine, MeasureError> {
    let mut config = options.config.clone();
    config.inertial.enabled = options.sensor.has_imu();
    Ok(Engine::new(rig, options.sensor.mode(), rate_hz, options.runner, &config, &std_host())?)
}

/// What a simulated rig has for these sensors, the IMU left aside.
pub(crate) fn simulated(sensors: Sensors) -> SimSensor {
    match sensors.mode() {
        SensorMode::Mono => SimSensor::Mono,
        SensorMode::Stereo => SimSensor::Stereo,
        SensorMode::Rgbd => SimSensor::Rgbd,
    }
}

/// Runs a source to its end.
///
/// # Errors
/// When the source fails, the rig does not have the sensors, a packet does not fit the rig, or the final map is
/// inconsistent.
pub fn measure(source: &mut dyn Source, options: &RunOptions) -> Result<Figures, MeasureError> {
    let mut engine = engine(source.rig(), source.info().rate_hz, options)?;
    let truth = source.info().truth.clone();
    let mut record = Record::new(&engine, &truth);
    while record.stamps.len() < options.frames {
        let Some(packet) = source.next_packet()? else { break };
        if record.since_first_s(packet.stamp) > options.seconds {
            break;
        }
        record.end_part(packet.stamp, options, &engine);
        let out = engine.on_packet(&packet)?;
        if let Some(cause) = out.stage_failed() {
            let what = format!("frame {}", record.stamps.len());
            return Err(of(what, MeasureError::from(cause.to_owned())));
        }
        record.observe(&packet, &out, &engine, options, &truth)?;
    }
    record.times.map_ms.extend(engine.finish().timings.map_ms);
    engine.snapshot().check()?;
    // The rest counts as a part if it is longer than half of one.
    let rest_s = record.part.step_ms.len() as f64 / source.info().rate_hz;
    if options.parts_s.is_some_and(|seconds| rest_s > 0.5 * seconds) {
        record.close_part(&engine);
    }
    record.figures(&engine, &truth, options)
}
