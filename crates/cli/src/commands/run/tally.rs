//! Counts and times of a run, frame by frame; the report and its text.

use super::history::History;
use super::outcome::Outcome;
use super::status::{self, StatusTally};
use crate::style::{self, Paint};
use cairn_engine::{CameraPoses, Engine, Finished, Joined, Output, ScaleStretch, State, Timings, Verdict};
use cairn_eval::{
    Align, EvalOptions, Evaluation, LiveReport, Lost, PairError, Percentiles, RunReport, ScaleReport,
    SkipReport, StageTimes, evaluate,
};
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::{FramePacket, SkipCount, SkipKind, Skipped, Skips, Stamp};
use cairn_session::FileConfig;
use std::fmt::{Display, Write};
use std::time::Instant;

/// Counts so far.
pub struct Tally {
    began: Instant,
    /// Frames that reached the engine.
    pub frames: usize,
    /// Frames dropped because the engine was busy.
    pub dropped: usize,
    /// Milliseconds from decoded image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    stages: StageTimes,
    lost: Vec<Lost>,
    first_pose_s: Option<f64>,
    tracking: bool,
    /// Why the last frame has no pose; `None` when it has one.
    pub last_state: Option<String>,
    /// Frames of which feature extraction could make nothing.
    rejected: Skips,
    loops: usize,
    merges: usize,
    /// The status over time.
    pub status: StatusTally,
    /// What happened when.
    pub history: History,
}

impl Tally {
    /// An empty tally; `began` is when the process started.
    pub fn new(began: Instant) -> Self {
        Self {
            began,
            frames: 0,
            dropped: 0,
            step_ms: Vec::new(),
            stages: StageTimes::new(),
            lost: Vec::new(),
            first_pose_s: None,
            tracking: false,
            last_state: None,
            rejected: Skips::default(),
            loops: 0,
            merges: 0,
            status: StatusTally::default(),
            history: History::default(),
        }
    }

    /// Adds a frame that the engine processed.
    pub fn frame(&mut self, packet: &FramePacket, done: &Output) {
        self.frames += 1;
        self.history.frame(done);
        self.step_ms.push(done.timings.step_ms());
        self.stages.add_ms("decode", packet.decode_ms);
        self.stages.add_ms("extract", done.timings.extract_ms);
        self.stages.add_ms("track", done.timings.track_ms);
        self.add_stages(&done.timings, done.verdicts());
        if done.pose.is_some() && self.first_pose_s.is_none() {
            self.first_pose_s = Some(self.began.elapsed().as_secs_f64());
        }
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
    }

    /// Adds a frame that feature extraction rejected.
    pub fn rejected(&mut self, packet: &FramePacket, why: &impl Display) {
        self.frames += 1;
        self.last_state = Some(why.to_string());
        let text = format!("{}: {why}", packet.stamp);
        self.rejected.add(&Skipped::new(SkipKind::Frame, "no features can be extracted", text));
    }

