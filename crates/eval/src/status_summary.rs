//! How a run stood over its time: the part of the report that tells about phases and the inertial sensor.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Phases, worlds and the inertial sensor of a run. Seconds are of the source's clock, from its first frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StatusSummary {
    /// Seconds in each phase that occurred, by its name in capitals: from a frame in that phase to the next frame.
    pub seconds: BTreeMap<String, f64>,
    /// When the first pose came whose lengths are metres; `None` without one.
    pub first_metric_pose_s: Option<f64>,
    /// How often a lost pose was found again in a world that was there before.
    pub found: usize,
    /// The inertial sensor, where it was used.
    pub imu: Option<ImuStanding>,
}

/// What came of the inertial sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuStanding {
    /// Readings made up because no real one had come in time.
    pub synthesised: usize,
    /// Holes of more than two and a half periods between readings.
    pub gaps: usize,
    /// The longest of them, seconds.
    pub longest_gap_s: f64,
    /// Whether scale and gravity were known at the last pose.
    pub initialised: bool,
    /// The tests of the last try to find them, passed and failed.
    pub gates: Vec<GateStanding>,
}

/// A test of a try to find scale and gravity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GateStanding {
    /// What was tested, in words with numbers and units.
    pub words: String,
    /// What was found; `None` where it is no finite number.
    pub value: Option<f64>,
    /// What was asked for.
    pub bound: f64,
    /// Whether it held.
    pub passed: bool,
}
