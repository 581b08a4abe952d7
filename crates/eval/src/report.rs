//! The report of a run, which `--report` writes as JSON. The field names are stable; fields may be added.

use crate::error::FileError;
use crate::evaluate::Evaluation;
use crate::percentiles::{Percentiles, Stages};
use crate::status_summary::StatusSummary;
use crate::write::write_whole;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Time and reason of a loss of tracking.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lost {
    /// Time in seconds of the source's clock.
    pub t: f64,
    /// Reason as text.
    pub reason: String,
}

/// How much of the source was left out for one reason.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SkipReport {
    /// What: `frame`, `depth image`, `IMU reading`, `line` or `other`.
    pub what: String,
    /// Why.
    pub reason: String,
    /// How many.
    pub count: usize,
    /// The first of them: where, and exactly why.
    pub first: String,
}

/// A stretch of a run in one unit of length.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScaleReport {
    /// The map whose unit it is, named after its oldest keyframe.
    pub map: usize,
    /// Time of its first and last pose, seconds of the source's clock.
    pub from_s: f64,
    /// As `from_s`.
    pub to_s: f64,
    /// Poses in it.
    pub poses: usize,
    /// Whether lengths are metres.
    pub metric: bool,
    /// Standard deviation of the logarithm of its scale against the first map.
    pub sigma_log: f64,
    /// Where lengths are metres: the standard deviation of the logarithm of metres in a unit, as its map states it at the end.
    #[serde(default)]
    pub metres_sigma_log: Option<f64>,
    /// False where for a part of it the unit of length rested on nothing: a turn on the spot with one camera.
    pub supported: bool,
    /// ATE (RMSE) of this stretch alone, metres: aligned by SE3 where metric, else by Sim3. `None` without ground truth.
    pub ate_m: Option<f64>,
    /// Metres per unit of length by the ground truth: 1 where scale is right. `None` without ground truth.
    pub metres_per_unit: Option<f64>,
    /// Where depth or a baseline gives metres and the IMU contradicts them: metres in a unit by the IMU.
    #[serde(default)]
    pub metres_by_imu: Option<f64>,
}

/// How good the poses were at the time they were given.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LiveReport {
    /// ATE (RMSE) of the live trajectory, metres, with the alignment of the whole run.
    pub ate_m: f64,
    /// By how much the error changes from one pose to the next, metres: 99 of 100 are below this.
    pub jump_p99_m: f64,
    /// The largest such change.
    pub jump_max_m: f64,
    /// Changes of more than 0.1 m.
    pub jumps: usize,
}

/// Results and resource usage of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Program version.
    #[serde(default)]
    pub version: String,
    /// The source, as given.
    pub source: String,
    /// Sensors used: `mono`, `stereo`, `rgbd`, ...
    pub sensor: String,
    /// Frames delivered by the source.
    pub frames: usize,
    /// Frames with a pose.
    pub tracked: usize,
    /// `tracked / frames`; 0 without frames.
    pub coverage: f64,
    /// Frames skipped because they were damaged; they count as frames without a pose.
    #[serde(default)]
    pub skipped: usize,
    /// Everything that was skipped, frames and others, by kind and reason.
    #[serde(default)]
    pub skips: Vec<SkipReport>,
    /// Stretches of the run in one unit of length, in order of time.
    #[serde(default)]
    pub scale: Vec<ScaleReport>,
    /// The trajectory as it was estimated at the time, against the ground truth, if there is one.
    #[serde(default)]
    pub live: Option<LiveReport>,
    /// Losses of tracking.
    pub lost: Vec<Lost>,
    /// Number of new maps started because the place was not recognised. Existing maps are kept.
    pub resets: usize,
    /// Number of maps at the end.
    pub maps: usize,
    /// Frames of a real-time source dropped because processing was too slow; they count as frames without a pose.
    #[serde(default)]
    pub dropped: usize,
    /// Number of keyframes at the end.
    pub keyframes: usize,
    /// Number of landmarks at the end.
    pub landmarks: usize,
    /// Number of loops closed.
    pub loops: usize,
    /// Number of map merges.
    pub merges: usize,
    /// Processing time per frame, from decoded image to pose, in milliseconds; `None` without frames.
    pub ms: Option<Percentiles>,
    /// Processing time of each stage.
    pub stages: Stages,
    /// Peak resident memory in MB of 10^6 bytes; `None` where the system does not report it.
    pub peak_rss_mb: Option<f64>,
    /// Time from process start to the first pose in seconds; `None` without a pose.
    pub first_pose_s: Option<f64>,
    /// Wall-clock time in seconds.
    pub wall_s: f64,
    /// CPU time of all threads in seconds; `None` where the system does not report it.
    pub cpu_s: Option<f64>,
    /// Status over the run: phases, and the inertial sensor.
    #[serde(default)]
    pub standing: StatusSummary,
    /// The complete configuration.
    pub config: serde_json::Value,
    /// Random seed.
    pub seed: u64,
    /// Comparison with the ground truth, if the source has one.
    #[serde(default, skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<Evaluation>,
}

impl RunReport {
    /// Sets `frames`, `tracked` and the resulting coverage.
    pub fn set_frames(&mut self, frames: usize, tracked: usize) {
        (self.frames, self.tracked) = (frames, tracked);
        self.coverage = if frames == 0 { 0.0 } else { tracked as f64 / frames as f64 };
    }

    /// Sets the resource usage of the process so far.
    pub fn set_usage(&mut self, wall_s: f64) {
        self.wall_s = wall_s;
        self.peak_rss_mb = crate::process::peak_rss_mb();
        self.cpu_s = crate::process::cpu_s();
    }

    /// Indented JSON with a final line break.
    pub fn to_json(&self) -> String {
        // Serialisation cannot fail: the type has no maps with keys other than strings.
        serde_json::to_string_pretty(self).map_or_else(|e| format!("{{\"error\": \"{e}\"}}\n"), |s| s + "\n")
    }

    /// Writes the JSON atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        write_whole(path, &self.to_json())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_documented_fields_and_round_trips() {
        let mut report =
            RunReport { source: "a".into(), sensor: "stereo".into(), seed: 7, ..Default::default() };
        report.set_frames(400, 398);
        report.set_usage(3.5);
        report.ms = Percentiles::of(&[1.0, 2.0]);
        report.stages.0.push(("extract".into(), Percentiles { p50: 1.0, p95: 2.0, p99: 3.0, max: 4.0 }));
        report.lost.push(Lost { t: 1.5, reason: "9 inliers, 15 needed".into() });
        report.standing.seconds.insert("TRACKING".into(), 2.5);
        report.config = serde_json::json!({"features": 1000});
        let json = report.to_json();
        let value: serde_json::Value = serde_json::from_str(&json).unwrap();
        for name in [
            "frames",
            "tracked",
            "coverage",
            "lost",
            "resets",
            "maps",
            "keyframes",
            "landmarks",
            "loops",
            "merges",
            "ms",
            "stages",
            "peak_rss_mb",
            "first_pose_s",
            "wall_s",
            "cpu_s",
            "config",
            "seed",
            "source",
            "sensor",
            "skipped",
            "skips",
            "standing",
        ] {
            assert!(value.get(name).is_some(), "{name} is missing");
        }
        assert_eq!(value["coverage"], 0.995);
        assert_eq!(value["stages"]["extract"]["p99"], 3.0);
        assert_eq!(value["lost"][0]["reason"], "9 inliers, 15 needed");
        assert_eq!(serde_json::from_str::<RunReport>(&json).unwrap(), report);
    }
}
