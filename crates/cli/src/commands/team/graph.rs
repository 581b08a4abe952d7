//! `cairn team graph`: robots agree on one pose graph by exchanging messages, beside one solver that sees everything.

use super::super::solve::HINT;
use crate::failure::Failure;
use crate::number::number;
use crate::output::Output;
use cairn_solve::g2o::{self, Graph};
use cairn_solve::graph::{Metric, Rigid};
use cairn_team::files::{ReadError, TeamGraphs, read, relative_only};
use cairn_team::{Exchange, JudgeConfig, LoopId, NetworkConfig, RobotGraph, RobotId, Round, Verdict, split};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Optimizes a pose graph that is spread over several robots, without a coordinator: each sends a condensed graph of its own
/// poses to all others and solves for the poses they share.
///
/// Give one g2o file for each robot (or their folder), or one file with --robots to split it. Loops between robots are tested for
/// consistency first, and false ones are left out; a graph that is split is believed as it is. The network is simulated; bytes are
/// those of the encoded messages.
#[derive(clap::Args)]
pub struct Arguments {
    /// One g2o file a robot, a folder of them, or one file to be split.
    #[arg(required = true, value_name = "FILE|FOLDER")]
    inputs: Vec<PathBuf>,
    /// Splits a single file among this many robots.
    #[arg(long, value_name = "N")]
    robots: Option<usize>,
    /// How often everyone sends a message to everyone.
    #[arg(long, default_value_t = 6, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    exchanges: u32,
    /// Believes every loop between robots.
    #[arg(long)]
    believe_all: bool,
    /// Leaves out lines that are neither poses nor measured between two (points that were seen, poses known in the world).
    #[arg(long)]
    ignore_unknown: bool,
    /// Part of the messages that are lost.
    #[arg(long, default_value_t = 0.0, value_name = "PART", value_parser = number(0.0..1.0, "a number from 0 to below 1"))]
    loss: f64,
    /// Part of the messages that arrive one to three exchanges late.
    #[arg(long, default_value_t = 0.0, value_name = "PART", value_parser = number(0.0..1.0, "a number from 0 to below 1"))]
    late: f64,
    /// Part of the messages that arrive twice.
    #[arg(long, default_value_t = 0.0, value_name = "PART", value_parser = number(0.0..1.0, "a number from 0 to below 1"))]
    twice: f64,
    /// Seed of the network's chance.
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
}

/// One exchange.
#[derive(Serialize)]
struct Exchanged {
    chi2: f64,
    /// How far above the central optimum, as a part of it.
    above: f64,
    sent_max: usize,
    sent_mean: f64,
    received_max: usize,
    refused: usize,
    cpu_ms_max: f64,
    cpu_ms_mean: f64,
}

/// One robot after all exchanges.
#[derive(Serialize)]
struct RobotTotals {
    robot: u16,
    poses: usize,
    sends_poses: usize,
    sent: usize,
    received: usize,
    cpu_ms: f64,
}

/// When the team came near the optimum.
#[derive(Serialize)]
struct Reached {
    within: f64,
    exchanges: usize,
    /// Bytes that a robot sent until then, of the one that sent most.
    sent_max: usize,
    received_max: usize,
}

/// The printed result.
#[derive(Serialize)]
struct Agreed {
    robots: Vec<RobotTotals>,
    dimensions: usize,
    poses: usize,
    measurements: usize,
    loops: usize,
    rejected: Vec<[String; 2]>,
    /// Loops that were rejected because too few between the two robots agree with them.
    unsupported: usize,
    /// The robots that share a frame, for each frame; poses in different frames mean nothing to each other.
    frames: Vec<Vec<RobotId>>,
    /// Squares of standard deviations of loops are too small by this factor; missing when all were believed.
    scale: Option<f64>,
    central_chi2: f64,
    central_ms: f64,
    /// By how much the optimum may be above the global one, as a part of it, for SE-Sync's objective minimised from the team's
    /// poses; missing where no bound was found.
    certified_gap: Option<f64>,
    certificate_ms: f64,
    exchanges: Vec<Exchanged>,
    reached: Vec<Reached>,
}

