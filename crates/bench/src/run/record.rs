//! What is kept of a run while it goes on.

use super::accuracy::{Joins, join_error};
use super::costs::{Costs, Part, Times};
use super::options::RunOptions;
use super::verbose;
use crate::MeasureError;
use crate::memory::resident_mb;
use cairn_atlas::MapId;
use cairn_engine::{Engine, Joined, Odometry, Output, StageEvent, State};
use cairn_geometry::Se3;
use cairn_sensor::{FramePacket, Stamp};
use std::collections::{BTreeMap, BTreeSet};

/// What is kept of a run while it goes on.
pub struct Record {
    pub stamps: Vec<Stamp>,
    /// True poses of what the engine's poses are of.
    pub truth: BTreeMap<Stamp, Se3>,
    pub times: Costs,
    pub part: Costs,
    pub parts: Vec<Part>,
    pub joins: Joins,
    pub known_maps: BTreeSet<MapId>,
    /// Odometry of the metric poses.
    pub moved: Vec<(Stamp, Odometry)>,
    /// Stated standard deviations of the position, metres, of frames whose pose the motion sensors carried.
    pub sigmas: BTreeMap<Stamp, f64>,
    /// Metric poses whose scale was said to be known.
    pub scale_known: BTreeSet<Stamp>,
    /// The first metric pose, and the relative standard deviation stated then.
    pub metric_at: Option<(Stamp, Option<f64>)>,
    /// The standard deviation of the logarithm of scale that the first accepted initialisation stated.
    pub first_sigma: Option<f64>,
    /// What was reported of the IMU, each time it changed, seconds after the fault.
    pub reports: Vec<(f64, String)>,
    /// Seconds after the fault at which there was no pose any more.
    pub stopped_s: Option<f64>,
    pub before: Option<(Stamp, Se3)>,
}

impl Record {
    pub fn new(engine: &Engine, truth: &[(Stamp, Se3)]) -> Self {
        Self {
            stamps: Vec::new(),
            truth: engine.comparable(truth).into_iter().collect(),
            times: Costs::default(),
            part: Costs::default(),
            parts: Vec::new(),
            joins: Joins::default(),
            known_maps: BTreeSet::new(),
            moved: Vec::new(),
            sigmas: BTreeMap::new(),
            scale_known: BTreeSet::new(),
            metric_at: None,
            first_sigma: None,
            reports: Vec::new(),
            stopped_s: None,
            before: None,
        }
    }

    pub fn since_first_s(&self, stamp: Stamp) -> f64 {
        stamp - *self.stamps.first().unwrap_or(&stamp)
    }

    pub fn observe(
        &mut self,
        packet: &FramePacket,
        out: &Output,
        engine: &Engine,
        options: &RunOptions,
        truth: &[(Stamp, Se3)],
    ) -> Result<(), MeasureError> {
        let (stamp, number) = (packet.stamp, self.stamps.len());
        let since_s = self.since_first_s(stamp);
        if options.verbose {
            let step_error_m = self.step_error(stamp, out.world_from_body().map(|p| p.se3));
            verbose::print(number, out, engine, step_error_m);
        }
        self.first_sigma = self.first_sigma.or_else(|| {
            let attempt = out.events.iter().find_map(StageEvent::attempt)?;
            Some(attempt.accepted()?.scale_sigma)
        });
        if out.is_metric() && self.metric_at.is_none() {
            self.metric_at = Some((stamp, stated_sigma(engine)));
        }
        let metric = out.pose.filter(|pose| pose.scale.metric);
        self.moved.extend(metric.map(|pose| (stamp, pose.odometry)));
        self.scale_known.extend(metric.filter(|pose| pose.scale.is_known()).map(|_| stamp));
        if let State::Coasting { sigma, .. } = out.state {
            self.sigmas.insert(stamp, sigma);
        }
        self.known_maps.extend(engine.snapshot().maps().map(|(map, _)| map));
        for verdict in out.verdicts() {
            let Ok(accepted) = verdict.result else {
                self.joins.refused += 1;
                continue;
            };
            let is_loop = accepted.joined == Joined::Loop;
            *(if is_loop { &mut self.joins.loops } else { &mut self.joins.merges }) += 1;
            self.joins.joined_s.push(since_s);
            let off_m = join_error(engine, truth, verdict.key_frame, verdict.candidate)?;
            self.joins.false_m.extend(off_m.filter(|off_m| *off_m > 0.5));
        }
        let after_fault_s = since_s - options.fault_at_s;
        if !out.status.valid && after_fault_s >= 0.0 {
            self.stopped_s.get_or_insert(after_fault_s);
        }
        let report = imu_report(out);
        if self.reports.last().map_or("", |(_, text)| text.as_str()) != report {
            self.reports.push((after_fault_s, report));
        }
        self.stamps.push(stamp);
        self.times.add(out);
        self.part.add(out);
        Ok(())
    }

    /// Error of the motion since the previous frame, metres; NaN where it is unknown.
    fn step_error(&mut self, stamp: Stamp, pose: Option<Se3>) -> f64 {
        let last = std::mem::replace(&mut self.before, pose.map(|p| (stamp, p)));
        let step = || {
            let ((t, from), to) = (last?, pose?);
            let truly = self.truth.get(&t)?.inverse() * *self.truth.get(&stamp)?;
            Some(((from.inverse() * to).translation - truly.translation).norm())
        };
        step().unwrap_or(f64::NAN)
    }

    pub fn end_part(&mut self, stamp: Stamp, options: &RunOptions, engine: &Engine) {
        let Some(seconds) = options.parts_s else { return };
        if self.since_first_s(stamp) >= seconds * (self.parts.len() + 1) as f64 {
            self.close_part(engine);
        }
    }

    pub fn close_part(&mut self, engine: &Engine) {
        let (costs, map) = (std::mem::take(&mut self.part), engine.snapshot());
        self.parts.push(Part {
            number: self.parts.len() + 1,
            frames: costs.step_ms.len(),
            tracked: costs.tracked,
            mapped: costs.map_ms.len(),
            times: Times::of(&costs),
            resident_mb: resident_mb(),
            key_frames: map.key_frame_count(),
            landmarks: map.landmark_count(),
        });
        eprintln!("part {} done", self.parts.len());
    }
}

/// What is reported of the IMU at a frame; empty while it is trusted.
fn imu_report(out: &Output) -> String {
    let Some(imu) = &out.status.imu else { return String::new() };
    match imu.fault {
        Some(fault) => format!("{fault:?}").split_whitespace().next().unwrap_or_default().to_owned(),
        None if imu.refused > 0 => "single readings refused".into(),
        None => String::new(),
    }
}

/// The relative standard deviation of scale that is stated for the newest map.
pub fn stated_sigma(engine: &Engine) -> Option<f64> {
    let map = engine.snapshot();
    map.stated_scale_sigma(map.newest_key_frame()?.map)
}
