//! Keeps the status for people.

use super::observer::{DoneFrame, Observer, TrackedFrame};
use crate::output::{Output, StageEvent};
use crate::status::{FrameResult, Status, StatusTracker};
use cairn_inertial::Failed;
use cairn_mapping::Verdict;
use cairn_sensor::FramePacket;

/// The status after the last packet.
pub(crate) struct StatusReport {
    tracker: StatusTracker,
    /// Whether the map may change.
    pub mapping: bool,
    /// Why a stage has failed, now or before.
    stage_failed: Option<String>,
    /// What is wrong with the readings of the IMU at the last frame, and how many were refused so far.
    imu_fault: (Option<Failed>, usize),
}

impl StatusReport {
    pub fn new(tracker: StatusTracker) -> Self {
        Self { tracker, mapping: true, stage_failed: None, imu_fault: (None, 0) }
    }

    pub fn status(&self) -> &Status {
        self.tracker.status()
    }
}

impl Observer for StatusReport {
    fn refused(&mut self, packet: &FramePacket, why: &str) {
        self.tracker.refuse(packet.stamp, &packet.imu, why.to_owned());
    }

    fn tracked(&mut self, frame: &TrackedFrame) {
        self.imu_fault = frame.tracker.imu_fault();
    }

    fn done(&mut self, frame: &mut DoneFrame, output: &mut Output) {
        let failed = output.events.iter().find_map(StageEvent::failed);
        self.stage_failed = self.stage_failed.take().or(failed.map(str::to_owned));
        let verdicts: Vec<Verdict> = output.events.iter().filter_map(StageEvent::verdict).copied().collect();
        self.tracker.update(&FrameResult {
            stamp: output.stamp,
            imu: &frame.packet.imu,
            imu_fault: self.imu_fault,
            state: output.state,
            map: frame.map.map(|map| (map, frame.snapshot.is_gravity_aligned(map))),
            metric: output.is_metric(),
            map_created: frame.map_created.is_some(),
            others: frame.snapshot.maps().nth(1).is_some(),
            points: output.evidence.inliers,
            attempt: output.events.iter().find_map(StageEvent::attempt),
            scale_check: output.events.iter().find_map(StageEvent::scale_check).copied(),
            verdicts: &verdicts,
            stage_failed: self.stage_failed.as_deref(),
            mapping: self.mapping,
        });
        output.status = self.tracker.status().clone();
    }

    fn failed(&mut self, why: &str) {
        self.stage_failed.get_or_insert_with(|| why.to_owned());
    }
}
