//! Status of a run over time: the part of the report about phases and the inertial sensor.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Phases, relocalisations and the inertial sensor of a run. Times are seconds of the source's clock since its first
/// frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StatusSummary {
    /// Seconds in each phase that occurred, by its name in capitals: each frame counts until the next frame.
    pub seconds: BTreeMap<String, f64>,
    /// Time of the first pose with metric scale; `None` without one.
    pub first_metric_pose_s: Option<f64>,
    /// Number of relocalisations in an existing map.
    pub found: usize,
    /// The inertial sensor, if it was used.
    pub imu: Option<ImuSummary>,
}

/// Status of the inertial sensor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuSummary {
    /// Samples synthesised because no real one had arrived in time.
    pub synthesised: usize,
    /// Gaps of more than two and a half periods between samples.
    pub gaps: usize,
    /// Longest gap, seconds.
    pub longest_gap_s: f64,
    /// Samples left out one by one: beyond what any sensor measures.
    #[serde(default)]
    pub refused: usize,
    /// Times in which the samples were not used, in order.
    #[serde(default)]
    pub faults: Vec<ImuFaultSummary>,
    /// True when scale and gravity were known at the last pose (inertial initialisation was complete).
    pub initialised: bool,
    /// The checks of the last attempt of inertial initialisation, passed and failed.
    pub gates: Vec<GateSummary>,
}

/// A time in which the samples of the inertial sensor were not used: poses were those of the camera alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuFaultSummary {
    /// Time of the first wrong sample.
    pub from_s: f64,
    /// Time from which on samples were used again; `None` if not before the end.
    pub until_s: Option<f64>,
    /// What was wrong when it was noticed, as text with numbers and units.
    pub words: String,
}

/// A check of an attempt of inertial initialisation (estimation of scale and gravity).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GateSummary {
    /// What was checked, as text with numbers and units.
    pub words: String,
    /// Measured value; `None` if not finite.
    pub value: Option<f64>,
    /// Required bound.
    pub bound: f64,
    /// True when the check passed.
    pub passed: bool,
}