/// Reads, exchanges, prints.
///
/// # Errors
/// When a file is invalid or the graphs are not those of a team.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    let files = files_of(&arguments.inputs)?;
    let texts =
        files.iter().map(|f| super::super::solve::text_of(f, "g2o")).collect::<Result<Vec<_>, _>>()?;
    let team = match arguments.robots {
        Some(robots) if files.len() == 1 => divided(&files[0], &texts[0], robots, arguments.ignore_unknown)?,
        Some(_) => {
            let why = format!("{} files are as many robots", files.len());
            return Err(Failure::usage("--robots", why, "give one file to split it, or leave --robots out"));
        }
        None if files.len() == 1 => {
            let why = "one file is one robot";
            return Err(Failure::usage(files[0].display().to_string(), why, "give --robots N to split it"));
        }
        None => {
            let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
            read(&texts, arguments.ignore_unknown).map_err(|e| failure(&files, &e))?
        }
    };
    let agreed = match &team {
        TeamGraphs::Plane(team) => agree(team, arguments),
        TeamGraphs::Space(team) => agree(team, arguments),
    }?;
    output.result(&agreed, summary)
}

/// The files meant, those of a folder by rising number.
fn files_of(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let [folder] = inputs else { return Ok(inputs.to_vec()) };
    if !folder.is_dir() {
        return Ok(inputs.to_vec());
    }
    let name = folder.display().to_string();
    let entries = std::fs::read_dir(folder)
        .map_err(|e| Failure::new(&name, e.to_string(), "check the folder and its permissions"))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "g2o"))
        .collect();
    let number = |p: &Path| p.file_stem().and_then(|s| s.to_str()).and_then(|s| s.parse::<u64>().ok());
    files.sort_by_key(|p| (number(p).is_none(), number(p), p.clone()));
    match files.is_empty() {
        true => Err(Failure::new(name, "no .g2o file is in it", "give a folder with one g2o file a robot")),
        false => Ok(files),
    }
}

fn divided(file: &Path, text: &str, robots: usize, leave_out: bool) -> Result<TeamGraphs, Failure> {
    let name = file.display().to_string();
    let text = relative_only(text, leave_out).map_err(|e| failure(&[file.to_owned()], &e))?;
    let g2o = g2o::read_nearest(&text)
        .map_err(|e| Failure::new(format!("{name}, line {}", e.line), e.reason, HINT))?;
    let hint = "choose from 1 robot to as many as there are poses";
    let team = match &g2o.graph {
        Graph::Plane(named) => split(&named.graph, robots).map(TeamGraphs::Plane),
        Graph::Space(named) => split(&named.graph, robots).map(TeamGraphs::Space),
    };
    team.map_err(|e| Failure::new(name, e.to_string(), hint))
}

fn failure(files: &[PathBuf], error: &ReadError) -> Failure {
    let hint = "give one g2o file a robot: its own vertices, its edges, and edges to vertices of the others";
    match error {
        ReadError::Text { text, line, reason } => {
            let file = files.get(*text).map_or_else(String::new, |f| f.display().to_string());
            Failure::new(format!("{file}, line {line}"), reason.clone(), hint)
        }
        ReadError::LeftOut(_) => {
            Failure::new("the team", error.to_string(), "give --ignore-unknown to agree without them")
        }
        other => Failure::new("the team", other.to_string(), hint),
    }
}

