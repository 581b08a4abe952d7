//! The figures of a run, which the tables of scenarios name by their fields.

use super::carried::Carried;
use super::costs::{Part, Times};
use super::live_scale::LiveScale;
use serde::{Deserialize, Serialize};

/// Result of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Figures {
    /// Number of packets.
    pub frames: usize,
    /// Packets with a pose in the final trajectory.
    pub tracked: usize,
    /// Their share.
    pub coverage: f64,
    /// Stretches of frames without a pose after the first pose: first and last frame.
    pub lost: Vec<[usize; 2]>,
    /// The first frame with a pose.
    pub started: Option<usize>,
    /// Length of the true path, metres.
    pub path_m: f64,
    /// Length of the final trajectory, in metres where the map is metric.
    pub found_m: f64,
    /// The fastest pace over the slowest of each two seconds of it.
    pub pace_ratio: Option<f64>,
    /// Whether the map is metric; then scale is not aligned.
    pub metric: bool,
    /// How poses are aligned: SE3 where the map is metric, else Sim3.
    pub alignment: String,
    /// RMSE of the final trajectory against the ground truth after that alignment, metres.
    pub ate_m: Option<f64>,
    /// The same as a share of the path's length, percent.
    pub drift_percent: Option<f64>,
    /// The same of the live poses, metres.
    pub live_ate_m: Option<f64>,
    /// The same of the final trajectory after SE3 alignment; `None` where the map is not metric.
    pub ate_se3_m: Option<f64>,
    /// The same after Sim3 alignment.
    pub ate_sim3_m: Option<f64>,
    /// Scale by Sim3 alignment, also where the map is metric.
    pub scale: f64,
    /// Percent by which the map is too large.
    pub too_large_percent: f64,
    /// Deviation of that scale from 1, percent; `None` where the map is not metric.
    pub scale_percent: Option<f64>,
    /// Figures of the IMU.
    pub imu: ImuFigures,
    /// Figures of the map.
    pub map: MapFigures,
    /// Times of the run.
    pub times: Times,
    /// Costs of each stretch of the run, where they were asked for.
    pub parts: Vec<Part>,
    /// Where the walker stands still at the end.
    pub still: Option<Still>,
    /// Where the walk has a turn on the spot.
    pub turn: Option<Turn>,
    /// Peak resident memory of this process, megabytes.
    pub peak_mb: Option<f64>,
    /// Hash of all bits of the final trajectory.
    pub hash: u64,
}

/// Figures of a run with an IMU.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ImuFigures {
    /// Seconds from the first frame to the first metric pose.
    pub metric_s: Option<f64>,
    /// The relative standard deviation of the scale that was stated then, and is stated at the end.
    pub sigma: [Option<f64>; 2],
    /// The standard deviation of the logarithm of scale that the first accepted initialisation stated, percent.
    pub first_sigma_percent: Option<f64>,
    /// Estimated time offset to add to the IMU stamps, milliseconds.
    pub offset_ms: f64,
    /// Estimated readout time of the camera's rows and its standard deviation, milliseconds.
    pub readout_ms: [f64; 2],
    /// RMSE of the live poses from the first metric one on, metres.
    pub live_ate_m: Option<f64>,
    /// The scale of the live poses while it was called metric.
    pub live: LiveScale,
    /// The longest stretch in which the motion sensors carried the pose.
    pub carried: Option<Carried>,
    /// Seconds after a fault at which something was first reported of the IMU.
    pub reported_s: Option<f64>,
    /// All that was reported.
    pub reports: Vec<(f64, String)>,
    /// Seconds after a fault at which there was no pose any more.
    pub stopped_s: Option<f64>,
}

/// Figures of the map at the end.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MapFigures {
    /// Number of maps.
    pub maps: usize,
    /// Number of maps that contain final poses.
    pub with_poses: usize,
    /// Maps begun after the first.
    pub resets: usize,
    /// Key frames.
    pub key_frames: usize,
    /// Landmarks.
    pub landmarks: usize,
    /// Loops closed.
    pub loops: usize,
    /// Maps merged.
    pub merges: usize,
    /// Times of loops and merges, seconds after the first frame.
    pub joined_s: Vec<f64>,
    /// Candidates rejected.
    pub refused: usize,
    /// Errors of false loops and merges (more than 0.5 m), metres.
    pub false_joins: Vec<f64>,
    /// The focal length that images are read with, pixels.
    pub focal_px: f64,
}

/// A walker who stands still.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Still {
    /// Movement, metres: live poses, ground truth, and one relative to the other; `None` without poses.
    pub moves_m: Option<[f64; 3]>,
    /// Share of the packets with a live pose.
    pub coverage: f64,
}

/// A walk out, a turn on the spot, and the walk back.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Turn {
    /// Error of the last pose after aligning the walk before the turn with the ground truth, metres: final and live.
    pub end_m: [Option<f64>; 2],
    /// Frames without a live pose from the turn on.
    pub blind: usize,
}
