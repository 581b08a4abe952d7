//! Derives the status from the result of each packet.

use super::{ImuStatus, Phase, Status, StatusEvent, Wait};
use cairn_atlas::{MapId, Snapshot};
use cairn_inertial::{Attempt, Failed, GateKind};
use cairn_mapping::{Joined, ScaleCheck, ScaleVerdict, Verdict};
use cairn_sensor::{ImuSample, Stamp};
use cairn_tracking::State;

/// Readings are missing when none has arrived for so long, seconds.
const SILENT_S: f64 = 0.5;
/// A gap is longer than so many periods, as in [`cairn_sensor::ImuGap`].
const GAP_PERIODS: f64 = 2.5;

/// The result of a packet.
pub(crate) struct FrameResult<'a> {
    pub stamp: Stamp,
    pub imu: &'a [ImuSample],
    /// What is wrong with the readings, and how many were left out.
    pub imu_fault: (Option<Failed>, usize),
    pub state: State,
    /// The map of the pose, if there is one, and whether its scale and gravity are known.
    pub map: Option<(MapId, bool)>,
    pub metric: bool,
    /// Whether a map is created here, and whether there are others.
    pub map_created: bool,
    pub others: bool,
    pub points: usize,
    pub attempt: Option<&'a Attempt>,
    pub scale_check: Option<ScaleCheck>,
    pub verdicts: &'a [Verdict],
    /// Why a stage has failed, now or before.
    pub stage_failed: Option<&'a str>,
    /// Whether the map may change.
    pub mapping: bool,
}

/// Tracks the status over the packets.
#[derive(Debug)]
pub(crate) struct StatusTracker {
    status: Status,
    depth: bool,
    /// Seconds between readings, where the IMU is used.
    period_s: Option<f64>,
    first: Option<Stamp>,
    /// The newest real reading.
    reading: Option<Stamp>,
    /// Time at which tracking was lost.
    lost: Option<Stamp>,
}

impl StatusTracker {
    /// The status before the first packet. `depth`: one frame is enough to start a map.
    pub fn new(depth: bool, period_s: Option<f64>, snapshot: &Snapshot) -> Self {
        let imu = period_s.map(|_| ImuStatus::default());
        let metric = depth
            || snapshot.maps().next().is_some()
                && snapshot.maps().all(|(w, _)| snapshot.is_gravity_aligned(w));
        let status = Status { phase: Phase::WaitFrames, imu, metric, ..Status::default() };
        Self { status, depth, period_s, first: None, reading: None, lost: None }
    }

    pub fn status(&self) -> &Status {
        &self.status
    }

    /// Reports a packet that the front end refused.
    pub fn refuse(&mut self, stamp: Stamp, imu: &[ImuSample], why: String) {
        self.update_readings(stamp, imu);
        let s = &mut self.status;
        (s.phase, s.valid, s.points, s.error) = (Phase::Error, false, 0, Some(why));
        s.waits.clear();
    }

    /// Updates the status with the result of a packet.
    pub fn update(&mut self, result: &FrameResult) {
        self.update_readings(result.stamp, result.imu);
        self.update_fault(result);
        self.update_map(result);
        self.collect_events(result);
        let (phase, waits) = self.phase_and_waits(result);
        let error = result.stage_failed.map(str::to_owned);
        self.status = Status { phase, waits, error, ..std::mem::take(&mut self.status) };
    }

    /// Updates time and readings.
    fn update_readings(&mut self, stamp: Stamp, imu: &[ImuSample]) {
        let s = &mut self.status;
        s.t_s = stamp - *self.first.get_or_insert(stamp);
        s.frames += 1;
        s.events.clear();
        let (Some(status), Some(period_s)) = (&mut s.imu, self.period_s) else { return };
        status.batch = imu.len();
        for sample in imu {
            if sample.is_synthesised() {
                status.synthesised += 1;
                continue;
            }
            let gap_s = self.reading.map_or(0.0, |before| sample.stamp - before);
            if gap_s > GAP_PERIODS * period_s {
                status.gaps += 1;
                status.longest_gap_s = status.longest_gap_s.max(gap_s);
            }
            self.reading = self.reading.max(Some(sample.stamp));
        }
        status.lag_ms = self.reading.map(|newest| (stamp - newest) * 1e3);
    }

    /// Updates what is wrong with the readings.
    fn update_fault(&mut self, result: &FrameResult) {
        let s = &mut self.status;
        let Some(status) = &mut s.imu else { return };
        let (failed, refused) = result.imu_fault;
        let event = match (status.fault, failed) {
            (None, Some(Failed { fault, .. })) => Some(StatusEvent::ImuFailed { fault }),
            (Some(_), None) => Some(StatusEvent::ImuBack { after_s: status.fault_s }),
            _ => None,
        };
        s.events.extend(event);
        status.refused = refused;
        status.fault = failed.map(|failed| failed.fault);
        status.fault_s = failed.map_or(0.0, |failed| result.stamp - failed.since);
    }

