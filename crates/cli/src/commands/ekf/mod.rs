//! `cairn ekf`: EKF-SLAM on a recorded run of a wheeled robot.

mod walk;

use crate::failure::Failure;
use crate::number::{number, positive};
use crate::output::Output;
use crate::outputs::Outputs;
use crate::speaking::{HEADING, Speaking};
use cairn_filter::batch::BatchConfig;
use cairn_filter::ekf::{Association, EkfConfig};
use cairn_filter::joint::joint;
use cairn_filter::log::{CSV_FORMAT, Event, Log, RobotLog, load};
use cairn_filter::page::page;
use cairn_filter::run::{Run, align, position_rmse, run as run_filter};
use cairn_filter::truth::{Judgement, judge as against_truth};
use cairn_geometry::Se2;
use serde::Serialize;
use std::ops::Bound;
use std::path::{Path, PathBuf};

/// Maps landmarks with a Kalman filter from odometry and sightings, and compares with smoothing and a survey.
///
/// LOG is an MRCLAM folder, a file of ODOMETRY and LANDMARK lines (Victoria Park), one of a pair _DR.txt and _TD.txt
/// (Plaza), or a .csv.
#[derive(clap::Args)]
#[command(after_long_help = format!("The csv:\n{CSV_FORMAT}"))]
pub struct Arguments {
    /// The recorded run.
    log: PathBuf,
    /// Of a log of several robots only this one.
    #[arg(long, value_name = "NUMBER")]
    robot: Option<u32>,
    /// How sightings find their landmarks: by their labels, or without them.
    #[arg(long, value_enum, default_value = "known", value_name = "HOW")]
    associate: Associate,
    /// Part of the true sightings that the gate lets through; without it what suits the log.
    #[arg(long, value_name = "PART", 
        value_parser = number((Bound::Excluded(0.0), Bound::Included(1.0)), "above 0 and at most 1"))]
    gate: Option<f64>,
    /// Keep landmarks within so many metres active and the rest passive.
    #[arg(long, value_name = "M", value_parser = positive())]
    local: Option<f64>,
    /// Write a page that replays the run (of several robots the first).
    #[arg(long, value_name = "HTML")]
    out: Option<PathBuf>,
    /// Replace the page if there is one.
    #[arg(long)]
    overwrite: bool,
    /// The robot of the log (of several the first) records routes and is guided along them: executes the commands in this file at
    /// given times and places, one per line: "at 5 record", "near X Y Z WITHIN stop", "at 60 guide home", "arrived quit".
    #[arg(help_heading = HEADING, long, value_name = "FILE", conflicts_with_all = ["out", "overwrite"])]
    script: Option<PathBuf>,
    /// The folder for routes that are recorded.
    #[arg(help_heading = HEADING, long, value_name = "DIR", default_value = "routes", requires = "script")]
    routes: PathBuf,
    #[command(flatten)]
    speaking: Speaking,
}

impl Arguments {
    fn by_labels(&self) -> bool {
        matches!(self.associate, Associate::Known)
    }
}

#[derive(Clone, Copy, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Associate {
    /// By their labels.
    Known,
    /// Each to the nearest.
    Nearest,
    /// All of an instant together (JCBB).
    Joint,
    /// As joint, but what is not certain is decided by what is seen later.
    Deferred,
}

#[derive(Serialize)]
struct Mapped {
    log: String,
    associate: Associate,
    gate_probability: f64,
    notes: Vec<String>,
    robots: Vec<Robot>,
    joint: Option<JointMap>,
}

/// One map of several robots.
#[derive(Serialize)]
struct JointMap {
    robots: Vec<String>,
    landmarks: usize,
    mutual_sightings: usize,
    converged: bool,
    /// Against the survey, after a rigid alignment.
    landmark_rmse_m: Option<f64>,
}

#[derive(Serialize)]
struct Robot {
    name: String,
    poses: usize,
    landmarks: usize,
    taken: usize,
    rejected: usize,
    recoveries: usize,
    /// Mean normalised innovation squared for each degree of freedom; 1 is right.
    nis_per_dof: f64,
    nis_within_95: f64,
    wrong_associations: Option<f64>,
    /// Against the survey, after a rigid alignment.
    landmark_rmse_m: Option<f64>,
    smoothed_landmark_rmse_m: Option<f64>,
    /// Against smoothing, each aligned to the survey, else the filter's landmarks to the smoothed ones.
    position_rmse_m: Option<f64>,
    landmarks_to_smoothed_m: Option<f64>,
    /// Against the true poses of the log, after a rigid alignment.
    ate_m: Option<f64>,
    /// Mean normalised error squared of the poses against the true ones; 3 is right.
    nees: Option<f64>,
    filter_ms: f64,
}

