//! Counts and times of a run, frame by frame, and the report of them.

use super::history::History;
use super::outcome::Outcome;
use super::problems;
use super::sink::{Frame, Here, Processed};
use super::status_tally::StatusTally;
use crate::interrupt;
use cairn_atlas::Snapshot;
use cairn_engine::{Joined, Output, State, StatusEvent, Timings, Verdict};
use cairn_eval::{Lost, Percentiles, RunReport, ScaleReport, SkipReport, StageTimes};
use cairn_sensor::{FramePacket, SkipCount, SkipKind, Skipped, Skips};
use cairn_session::{FileConfig, NotTracked};
use std::time::Instant;

/// Counts so far.
pub struct Tally {
    began: Instant,
    /// Frames that are done.
    pub frames: usize,
    /// Frames dropped because the engine was busy.
    pub dropped: usize,
    /// From the start of the process to the first pose.
    first_pose_s: Option<f64>,
    /// Milliseconds from decoded image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    stages: StageTimes,
    pub lost: Vec<Lost>,
    tracking: bool,
    /// Why the last frame has no pose; `None` where it has one.
    pub last_state: Option<String>,
    /// Frames of which feature extraction could make nothing.
    rejected: Skips,
    pub loops: usize,
    pub merges: usize,
    status: StatusTally,
    /// Where the IMU contradicted the unit of length, and metres in one by it.
    contradicted: Vec<(f64, f64)>,
    history: History,
}

impl Tally {
    /// An empty tally; `began` is when the process started.
    pub fn new(began: Instant) -> Self {
        Self {
            began,
            frames: 0,
            dropped: 0,
            first_pose_s: None,
            step_ms: Vec::new(),
            stages: StageTimes::new(),
            lost: Vec::new(),
            tracking: false,
            last_state: None,
            rejected: Skips::default(),
            loops: 0,
            merges: 0,
            status: StatusTally::default(),
            contradicted: Vec::new(),
            history: History::default(),
        }
    }

    /// Adds a frame.
    pub fn frame(&mut self, frame: &Frame) {
        self.frames += 1;
        if frame.has_pose && self.first_pose_s.is_none() {
            self.first_pose_s = Some(self.wall_s());
        }
        let Some(here) = &frame.here else { return };
        match here.output {
            Ok(done) => self.output(here, done),
            Err(why) => self.rejected(here.packet, why),
        }
        let status = here.session.engine_status();
        if let Ok(done) = here.output {
            self.history.events(done.stamp, &status.events);
            self.contradicted.extend(status.events.iter().filter_map(|e| match e {
                StatusEvent::ScaleContradicted { scale, corrected: false, .. } => {
                    Some((done.stamp.seconds(), *scale))
                }
                _ => None,
            }));
        }
        self.status.add(status);
    }

    /// Seconds since the process started.
    fn wall_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn output(&mut self, here: &Processed, done: &Output) {
        self.history.frame(done);
        self.step_ms.push(done.timings.step_ms());
        self.stages.add_ms("decode", here.packet.decode_ms);
        self.stages.add_ms("extract", done.timings.extract_ms);
        self.stages.add_ms("track", done.timings.track_ms);
        self.add_stages(&done.timings, done.verdicts());
        if let Some(cause) = done.stage_failed() {
            self.lost.push(Lost { t: done.stamp.seconds(), reason: cause.to_owned() });
        }
        self.last_state = match done.state {
            State::Tracking | State::Coasting { .. } | State::RotationOnly { .. } => None,
            State::Starting { have, need } => Some(format!("the start has {have} of {need} points")),
            State::Lost { inliers, need } => Some(format!("{inliers} inlier matches, {need} are needed")),
        };
        if let (State::Lost { .. }, true, Some(reason)) = (done.state, self.tracking, &self.last_state) {
            self.lost.push(Lost { t: done.stamp.seconds(), reason: reason.clone() });
        }
        self.tracking = done.pose.is_some();
        if self.history.wants_size(done.stamp) {
            self.history.size(done.stamp, &here.session.engine().snapshot());
        }
    }

