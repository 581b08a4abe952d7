//! The summary of the status in the report of a run.

use cairn_engine::{Status, StatusEvent};
use cairn_eval::{GateSummary, ImuSummary, StatusSummary};

/// Accumulates the status of a run, frame by frame.
#[derive(Default)]
pub struct StatusTally {
    summary: StatusSummary,
    last: Option<Status>,
    /// Maps started after the first one.
    pub resets: usize,
}

impl StatusTally {
    /// Adds the status after a frame.
    pub fn add(&mut self, status: Status) {
        if let Some(last) = &self.last {
            let seconds = self.summary.seconds.entry(last.phase.name().to_owned()).or_default();
            *seconds += status.t_s - last.t_s;
        }
        if status.valid && status.metric {
            self.summary.first_metric_pose_s.get_or_insert(status.t_s);
        }
        for event in &status.events {
            match event {
                StatusEvent::MapCreated { others: true, .. } => self.resets += 1,
                StatusEvent::Relocalised { .. } => self.summary.found += 1,
                _ => {}
            }
        }
        self.last = Some(status);
    }

    /// The summary for the report.
    pub fn summary(&self) -> StatusSummary {
        let imu = self.last.as_ref().and_then(|s| Some((s, s.imu?))).map(|(s, imu)| ImuSummary {
            synthesised: imu.synthesised,
            gaps: imu.gaps,
            longest_gap_s: imu.longest_gap_s,
            initialised: s.initialised,
            gates: s.gates.iter().map(gate).collect(),
        });
        StatusSummary { imu, ..self.summary.clone() }
    }
}

fn gate(gate: &cairn_engine::Gate) -> GateSummary {
    GateSummary {
        words: gate.to_string(),
        value: Some(gate.value).filter(|v| v.is_finite()),
        bound: gate.bound,
        passed: gate.passed,
    }
}