    /// Updates the pose and its map.
    fn update_map(&mut self, result: &FrameResult) {
        let s = &mut self.status;
        s.valid = result.map.is_some();
        s.sequence += u64::from(s.valid);
        s.points = result.points;
        let Some((map, gravity_aligned)) = result.map else { return };
        let map = name(map);
        if s.map != Some(map) && !gravity_aligned {
            s.gates.clear();
        }
        s.map = Some(map);
        s.metric = result.metric;
        s.initialised = gravity_aligned || self.period_s.is_none();
    }

    /// Collects the events.
    fn collect_events(&mut self, result: &FrameResult) {
        let s = &mut self.status;
        let lost_since = self.lost;
        self.lost = match result.state {
            State::Lost { .. } => lost_since.or(Some(result.stamp)),
            _ => None,
        };
        match (result.map_created, s.map, lost_since) {
            (true, Some(map), _) => s.events.push(StatusEvent::MapCreated { map, others: result.others }),
            (false, _, Some(since)) if s.valid => {
                s.events.push(StatusEvent::Relocalised { after_s: result.stamp - since });
            }
            _ => {}
        }
        if let Some(attempt) = result.attempt {
            s.gates.clone_from(&attempt.gates);
            if let (Some(found), Some(map)) = (attempt.accepted(), s.map) {
                let (scale, sigma) = (if self.depth { 1.0 } else { found.scale }, found.scale_sigma);
                s.events.push(StatusEvent::GravityAligned { map, scale, sigma });
            }
        }
        let contradicted = result.scale_check.filter(|c| c.verdict != ScaleVerdict::Agrees);
        if let (Some(check), Some(map)) = (contradicted, s.map) {
            let corrected = check.verdict == ScaleVerdict::Corrected;
            s.events.push(StatusEvent::ScaleContradicted { map, scale: check.scale, corrected });
        }
        let joined = result.verdicts.iter().filter_map(|v| Some((v.result.ok()?.joined, v)));
        s.events.extend(joined.map(|(joined, v)| match joined {
            Joined::Merge { from, into } => StatusEvent::Merge { from: name(from), into: name(into) },
            Joined::Loop => {
                StatusEvent::Loop { key_frame: v.key_frame.index(), earlier: v.candidate.index() }
            }
        }));
    }

    /// The phase, and what is waited for in it.
    fn phase_and_waits(&self, result: &FrameResult) -> (Phase, Vec<Wait>) {
        let silent_s = self.reading.map(|newest| result.stamp - newest);
        let silent = self.period_s.is_some() && silent_s.is_none_or(|s| s > SILENT_S);
        let silence = || (Phase::WaitImu, vec![Wait::Reading { silent_s }]);
        let (phase, waits) = match result.state {
            State::Lost { inliers, need } => (Phase::Lost, vec![Wait::Place { have: inliers, need }]),
            State::Coasting { since_s, sigma } => {
                (Phase::Coasting, vec![Wait::VisualMatches { since_s, sigma }])
            }
            State::RotationOnly { since_s, .. } => (Phase::Coasting, vec![Wait::Translation { since_s }]),
            State::Tracking if result.map_created && result.others => (Phase::Resetting, Vec::new()),
            State::Starting { .. } if silent => silence(),
            State::Starting { have, need } if !self.depth && have > 0 && have >= need => {
                (Phase::WaitMotion, vec![Wait::Parallax { matches: have }])
            }
            State::Starting { have, need } => (Phase::Initializing, vec![Wait::Points { have, need }]),
            State::Tracking if self.status.initialised || !result.mapping => (Phase::Tracking, Vec::new()),
            State::Tracking if silent => silence(),
            State::Tracking => self.initialisation(),
        };
        // What is waited for is reported also in the error phase.
        (if result.stage_failed.is_some() { Phase::Error } else { phase }, waits)
    }

    /// Scale and gravity are not known: what the last attempt lacked.
    fn initialisation(&self) -> (Phase, Vec<Wait>) {
        let failed = || self.status.gates.iter().filter(|g| !g.passed);
        let moving = |kind| matches!(kind, GateKind::Excitation | GateKind::Baseline | GateKind::ScaleSigma);
        let waits: Vec<Wait> = failed().copied().map(Wait::Gate).collect();
        match (waits.is_empty(), failed().any(|g| moving(g.kind))) {
            (true, _) => (Phase::Initializing, vec![Wait::FirstTry]),
            (false, true) => (Phase::WaitMotion, waits),
            (false, false) => (Phase::Initializing, waits),
        }
    }
}

fn name(map: MapId) -> usize {
    map.root().index()
}
