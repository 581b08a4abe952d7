//! The report of a run: what `--report` writes as JSON. The names are a contract; fields may be added.

use crate::error::FileError;
use crate::evaluate::Evaluation;
use crate::percentiles::{Percentiles, Stages};
use crate::status_summary::StatusSummary;
use crate::write::write_whole;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// When and why tracking was lost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lost {
    /// Time in seconds of the source's clock.
    pub t: f64,
    /// Reason in words.
    pub reason: String,
}

/// What a run did and what it cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Version of the program.
    #[serde(default)]
    pub version: String,
    /// The source, as given.
    pub source: String,
    /// Sensors used: `mono`, `stereo`, `rgbd`, ...
    pub sensor: String,
    /// Frames that the source gave.
    pub frames: usize,
    /// Frames that got a pose.
    pub tracked: usize,
    /// `tracked / frames`; 0 without frames.
    pub coverage: f64,
    /// Packets left out because they were damaged.
    #[serde(default)]
    pub skipped: usize,
    /// When tracking was lost.
    pub lost: Vec<Lost>,
    /// How often a world was begun beside those there were, since the place was not recognised. Nothing was thrown away.
    pub resets: usize,
    /// Maps at the end.
    pub maps: usize,
    /// Frames that a source in real time gave but nobody had time for; they count as frames without a pose.
    #[serde(default)]
    pub dropped: usize,
    /// Key frames at the end.
    pub keyframes: usize,
    /// Landmarks at the end.
    pub landmarks: usize,
    /// Loops closed.
    pub loops: usize,
    /// Maps merged.
    pub merges: usize,
    /// The whole step per frame, decoded image to pose, in milliseconds; `None` without frames.
    pub ms: Option<Percentiles>,
    /// The same for each stage.
    pub stages: Stages,
    /// Greatest resident memory in MB of 10^6 bytes; `None` where the system does not say.
    pub peak_rss_mb: Option<f64>,
    /// Seconds of the process from its start to the first pose; `None` without one.
    pub first_pose_s: Option<f64>,
    /// Seconds in all.
    pub wall_s: f64,
    /// Processor seconds of all threads; `None` where the system does not say.
    pub cpu_s: Option<f64>,
    /// How it stood over its time: phases, and the inertial sensor.
    #[serde(default)]
    pub standing: StatusSummary,
    /// The whole configuration.
    pub config: serde_json::Value,
    /// Seed of everything random.
    pub seed: u64,
    /// Comparison with the truth, where the source has one.
    #[serde(default, skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<Evaluation>,
}

impl RunReport {
    /// Sets `frames`, `tracked` and the coverage that follows.
    pub fn set_frames(&mut self, frames: usize, tracked: usize) {
        (self.frames, self.tracked) = (frames, tracked);
        self.coverage = if frames == 0 { 0.0 } else { tracked as f64 / frames as f64 };
    }

    /// Fills in what the process has used so far.
    pub fn set_usage(&mut self, wall_s: f64) {
        self.wall_s = wall_s;
        self.peak_rss_mb = crate::process::peak_rss_mb();
        self.cpu_s = crate::process::cpu_s();
    }

    /// As JSON, indented, with a line end.
    pub fn to_json(&self) -> String {
        // The type holds nothing that JSON cannot: no maps with other keys than text.
        serde_json::to_string_pretty(self).map_or_else(|e| format!("{{\"error\": \"{e}\"}}\n"), |s| s + "\n")
    }

    /// Writes the JSON, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<(), FileError> {
        write_whole(path, &self.to_json())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_contracts_names_and_comes_back() {
        let mut report =
            RunReport { source: "a".into(), sensor: "stereo".into(), seed: 7, ..Default::default() };
        report.set_frames(400, 398);
        report.set_usage(3.5);
        report.ms = Percentiles::of(&[1.0, 2.0]);
        report.stages.0.push(("see".into(), Percentiles { p50: 1.0, p95: 2.0, p99: 3.0, max: 4.0 }));
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
            "standing",
        ] {
            assert!(value.get(name).is_some(), "{name} is missing");
        }
        assert_eq!(value["coverage"], 0.995);
        assert_eq!(value["stages"]["see"]["p99"], 3.0);
        assert_eq!(value["lost"][0]["reason"], "9 inliers, 15 needed");
        assert_eq!(serde_json::from_str::<RunReport>(&json).unwrap(), report);
    }
}
