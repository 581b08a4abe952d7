//! The sensors of a rig as a word of the command line.

use cairn_engine::Sensors;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

fn about(sensors: Sensors) -> &'static str {
    match sensors {
        Sensors::Mono => "The first camera only; the scale stays unknown",
        Sensors::Stereo => "The first two cameras",
        Sensors::Rgbd => "The first camera and the depth sensor",
        Sensors::MonoImu => "The first camera and the IMU, which makes scale and gravity known",
        Sensors::StereoImu => "The first two cameras and the IMU",
        Sensors::RgbdImu => "The first camera, the depth sensor and the IMU",
    }
}

/// A parser that lists them all in the help.
pub fn sensors() -> impl TypedValueParser<Value = Sensors> {
    let all = Sensors::VISUAL.into_iter().chain(Sensors::INERTIAL);
    PossibleValuesParser::new(all.map(|s| PossibleValue::new(s.name()).help(about(s))))
        .try_map(|name| name.parse::<Sensors>())
}