/// Filters, judges, prints.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let partner = partner_of(&a.log);
    let outputs = Outputs::new(a.overwrite)
        .input("the log", Some(&a.log))
        .input("the second file of the log", partner.as_deref())
        .input("--script", a.script.as_deref())
        .output("--out", a.out.as_deref())
        .checked()?;
    let (_, log) = load(&a.log, a.robot).map_err(|e| {
        let place = e.line.map_or_else(String::new, |line| format!(", line {line}"));
        Failure::new(
            format!("{}{place}", e.file),
            e.reason,
            "see cairn ekf --help for the logs that are read",
        )
    })?;
    let config = EkfConfig {
        association: match a.associate {
            Associate::Known => Association::Known,
            Associate::Nearest => Association::Nearest,
            Associate::Joint => Association::Joint,
            Associate::Deferred => Association::Deferred,
        },
        gate_probability: a.gate.unwrap_or(log.gate_probability),
        local_radius_m: a.local,
        ..EkfConfig::default()
    };
    if let Some(script) = &a.script {
        if matches!(a.associate, Associate::Deferred) {
            let hint = "use --associate known, nearest or joint";
            return Err(Failure::usage(
                "--associate deferred",
                "decides later, and directions cannot wait",
                hint,
            ));
        }
        return walk::run(a, &log, config, walk::script(script)?, output);
    }
    let (mut robots, mut runs) = (Vec::new(), Vec::new());
    for k in 0..log.robots.len() {
        let (robot, found) = judge(&log, k, &config, (k == 0).then_some(&outputs))?;
        robots.push(robot);
        runs.push(found);
    }
    let joint = if a.by_labels() { joint_map(&log, &runs)? } else { None };
    let of_robot = |robot| [gap_note(robot), blind_end(robot)].into_iter().flatten();
    let notes = log.notes.iter().cloned().chain(log.robots.iter().flat_map(of_robot));
    let notes = notes.chain(robots.iter().filter_map(contradiction)).collect();
    let gate_probability = config.gate_probability;
    let mapped = Mapped { log: log.name, associate: a.associate, gate_probability, notes, robots, joint };
    output.result(&mapped, text)
}

/// Where a robot's odometry ends before its sightings, or has gaps.
fn gap_note(robot: &RobotLog) -> Option<String> {
    let spans = robot.without_odometry();
    let (from, _) = spans.first()?;
    let all: f64 = spans.iter().map(|(from, to)| to - from).sum();
    (all >= 0.1).then(|| format!(
        "{}: {all:.1} s without odometry, the first from {from:.1} s on; only sightings tell the pose there",
        robot.name
    ))
}

/// A robot whose sightings end long before its log does; those of MRCLAM's robots are never further apart than a tenth of it.
fn blind_end(robot: &RobotLog) -> Option<String> {
    let [first, last] = [robot.entries.first()?, robot.entries.last()?].map(|e| e.time_s);
    let seen = robot.entries.iter().rfind(|e| matches!(e.event, Event::Seen { .. }))?.time_s;
    (last - seen > 0.1 * (last - first)).then(|| {
        format!(
            "{}: no sighting after {:.1} s of {:.1} s; odometry alone tells the pose there",
            robot.name,
            seen - first,
            last - first
        )
    })
}

/// A log that the filter cannot explain. Of MRCLAM, Victoria Park and Plaza 2 % of the sightings are rejected at most, and 91 % of the
/// innovations are within 95 %; with the sign of turns or bearings exchanged 4 %, with degrees or millimetres more than half.
fn contradiction(r: &Robot) -> Option<String> {
    let share = r.rejected as f64 / (r.taken + r.rejected).max(1) as f64;
    (r.rejected >= 5 && share > 0.03 || r.nis_within_95 < 0.8).then(|| {
        format!(
            "{}: odometry and sightings contradict each other: {:.1} % of the sightings are rejected, {:.1} % of the innovations within \
             95 %; are units (m, rad, s), the sign of bearings and turns, and labels right?",
            r.name,
            100.0 * share,
            100.0 * r.nis_within_95
        )
    })
}

/// Smoothing several robots starts farther off than that of one: three robots of MRCLAM do not converge in 50 steps.
const JOINT_ITERATIONS: usize = 200;

/// One map of all robots that share landmarks.
fn joint_map(log: &Log, runs: &[Run]) -> Result<Option<JointMap>, Failure> {
    let config = BatchConfig { iterations: JOINT_ITERATIONS, ..BatchConfig::default() };
    let found = joint(log, runs, &config)
        .map_err(|e| Failure::new(&log.name, e.to_string(), "check the noise of the log"))?;
    Ok(found.map(|j| JointMap {
        robots: j.robots.iter().map(|k| log.robots[*k].name.clone()).collect(),
        landmarks: j.smoothed.landmarks.len(),
        mutual_sightings: j.mutual,
        converged: j.report.converged,
        landmark_rmse_m: align(&log.surveyed, &j.smoothed.landmarks).map(|a| a.1),
    }))
}