fn agree<G: Rigid<D>, const D: usize>(
    team: &[RobotGraph<G, D>],
    arguments: &Arguments,
) -> Result<Agreed, Failure> {
    let network = NetworkConfig {
        loss: arguments.loss,
        delayed: arguments.late,
        delay_rounds: 3,
        duplicated: arguments.twice,
        seed: arguments.seed,
    };
    let judge = (arguments.robots.is_none() && !arguments.believe_all).then(JudgeConfig::default);
    let fail = |e: cairn_team::RobotError| {
        Failure::new("the team", e.to_string(), "check that each robot's measurements determine its poses")
    };
    let mut exchange = Exchange::new(team, network, judge).map_err(fail)?;
    let mut rounds = Vec::new();
    for _ in 0..arguments.exchanges {
        rounds.push(exchange.round(cpu_s).map_err(fail)?);
    }
    let rejected = exchange.rejected();
    let central = exchange.central_graph();
    let began = cpu_s();
    let optimum = central.optimum(&rejected);
    let central_ms = (cpu_s() - began) * 1e3;
    let central_chi2 = 2.0 * optimum.cost(Metric::Geodesic);
    let reached_chi2: Vec<f64> =
        exchange.history().iter().map(|poses| central.chi2(poses, &rejected)).collect();
    let above: Vec<f64> = reached_chi2.iter().map(|chi2| above(*chi2, central_chi2)).collect();
    let began = cpu_s();
    let last = exchange.history().last();
    let certified_gap = last.and_then(|poses| Some(central.certificate(poses, &rejected)?.gap()));
    let certificate_ms = (cpu_s() - began) * 1e3;
    let exchanges = rounds.iter().zip(&reached_chi2).zip(&above);
    let scale = exchange.robots().first().map(|r| r.judgement().scale).filter(|_| judge.is_some());
    let unsupported = |id: &&LoopId| {
        let verdicts = exchange.robots().iter().filter_map(|r| r.judgement().verdicts.get(*id));
        verdicts.into_iter().any(|v| matches!(v, Verdict::Unsupported { .. }))
    };
    let robots = exchange.robots().iter().map(|r| r.id()).collect();
    let believed = central.loops.iter().flatten().filter(|id| !rejected.contains(id));
    Ok(Agreed {
        frames: frames(robots, believed),
        unsupported: rejected.iter().filter(unsupported).count(),
        robots: totals(&exchange, &rounds),
        dimensions: if D == 3 { 2 } else { 3 },
        poses: central.ids.len(),
        measurements: central.graph.edges().len(),
        loops: central.loops.iter().flatten().count(),
        rejected: rejected.iter().map(named).collect(),
        scale,
        central_chi2,
        central_ms,
        certified_gap: certified_gap.filter(|gap| gap.is_finite()),
        certificate_ms,
        exchanges: exchanges.map(|((round, chi2), above)| exchanged(round, *chi2, *above)).collect(),
        reached: [1e-2, 1e-3, 1e-6].iter().filter_map(|within| reached(*within, &above, &rounds)).collect(),
    })
}

/// The robots that loops connect, for each frame that they share.
fn frames<'a>(robots: Vec<RobotId>, loops: impl Iterator<Item = &'a LoopId>) -> Vec<Vec<RobotId>> {
    let mut first: BTreeMap<RobotId, RobotId> = robots.into_iter().map(|r| (r, r)).collect();
    for (a, b) in loops {
        if let (Some(a), Some(b)) = (first.get(&a.robot).copied(), first.get(&b.robot).copied()) {
            first.values_mut().filter(|f| **f == a.max(b)).for_each(|f| *f = a.min(b));
        }
    }
    let frames: BTreeSet<RobotId> = first.values().copied().collect();
    let of = |frame| first.iter().filter(|(_, f)| **f == frame).map(|(r, _)| *r).collect();
    frames.into_iter().map(of).collect()
}

/// How far above the optimum, as a part of it; of an optimum that is zero to rounding, as it is.
fn above(chi2: f64, optimum: f64) -> f64 {
    if optimum > 1e-9 { chi2 / optimum - 1.0 } else { chi2 - optimum }
}

fn named(id: &LoopId) -> [String; 2] {
    [id.0, id.1].map(|p| format!("{}:{}", p.robot, p.seq))
}

fn totals<G: Rigid<D>, const D: usize>(exchange: &Exchange<G, D>, rounds: &[Round]) -> Vec<RobotTotals> {
    let robot = |(k, r): (usize, &cairn_team::Robot<G, D>)| RobotTotals {
        robot: r.id(),
        poses: r.own_poses().count(),
        sends_poses: r.shares(),
        sent: rounds.iter().map(|round| round.sent[k]).sum(),
        received: rounds.iter().map(|round| round.received[k]).sum(),
        cpu_ms: rounds.iter().map(|round| round.cpu_s[k] * 1e3).sum(),
    };
    exchange.robots().iter().enumerate().map(robot).collect()
}

