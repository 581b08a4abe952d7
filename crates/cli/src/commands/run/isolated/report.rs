//! The results of a run in processes.

use super::super::outcome::Outcome;
use super::super::{Arguments, open_source, problems, results, tally};
use super::monitor::Monitor;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn_engine::PoseTime;
use cairn_eval::{Lost, Percentiles, RunReport};
use cairn_geometry::Se3;
use cairn_sensor::{SkipKind, Stamp};
use cairn_session::FileConfig;
use cairn_workers::Supervised;
use cairn_workers::message::Tracked;
use serde::Serialize;
use std::time::Instant;

/// What the result says of the processes.
#[derive(Serialize)]
struct Processes<'a> {
    #[serde(flatten)]
    outcome: &'a Outcome<'a>,
    /// Each process that died or was killed because it hung.
    deaths: Vec<DeathReport<'a>>,
    /// After each death of SLAM: frames without a pose, and seconds until the next pose.
    relocalised: Vec<RelocalisedReport>,
}

#[derive(Serialize)]
struct DeathReport<'a> {
    process: &'static str,
    why: &'a str,
    at_frame: u64,
    t_s: f64,
}

#[derive(Serialize)]
struct RelocalisedReport {
    frames: usize,
    after_s: f64,
}

pub(super) fn report(
    a: &Arguments,
    run: &Supervised,
    monitor: &Monitor,
    config: &FileConfig,
    compared: &Compared,
    began: Instant,
) -> RunReport {
    let snapshot = &run.map.snapshot;
    let ms: Vec<f64> = run.frames.iter().map(|f| f.ms).collect();
    let (skips, dropped) = (run.left_out.skips(), run.left_out.dropped);
    let skipped = skips.count(SkipKind::Frame);
    let mut report = RunReport {
        version: env!("CARGO_PKG_VERSION").into(),
        source: run.opened.name.clone(),
        sensor: run.opened.sensor.clone(),
        skipped,
        skips: skips.iter().map(tally::skip_report).collect(),
        dropped,
        lost: lost(&run.frames),
        maps: snapshot.maps().count(),
        loops: run.finished.loops,
        merges: run.finished.merges,
        keyframes: snapshot.key_frame_count(),
        landmarks: snapshot.landmark_count(),
        ms: Percentiles::of(&ms),
        first_pose_s: monitor.first_pose_s,
        config: tally::as_printed(config),
        accuracy: tally::accuracy(&compared.truth, &run.camera_poses(PoseTime::Corrected), compared.cam0),
        ..RunReport::default()
    };
    let tracked = run.frames.iter().filter(|f| f.pose.is_some()).count();
    report.set_frames(run.frames.len() + dropped + skipped, tracked);
    // Those of the supervisor would say nothing of the run.
    report.wall_s = began.elapsed().as_secs_f64();
    report
}

/// Where tracking was lost.
fn lost(frames: &[Tracked]) -> Vec<Lost> {
    let gaps = frames.windows(2).filter(|w| w[0].pose.is_some() && w[1].pose.is_none());
    gaps.map(|w| Lost { t: Stamp(w[1].stamp).seconds(), reason: format!("{:?}", w[1].outcome) }).collect()
}

/// What trajectories are compared with, and what they are of.
#[derive(Default)]
pub(super) struct Compared {
    truth: Vec<(Stamp, Se3)>,
    /// Where the first camera is on the body, if trajectories are asked for of it.
    cam0: Option<Se3>,
}

impl Compared {
    /// As the source says it, opened once more.
    pub(super) fn of(a: &Arguments, config: &FileConfig) -> Self {
        let opened = open_source(a, &mut config.engine.clone(), None).ok();
        opened.map_or_else(Self::default, |(source, _)| Self {
            truth: source.info().truth.clone(),
            cam0: results::body_from_cam0(a.frame, source.rig()),
        })
    }
}

/// Writes the results, all that can be written.
pub(super) fn written(
    a: &Arguments,
    outputs: &Outputs,
    output: &Output,
    run: &Supervised,
    report: &RunReport,
    compared: &Compared,
    surface: &dyn Fn() -> Result<Vec<u8>, Failure>,
) -> Result<(), Failure> {
    let (interrupted, problems) = (interrupt::requested(), problems::of(report));
    let outcome = Outcome { report, interrupted, problems, searches: None };
    let deaths = run.deaths.iter().map(|d| DeathReport {
        process: d.role.name(),
        why: &d.how,
        at_frame: d.at_frame,
        t_s: d.t_s,
    });
    let relocalised = run
        .relocalised
        .iter()
        .map(|(frames, after_s)| RelocalisedReport { frames: *frames, after_s: *after_s });
    let ended = Processes { outcome: &outcome, deaths: deaths.collect(), relocalised: relocalised.collect() };
    let json = || {
        let text = serde_json::to_string_pretty(&ended)
            .map_err(|e| Failure::new("report", e.to_string(), "leave out --report"))?;
        Ok((text + "\n").into_bytes())
    };
    let mut failures: Vec<Failure> = outputs.write("--report", json).err().into_iter().collect();
    let map = || run.map.write().map_err(|e| Failure::new("the map", e.to_string(), "leave out --map-out"));
    if run.map.snapshot.key_frame_count() > 0 {
        failures.extend(outputs.write("--map-out", map).err());
    }
    if report.tracked > 0 {
        failures.extend(results::write_poses(outputs, compared.cam0, run.frames.len(), &|time| {
            run.camera_poses(time)
        }));
    } else if failures.is_empty() {
        let why = run.frames.last().map_or_else(|| "it has no frames".into(), |f| format!("{:?}", f.outcome));
        failures.push(Failure::new(&a.source, format!("no frame got a pose: {why}"), super::super::NO_POSE));
    }
    match &run.surfaces {
        Ok(()) => failures.extend(outputs.write("--mesh", surface).err()),
        Err(e) => failures.push(Failure::new(e.what.clone(), e.why.clone(), e.cure.clone())),
    }
    match &run.recorded {
        Some(Err(why)) => {
            failures.push(Failure::new("recording", why.to_string(), "free some space on the disk"))
        }
        None if a.record.is_some() => {
            failures.push(Failure::new(
                "recording",
                "the process that records died too often",
                "run without --isolated",
            ));
        }
        _ => {}
    }
    Failure::all(failures)?;
    output.result(&ended, |ended| {
        let mut text = tally::text(ended.outcome, a.realtime);
        for d in &ended.deaths {
            text += &format!("died      {} at frame {}: {}\n", d.process, d.at_frame, d.why);
        }
        text
    })
}
