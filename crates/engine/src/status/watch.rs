//! From what became of each packet to the status after it.

use super::{ImuStatus, Phase, Status, StatusEvent, Wait};
use cairn_atlas::{MapId, Snapshot};
use cairn_inertial::{Attempt, GateKind};
use cairn_mapping::{Joined, Verdict};
use cairn_sensor::{ImuSample, Stamp};
use cairn_tracking::State;

/// Readings are missing when none has come for so long, seconds.
const SILENT_S: f64 = 0.5;
/// A hole is longer than so many periods, as [`cairn_sensor::ImuGap`] has it.
const GAP_PERIODS: f64 = 2.5;

/// What became of a packet.
pub(crate) struct Seen<'a> {
    pub stamp: Stamp,
    pub imu: &'a [ImuSample],
    pub state: State,
    /// The world of the pose, where there is one, and whether its scale and gravity are known.
    pub map: Option<(MapId, bool)>,
    pub metric: bool,
    /// Whether a world begins here, and whether there are others.
    pub map_created: bool,
    pub beside: bool,
    pub points: usize,
    pub attempt: Option<&'a Attempt>,
    pub verdicts: &'a [Verdict],
    /// A stage has died, now or before.
    pub died: Option<&'a str>,
    /// Whether the map may change.
    pub mapping: bool,
}

/// Follows the packets.
#[derive(Debug)]
pub(crate) struct Watch {
    status: Status,
    depth: bool,
    /// Seconds between readings, where the inertial sensor is used.
    period_s: Option<f64>,
    first: Option<Stamp>,
    /// The newest real reading.
    reading: Option<Stamp>,
    /// Since when the pose is lost.
    lost: Option<Stamp>,
}

impl Watch {
    /// Before the first packet. `depth`: one picture is enough to begin with.
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

    /// The packet could not be taken by the eye.
    pub fn refuse(&mut self, stamp: Stamp, imu: &[ImuSample], why: String) {
        self.arrive(stamp, imu);
        let s = &mut self.status;
        (s.phase, s.valid, s.points, s.error) = (Phase::Error, false, 0, Some(why));
        s.waits.clear();
    }

    /// The packet was taken.
    pub fn see(&mut self, seen: &Seen) {
        self.arrive(seen.stamp, seen.imu);
        self.place(seen);
        self.happen(seen);
        let (phase, waits) = self.judge(seen);
        let error = seen.died.map(str::to_owned);
        self.status = Status { phase, waits, error, ..std::mem::take(&mut self.status) };
    }

    /// Time and readings.
    fn arrive(&mut self, stamp: Stamp, imu: &[ImuSample]) {
        let s = &mut self.status;
        s.t_s = stamp - *self.first.get_or_insert(stamp);
        s.frames += 1;
        s.events.clear();
        let (Some(told), Some(period_s)) = (&mut s.imu, self.period_s) else { return };
        told.batch = imu.len();
        for sample in imu {
            if sample.is_synthesised() {
                told.synthesised += 1;
                continue;
            }
            let hole_s = self.reading.map_or(0.0, |before| sample.stamp - before);
            if hole_s > GAP_PERIODS * period_s {
                told.gaps += 1;
                told.longest_gap_s = told.longest_gap_s.max(hole_s);
            }
            self.reading = self.reading.max(Some(sample.stamp));
        }
        told.lag_ms = self.reading.map(|newest| (stamp - newest) * 1e3);
    }

    /// The pose and its world.
    fn place(&mut self, seen: &Seen) {
        let s = &mut self.status;
        s.valid = seen.map.is_some();
        s.sequence += u64::from(s.valid);
        s.points = seen.points;
        let Some((map, level)) = seen.map else { return };
        let map = name(map);
        if s.map != Some(map) && !level {
            s.gates.clear();
        }
        s.map = Some(map);
        s.metric = seen.metric;
        s.initialised = level || self.period_s.is_none();
    }

    /// What happened.
    fn happen(&mut self, seen: &Seen) {
        let s = &mut self.status;
        let lost_since = self.lost;
        self.lost = match seen.state {
            State::Lost { .. } => lost_since.or(Some(seen.stamp)),
            _ => None,
        };
        match (seen.map_created, s.map, lost_since) {
            (true, Some(map), _) => s.events.push(StatusEvent::World { map, beside: seen.beside }),
            (false, _, Some(since)) if s.valid => {
                s.events.push(StatusEvent::Found { after_s: seen.stamp - since });
            }
            _ => {}
        }
        if let Some(attempt) = seen.attempt {
            s.gates.clone_from(&attempt.gates);
            if let (Some(found), Some(map)) = (attempt.accepted(), s.map) {
                let (scale, sigma) = (if self.depth { 1.0 } else { found.scale }, found.scale_sigma);
                s.events.push(StatusEvent::AlignGravity { map, scale, sigma });
            }
        }
        let joined = seen.verdicts.iter().filter_map(|v| Some((v.result.ok()?.joined, v)));
        s.events.extend(joined.map(|(joined, v)| match joined {
            Joined::Merge { from, into } => StatusEvent::Merge { from: name(from), into: name(into) },
            Joined::Loop => StatusEvent::Loop { key_frame: v.key_frame.index(), again: v.candidate.index() },
        }));
    }

    /// The phase, and what is waited for in it.
    fn judge(&self, seen: &Seen) -> (Phase, Vec<Wait>) {
        let silent_s = self.reading.map(|newest| seen.stamp - newest);
        let silent = self.period_s.is_some() && silent_s.is_none_or(|s| s > SILENT_S);
        let silence = || (Phase::WaitImu, vec![Wait::Reading { silent_s }]);
        let (phase, waits) = match seen.state {
            State::Lost { inliers, need } => (Phase::Lost, vec![Wait::Place { have: inliers, need }]),
            State::Coasting { since_s, sigma } => (Phase::Coasting, vec![Wait::Sight { since_s, sigma }]),
            State::Tracking if seen.map_created && seen.beside => (Phase::Resetting, Vec::new()),
            State::Starting { .. } if silent => silence(),
            State::Starting { have, need } if !self.depth && have > 0 && have >= need => {
                (Phase::WaitMotion, vec![Wait::Parallax { matches: have }])
            }
            State::Starting { have, need } => (Phase::Initializing, vec![Wait::Points { have, need }]),
            State::Tracking if self.status.initialised || !seen.mapping => (Phase::Tracking, Vec::new()),
            State::Tracking if silent => silence(),
            State::Tracking => self.sought(),
        };
        // What is waited for is worth to be told also when something is wrong.
        (if seen.died.is_some() { Phase::Error } else { phase }, waits)
    }

    /// Scale and gravity are not known: what the last try lacked.
    fn sought(&self) -> (Phase, Vec<Wait>) {
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