fn judge(
    log: &Log,
    k: usize,
    config: &EkfConfig,
    page_to: Option<&Outputs>,
) -> Result<(Robot, Run), Failure> {
    let failed = |why: String| Failure::new(&log.robots[k].name, why, "check the noise of the log");
    let found = run_filter(log, k, config).map_err(|e| failed(e.to_string()))?;
    let (smooth, _) = found.smoothed(log, k, &BatchConfig::default()).map_err(|e| failed(e.to_string()))?;
    let named = found.named();
    let (survey, smooth_survey) = (align(&log.surveyed, &named), align(&log.surveyed, &smooth.landmarks));
    let onto = align(&smooth.landmarks, &named);
    let transforms = match (&survey, &smooth_survey) {
        (Some((a, ..)), Some((b, ..))) => Some((*a, *b)),
        _ => onto.map(|(t, ..)| (t, Se2::identity())),
    };
    // True poses are of the first robot.
    let truth = if k == 0 { against_truth(&log.truth, &found) } else { None };
    let robot = Robot {
        name: found.robot.clone(),
        poses: found.poses.len(),
        landmarks: found.landmarks.iter().filter(|l| l.confirmed).count(),
        taken: found.counts.taken,
        rejected: found.counts.rejected,
        recoveries: found.recoveries,
        nis_per_dof: found.nis_per_dof,
        nis_within_95: found.nis_within_95,
        wrong_associations: found.wrong_associations,
        landmark_rmse_m: survey.map(|s| s.1),
        smoothed_landmark_rmse_m: smooth_survey.map(|s| s.1),
        position_rmse_m: transforms.map(|(a, b)| position_rmse(&found.poses, &a, &smooth.poses[0], &b)),
        landmarks_to_smoothed_m: onto.map(|o| o.1),
        ate_m: truth.and_then(|t: Judgement| t.ate_m),
        nees: truth.and_then(|t| t.nees),
        filter_ms: found.filter_ms,
    };
    if let Some(outputs) = page_to {
        write_page(outputs, log, &found, &robot, survey.map(|s| s.0.inverse()), &smooth.poses[0])?;
    }
    Ok((robot, found))
}

/// The other file of a pair _DR and _TD (Plaza).
fn partner_of(log: &Path) -> Option<PathBuf> {
    let name = log.file_name()?.to_str()?;
    let other = if name.contains("_DR") { name.replace("_DR", "_TD") } else { name.replace("_TD", "_DR") };
    Some(log.with_file_name(other))
}

fn write_page(
    outputs: &Outputs,
    log: &Log,
    found: &Run,
    robot: &Robot,
    map_from_survey: Option<Se2>,
    smoothed: &[cairn_geometry::Vec3],
) -> Result<(), Failure> {
    outputs.write("--out", || {
        let facts: Vec<(String, String)> =
            rows(robot).into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let title = format!("{}, {}", log.name, found.robot);
        let survey = map_from_survey.as_ref();
        Ok(page(&title, &facts, found, &log.surveyed, survey, Some(smoothed)).into_bytes())
    })
}

fn rows(r: &Robot) -> Vec<(&'static str, String)> {
    let cm = |v: Option<f64>| v.map(|m| format!("{:.1} cm", 100.0 * m));
    let mut rows = vec![
        ("sightings", format!("{} taken, {} rejected, {} recoveries", r.taken, r.rejected, r.recoveries)),
        ("landmarks", format!("{} from {} poses", r.landmarks, r.poses)),
        (
            "NIS",
            format!("{:.2} a degree of freedom, {:.1} % within 95 %", r.nis_per_dof, 100.0 * r.nis_within_95),
        ),
    ];
    let optional = [
        ("survey", cm(r.landmark_rmse_m).map(|v| format!("landmarks {v} RMSE"))),
        (
            "smoothed",
            cm(r.smoothed_landmark_rmse_m).map(|v| format!("landmarks {v} RMSE against the survey")),
        ),
        ("position", cm(r.position_rmse_m).map(|v| format!("{v} RMSE live against smoothing"))),
        ("map", cm(r.landmarks_to_smoothed_m).map(|v| format!("{v} RMSE against smoothing"))),
        ("truth", cm(r.ate_m).map(|v| format!("{v} RMSE live (ATE)"))),
        ("NEES", r.nees.map(|n| format!("{n:.2} against the truth (3 expected)"))),
        ("wrong", r.wrong_associations.map(|w| format!("{:.1} % of the associations", 100.0 * w))),
    ];
    rows.extend(optional.into_iter().filter_map(|(name, value)| Some((name, value?))));
    rows.push(("time", format!("{:.0} ms", r.filter_ms)));
    rows
}

fn text(m: &Mapped) -> String {
    let mut lines = vec![m.log.clone()];
    for r in &m.robots {
        lines.push(r.name.clone());
        lines.extend(rows(r).iter().map(|(name, value)| format!("  {name:<10}{value}")));
    }
    if let Some(j) = &m.joint {
        lines.push(format!("one map of {}", j.robots.join(", ")));
        let survey = j.landmark_rmse_m.map_or_else(String::new, |v| format!(", {:.1} cm RMSE", 100.0 * v));
        lines.push(format!("  {:<10}{}{survey}", "landmarks", j.landmarks));
        lines.push(format!("  {:<10}{} of each other", "sightings", j.mutual_sightings));
    }
    lines.extend(m.notes.iter().map(|note| format!("note: {note}")));
    lines.join("\n")
}
