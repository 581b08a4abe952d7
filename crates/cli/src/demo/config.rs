//! The configuration of one demo: the world, the camera, the walker.

use crate::speaking::Speaking;
use cairn_engine::SensorMode;
use cairn_engine::Sensors;
use cairn_geometry::{Se3, Vec2};
use cairn_guide::Facing;
use cairn_sensor::Camera;
use cairn_sim::{ImuConfig, SimConfig, SimSensor, Walker, WorldKind};
use cairn_trial::way::Body;

/// Frames per second.
const RATE_HZ: f64 = 20.0;

/// One demo.
#[derive(Clone, Debug)]
pub struct DemoConfig {
    /// The world and its sensors.
    pub sim: SimConfig,
    /// The sensors that the engine uses.
    pub sensor: Sensors,
    /// How the walker faces on the return.
    pub facing: Facing,
    /// Metres of the route that are walked; `None` for all of it.
    pub metres: Option<f64>,
    /// Seed of the world, the sensor noise and the walker.
    pub seed: u64,
    /// How many things are put into the way after the route was recorded.
    pub obstacles: usize,
    /// Whether surfaces are made of the depth.
    pub dense: bool,
    /// How Cairn speaks; the walker understands that language.
    pub speaking: Speaking,
}

impl DemoConfig {
    /// The demo with a given seed. The body frame is the camera's: on the chest at 1.3 m, pitched 5 degrees down.
    pub fn new(seed: u64, facing: Facing, sensor: Sensors, metres: Option<f64>, speaking: Speaking) -> Self {
        let sim = SimConfig {
            sensor: match sensor.mode() {
                SensorMode::Mono => SimSensor::Mono,
                SensorMode::Stereo => SimSensor::Stereo,
                SensorMode::Rgbd => SimSensor::Rgbd,
            },
            imu: sensor.has_imu().then(ImuConfig::default),
            camera: Camera::pinhole(480, 360, 315.0, 315.0, 239.5, 179.5),
            rate_hz: RATE_HZ,
            body_from_camera: Se3::identity(),
            // A blind walker turns corners slowly.
            walker: Walker { turn_rate: 0.8, ..Walker::default() },
            ..SimConfig::new(WorldKind::Demo, seed)
        };
        Self { sim, sensor, facing, metres, seed, obstacles: 0, dense: false, speaking }
    }

    /// The walker, standing at a place (metres) with a heading (radians).
    pub fn body(&self, place: Vec2, heading: f64) -> Body {
        Body::new(self.walker((place.x, place.y, heading)), self.sim.walker.clone())
    }

    /// Who goes by words, at a place (metres) with a heading (radians).
    pub fn walker(&self, at: (f64, f64, f64)) -> cairn_trial::Walker {
        cairn_trial::Walker::new(self.seed, at)
            .with_language(self.speaking.language)
            .with_speech_rate(self.speaking.announcer().rate)
    }

    /// The name of the source, written into the route's file.
    pub fn source(&self) -> String {
        format!("sim:{}?seed={}", self.sim.world, self.seed)
    }

    /// Seconds between frames.
    pub fn step_s(&self) -> f64 {
        1.0 / self.sim.rate_hz
    }
}

/// The facing as spelled on the command line.
pub fn facing_name(facing: Facing) -> &'static str {
    match facing {
        Facing::Home => "home",
        Facing::Back => "back",
        Facing::Backwards => "backwards",
    }
}