fn exchanged(round: &Round, chi2: f64, above: f64) -> Exchanged {
    let n = round.sent.len().max(1) as f64;
    Exchanged {
        chi2,
        above,
        sent_max: round.sent.iter().copied().max().unwrap_or(0),
        sent_mean: round.sent.iter().sum::<usize>() as f64 / n,
        received_max: round.received.iter().copied().max().unwrap_or(0),
        refused: round.refused,
        cpu_ms_max: 1e3 * round.cpu_s.iter().copied().fold(0.0, f64::max),
        cpu_ms_mean: 1e3 * round.cpu_s.iter().sum::<f64>() / n,
    }
}

/// The first exchange from which on the team stays within a part of the optimum.
fn reached(within: f64, above: &[f64], rounds: &[Round]) -> Option<Reached> {
    let exchanges = above.iter().rposition(|a| a.is_nan() || *a > within).map_or(1, |k| k + 2);
    let done = rounds.get(..exchanges)?;
    let robots = done.first()?.sent.len();
    let most = |of: fn(&Round) -> &Vec<usize>| {
        (0..robots).map(|k| done.iter().map(|r| of(r)[k]).sum::<usize>()).max().unwrap_or(0)
    };
    Some(Reached { within, exchanges, sent_max: most(|r| &r.sent), received_max: most(|r| &r.received) })
}

/// Seconds that this thread has computed.
#[cfg(unix)]
fn cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Seconds since the first call.
#[cfg(not(unix))]
fn cpu_s() -> f64 {
    static BEGAN: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    BEGAN.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

fn summary(a: &Agreed) -> String {
    let kind = if a.dimensions == 2 { "in the plane" } else { "in space" };
    let mut lines = vec![
        format!(
            "team        {} robots, {} poses {kind}, {} measurements, {} loops between robots",
            a.robots.len(),
            a.poses,
            a.measurements,
            a.loops
        ),
        format!("central     chi2 {:.6} in {:.1} ms", a.central_chi2, a.central_ms),
    ];
    if let Some(scale) = a.scale {
        lines.push(format!(
            "rejected    {} of {} loops (variances taken {scale:.1} times as large as stated)",
            a.rejected.len(),
            a.loops
        ));
        lines.extend(a.rejected.chunks(8).map(|row| {
            let row: Vec<String> = row.iter().map(|[a, b]| format!("{a}-{b}")).collect();
            format!("            {}", row.join(" "))
        }));
    }
    if a.unsupported > 0 {
        lines.push(format!(
            "note        {} loops were rejected because fewer than {} between the two robots agree; --believe-all takes them",
            a.unsupported,
            JudgeConfig::default().agreeing
        ));
    }
    if a.frames.len() > 1 {
        let frames: Vec<String> = a.frames.iter().map(|f| format!("{f:?}")).collect();
        lines.push(format!(
            "note        no loop that is believed connects the robots {}: poses of one mean nothing to the others",
            frames.join(" and ")
        ));
    }
    lines.push(String::new());
    lines.push(
        "exchange            chi2     above   sent/robot max    mean  received max  ms/robot max   mean"
            .into(),
    );
    for (k, e) in a.exchanges.iter().enumerate() {
        lines.push(format!(
            "{:>8} {:>15.6} {:>9.1e} {:>16} {:>7.0} {:>13} {:>13.1} {:>6.1}",
            k + 1,
            e.chi2,
            e.above,
            e.sent_max,
            e.sent_mean,
            e.received_max,
            e.cpu_ms_max,
            e.cpu_ms_mean
        ));
    }
    lines.push(String::new());
    if a.reached.is_empty() {
        lines.push("reached     not within 1 % of the central optimum: try more --exchanges".into());
    }
    lines.extend(a.reached.iter().map(|r| {
        format!(
            "within {:<7} after {} exchanges; a robot sent at most {:.1} kB and received at most {:.1} kB",
            format!("{:.0e}", r.within),
            r.exchanges,
            r.sent_max as f64 / 1e3,
            r.received_max as f64 / 1e3
        )
    }));
    lines.push(match a.certified_gap {
        Some(gap) => format!(
            "certified   from here SE-Sync's objective reaches within {gap:.0e} of its global minimum ({:.0} ms)",
            a.certificate_ms
        ),
        None => "certified   no: this may be a local optimum".into(),
    });
    lines.join("\n")
}