    /// Writes into stretches of metres what the IMU says of them, if it contradicts them.
    pub fn contradict_metres(&self, stretches: &mut [ScaleReport]) {
        for s in stretches.iter_mut().filter(|s| s.metric) {
            let here = self.contradicted.iter().rfind(|(t, _)| (s.from_s..=s.to_s).contains(t));
            s.metres_by_imu = here.map(|(_, scale)| *scale);
        }
    }

    /// Adds a frame that feature extraction rejected.
    fn rejected(&mut self, packet: &FramePacket, why: &NotTracked) {
        self.last_state = Some(why.to_string());
        let text = format!("{}: {why}", packet.stamp);
        self.rejected.add(&Skipped::new(SkipKind::Frame, "no features can be extracted", text));
    }

    /// Adds the work done after the last frame, and the size of the map then.
    pub fn after(&mut self, here: &Here) {
        self.history.joins(here.last, here.finished.verdicts());
        self.add_stages(&here.finished.timings, here.finished.verdicts());
        self.history.size(here.last, &here.session.engine().snapshot());
    }

    /// Adds the times of mapping and loop closing, and the loops and merges that were made.
    fn add_stages<'v>(&mut self, timings: &Timings, verdicts: impl Iterator<Item = &'v Verdict>) {
        timings.map_ms.iter().for_each(|ms| self.stages.add_ms("map", *ms));
        timings.close_ms.iter().for_each(|ms| self.stages.add_ms("close", *ms));
        for accepted in verdicts.filter_map(|v| v.result.ok()) {
            match accepted.joined {
                Joined::Loop => self.loops += 1,
                Joined::Merge { .. } => self.merges += 1,
            }
        }
    }

    /// The report of a run that ended with this map and so many poses, without source and sensor, which are not known here,
    /// and without ground truth.
    pub fn report(&self, map: &Snapshot, tracked: usize, config: &FileConfig, skips: &Skips) -> RunReport {
        let skipped = skips.count(SkipKind::Frame);
        let mut report = RunReport {
            version: env!("CARGO_PKG_VERSION").into(),
            skipped: skipped + self.rejected.count(SkipKind::Frame),
            skips: skips.iter().chain(self.rejected.iter()).map(skip_report).collect(),
            dropped: self.dropped,
            lost: self.lost.clone(),
            resets: self.status.resets,
            standing: self.status.summary(),
            maps: map.maps().count(),
            loops: self.loops,
            merges: self.merges,
            keyframes: map.key_frame_count(),
            landmarks: map.landmark_count(),
            ms: Percentiles::of(&self.step_ms),
            stages: self.stages.summary(),
            first_pose_s: self.first_pose_s,
            wall_s: self.wall_s(),
            config: as_printed(config),
            ..RunReport::default()
        };
        report.set_frames(self.frames + self.dropped + skipped, tracked);
        report
    }

    /// What the run came to, with this report; leaves the tally empty.
    pub fn outcome(&mut self, report: RunReport) -> Outcome {
        Outcome {
            interrupted: interrupt::requested(),
            problems: problems::of(&report),
            report,
            searches: None,
            processes: None,
            last_state: self.last_state.take(),
            history: std::mem::take(&mut self.history),
            step_ms: std::mem::take(&mut self.step_ms),
        }
    }
}

/// How much was left out for one reason, as reports have it.
fn skip_report(s: &SkipCount) -> SkipReport {
    SkipReport {
        what: s.kind.name().to_owned(),
        reason: s.reason.clone(),
        count: s.count,
        first: s.first.clone(),
    }
}

/// The configuration as `cairn config --json` prints it: converted through text, so that 0.8 in single precision stays
/// 0.8.
fn as_printed(config: &FileConfig) -> serde_json::Value {
    // Everything in a configuration can be written as JSON.
    let text = serde_json::to_string(config).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}
