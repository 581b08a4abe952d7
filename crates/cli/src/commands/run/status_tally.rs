//! The summary of the status in the report of a run.

use cairn_engine::{Status, StatusEvent};
use cairn_eval::{GateSummary, ImuFaultSummary, ImuSummary, StatusSummary};

/// Accumulates the status of a run, frame by frame.
#[derive(Default)]
pub struct StatusTally {
    summary: StatusSummary,
    last: Option<Status>,
    /// When the readings of the IMU were not used.
    faults: Vec<ImuFaultSummary>,
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
                StatusEvent::ImuFailed { fault } => {
                    let from_s = status.t_s - status.imu.map_or(0.0, |imu| imu.fault_s);
                    self.faults.push(ImuFaultSummary { from_s, until_s: None, words: fault.to_string() });
                }
                StatusEvent::ImuBack { .. } => {
                    self.faults.iter_mut().for_each(|f| f.until_s = f.until_s.or(Some(status.t_s)));
                }
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
            refused: imu.refused,
            faults: self.faults.clone(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_engine::ImuStatus;
    use cairn_inertial::ImuFault;

    #[test]
    fn times_without_the_imu_are_in_the_summary_with_their_beginning_and_end() {
        let mut tally = StatusTally::default();
        let mut at = |t_s: f64, fault_s: f64, event: Option<StatusEvent>| {
            let imu = Some(ImuStatus { refused: 2, fault_s, ..ImuStatus::default() });
            tally.add(Status { t_s, imu, events: event.into_iter().collect(), ..Status::default() });
        };
        let fault = ImuFault::GyroStuck { seconds: 0.1 };
        at(1.0, 0.0, None);
        at(2.0, 0.125, Some(StatusEvent::ImuFailed { fault }));
        at(3.5, 0.0, Some(StatusEvent::ImuBack { after_s: 1.5 }));
        at(5.0, 0.0, Some(StatusEvent::ImuFailed { fault }));
        let imu = tally.summary().imu.expect("an IMU");
        let words = fault.to_string();
        let first = ImuFaultSummary { from_s: 1.875, until_s: Some(3.5), words: words.clone() };
        assert_eq!(imu.faults, [first, ImuFaultSummary { from_s: 5.0, until_s: None, words }]);
        assert_eq!(imu.refused, 2);
    }
}