    /// Adds the work done after the last frame.
    pub fn after(&mut self, finished: &Finished, at: Stamp) {
        self.history.joins(at, finished.verdicts());
        self.add_stages(&finished.timings, finished.verdicts());
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

    /// The report so far, without source and sensor, which are not known here.
    pub fn report(&self, engine: &Engine, config: &FileConfig, skips: &Skips) -> RunReport {
        let snapshot = engine.snapshot();
        let mut report = RunReport {
            version: env!("CARGO_PKG_VERSION").into(),
            skipped: skips.count(SkipKind::Frame) + self.rejected.count(SkipKind::Frame),
            skips: skips.iter().chain(self.rejected.iter()).map(skip_report).collect(),
            dropped: self.dropped,
            lost: self.lost.clone(),
            resets: self.status.resets,
            standing: self.status.summary(),
            maps: snapshot.maps().count(),
            loops: self.loops,
            merges: self.merges,
            keyframes: snapshot.key_frame_count(),
            landmarks: snapshot.landmark_count(),
            ms: Percentiles::of(&self.step_ms),
            stages: self.stages.summary(),
            first_pose_s: self.first_pose_s,
            config: as_printed(config),
            ..RunReport::default()
        };
        report.set_frames(self.frames + self.dropped + skips.count(SkipKind::Frame), engine.log().tracked());
        report.set_usage(self.began.elapsed().as_secs_f64());
        report
    }
}

/// How much was left out for one reason, as reports have it.
pub fn skip_report(s: &SkipCount) -> SkipReport {
    SkipReport {
        what: s.kind.name().to_owned(),
        reason: s.reason.clone(),
        count: s.count,
        first: s.first.clone(),
    }
}

/// The configuration as `cairn config --json` prints it: converted through text, so that 0.8 in single precision stays
/// 0.8.
pub fn as_printed(config: &FileConfig) -> serde_json::Value {
    // Everything in a configuration can be written as JSON.
    let text = serde_json::to_string(config).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// Alignment by Sim3 where the scale is not metric.
fn options(metric: bool) -> EvalOptions {
    EvalOptions { align: if metric { Align::Se3 } else { Align::Sim3 }, ..EvalOptions::default() }
}

fn trajectory(poses: &[(Stamp, Se3)]) -> Option<Trajectory> {
    Trajectory::from_unsorted(poses.iter().map(|(t, pose)| (t.0, *pose)).collect()).ok()
}

/// A jump of the live trajectory worth counting, metres.
const JUMP_M: f64 = 0.1;

/// Poses against the ground truth, as they are written: those of the body, or of the first camera where it is asked for
/// (`body_from_cam0`) or lengths are not metres.
pub fn accuracy(
    truth: &[(Stamp, Se3)],
    poses: &CameraPoses,
    body_from_cam0: Option<Se3>,
) -> Option<Evaluation> {
    let body_from_frame = body_from_cam0.unwrap_or(poses.body_from_frame());
    let truth: Vec<(Stamp, Se3)> = truth.iter().map(|(t, body)| (*t, *body * body_from_frame)).collect();
    let (reference, estimate) = (trajectory(&truth)?, trajectory(&poses.of_mounted(&body_from_frame))?);
    evaluate(&reference, &estimate, &options(poses.is_metric())).ok()
}

/// The trajectory as it was estimated at the time, against the ground truth.
pub fn live(truth: &[(Stamp, Se3)], poses: &CameraPoses, body_from_cam0: Option<Se3>) -> Option<LiveReport> {
    let e = accuracy(truth, poses, body_from_cam0)?;
    let error = |p: &PairError| p.estimate - p.reference;
    let changes: Vec<f64> = e.errors.windows(2).map(|w| (error(&w[1]) - error(&w[0])).norm()).collect();
    let steps = Percentiles::of(&changes)?;
    let jumps = changes.iter().filter(|step| **step > JUMP_M).count();
    Some(LiveReport { ate_m: e.ate_m.rmse, jump_p99_m: steps.p99, jump_max_m: steps.max, jumps })
}

/// The stretches of the run in one unit of length, each compared with the ground truth by itself.
pub fn scale(truth: &[(Stamp, Se3)], engine: &Engine) -> Vec<ScaleReport> {
    let reference = trajectory(&engine.comparable(truth));
    let poses = engine.trajectory();
    let (snapshot, camera) = (engine.snapshot(), engine.front_end().model());
    let report = |s: ScaleStretch| {
        let own: Vec<(Stamp, Se3)> =
            poses.iter().filter(|(t, _)| (s.from..=s.to).contains(t)).copied().collect();
        let compared = reference.as_ref().zip(trajectory(&own));
        let sim3 = compared.as_ref().and_then(|(r, e)| evaluate(r, e, &options(false)).ok());
        let se3 = compared.and_then(|(r, e)| evaluate(r, &e, &options(true)).ok());
        let ate_m = if s.scale.metric { &se3 } else { &sim3 };
        ScaleReport {
            map: s.scale.map.root().index(),
            from_s: s.from.seconds(),
            to_s: s.to.seconds(),
            poses: s.poses,
            metric: s.scale.metric,
            sigma_log: s.scale.sigma_log,
            metres_sigma_log: snapshot.scale_of(s.scale.map, camera).metric_sigma(),
            supported: s.scale.supported,
            ate_m: ate_m.as_ref().map(|e| e.ate_m.rmse),
            metres_per_unit: sim3.map(|e| e.scale),
        }
    };
    engine.scale_stretches().into_iter().map(report).collect()
}

/// Metres, and how well they are known.
pub fn metres(sigma_log: Option<f64>) -> String {
    sigma_log.map_or_else(|| "metres".to_owned(), |sigma| format!("metres, to {:.1} %", 100.0 * sigma))
}

/// The name of one or several of a kind.
pub fn plural(what: &str, count: usize) -> String {
    if count == 1 || what == "other" { what.to_owned() } else { format!("{what}s") }
}

/// The report as a table for people.
pub fn text(ended: &Outcome, realtime: bool) -> String {
    let r = ended.report;
    let mut text = String::new();
    // Writing to a string cannot fail.
    if ended.interrupted {
        let _ = writeln!(text, "ended     interrupted; everything until then is written");
    }
    for problem in &ended.problems {
        let _ = writeln!(text, "{} {problem}", style::on_stdout(Paint::Doubtful, "problem  "));
    }
    let _ = writeln!(text, "source    {}, {}", r.source, r.sensor);
    let dropped = if realtime { format!(", {} dropped", r.dropped) } else { String::new() };
    let _ = writeln!(
        text,
        "frames    {}, {} tracked (coverage {:.3}), {} skipped{dropped}",
        r.frames, r.tracked, r.coverage, r.skipped
    );
    let _ = writeln!(
        text,
        "map       {} key frames, {} landmarks, {} maps, {} loops, {} merges",
        r.keyframes, r.landmarks, r.maps, r.loops, r.merges
    );
    if let Some(s) = &ended.searches {
        let _ = writeln!(
            text,
            "by depth  {} looks while lost, {} refused; {} places not confirmed, {} found, {} gone on from",
            s.attempts,
            s.refused.all(),
            s.not_followed + s.not_confirmed,
            s.found,
            s.taken
        );
    }
    for s in &r.skips {
        let _ = writeln!(text, "skipped   {} {}: {}", s.count, plural(&s.what, s.count), s.reason);
    }
    if let Some(ms) = &r.ms {
        let _ = writeln!(text, "step      {ms} ms");
    }
    for (name, ms) in &r.stages.0 {
        let _ = writeln!(text, "  {name:<8}{ms} ms");
    }
    let number = |v: Option<f64>, unit: &str| v.map_or("unknown".into(), |v| format!("{v:.2} {unit}"));
    let _ = writeln!(
        text,
        "cost      first pose after {}, {:.2} s in total, {} of CPU time, peak memory {}",
        number(r.first_pose_s, "s"),
        r.wall_s,
        number(r.cpu_s, "s"),
        number(r.peak_rss_mb, "MB"),
    );
    if let Some(e) = &r.accuracy {
        let align = match e.align {
            Align::Sim3 => format!("Sim3, scale {:.4}", e.scale),
            _ => "SE3".into(),
        };
        let _ = writeln!(
            text,
            "truth     ATE {:.4} m RMSE ({align}) over {:.2} m, {} pairs, max {:.4} m",
            e.ate_m.rmse, e.path_m, e.pairs, e.ate_m.max
        );
    }
    if let Some(live) = &r.live {
        let _ = writeln!(
            text,
            "live      ATE {:.4} m; error changes by at most {:.3} m from pose to pose (p99 {:.4} m, {} above {JUMP_M} m)",
            live.ate_m, live.jump_max_m, live.jump_p99_m, live.jumps
        );
    }
    for s in r.scale.iter().filter(|_| r.scale.len() > 1 || r.scale.iter().any(|s| !s.metric)) {
        let known = match (s.metric, s.sigma_log) {
            (true, _) => metres(s.metres_sigma_log),
            (false, sigma) if sigma > 0.0 => {
                format!("unit of its own, known to {:.0} % by the pace", 100.0 * sigma)
            }
            _ => "unit of its own".to_owned(),
        };
        let against = s.ate_m.zip(s.metres_per_unit);
        let against = against
            .map_or_else(String::new, |(ate, m)| format!("; ATE {ate:.4} m, {m:.4} m per unit by the truth"));
        let _ =
            writeln!(text, "scale     {:.2} to {:.2} s, map {}: {known}{against}", s.from_s, s.to_s, s.map);
    }
    text += &status::text(r);
    for lost in &r.lost {
        let _ = writeln!(text, "lost      at {:.3} s: {}", lost.t, lost.reason);
    }
    text
}
