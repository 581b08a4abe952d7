//! `kills`: each process of an isolated run killed at random moments, on 7scenes-kitchen with depth; this program is its own worker.
//!
//! After every run: all frames are there once and in order, whole, in one map. Where SLAM lived, the surface is bit for bit that
//! of a run in which nothing dies.

use crate::MeasureError;
use crate::error::of;
use cairn_dense::{SubmapConfig, TsdfConfig, write_ply};
use cairn_engine::{Config, DenseMapper, Runner};
use cairn_random::Random;
use cairn_sensor::Source;
use cairn_sources::{OpenOptions, open};
use cairn_workers::capture::rest_of;
use cairn_workers::message::{Failure, Outcome, SurfaceInput};
use cairn_workers::{
    Role, RunEvent, RunFolder, SHARED_MEMORY, Supervised, Supervision, capture, dense, slam, supervise,
};
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Frames of a run.
const FRAMES: usize = 200;
/// The processes.
const ROLES: [Role; 3] = [Role::Capture, Role::Slam, Role::Dense];
/// Tells a worker where the recording is.
const RECORDING: &str = "CAIRN_BENCH_RECORDING";

/// What became of a process that was killed again and again.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The process.
    pub process: &'static str,
    /// How often it was killed.
    pub kills: usize,
    /// Seconds until the next process was started, each time.
    pub started_s: Vec<f64>,
    /// Seconds until it did what it did before, each time: SLAM has a pose, dense the depth of all key frames.
    pub back_s: Vec<f64>,
    /// Frames that are missing or were not read whole.
    pub lost: usize,
    /// Frames without a pose.
    pub without_pose: usize,
    /// Runs with more than one map.
    pub new_maps: usize,
    /// Runs whose surface has other bytes than that of a run in which nothing dies; `None` where the poses are others.
    pub other_surface: Option<usize>,
}

/// Kills each process so often.
///
/// # Errors
/// Without the recording or shared memory, or when a run fails.
pub fn run(data: &Path, times: usize) -> Result<Vec<Row>, MeasureError> {
    let recording = data.join("7scenes-kitchen");
    if !recording.is_dir() {
        return Err(of(recording.display(), "not found"));
    }
    eprintln!("kills: none ...");
    let whole = once(&recording, &mut |_, _| ())?.1;
    ROLES.into_iter().map(|role| killed(&recording, role, times, &whole)).collect()
}

fn killed(recording: &Path, role: Role, times: usize, whole: &[u8]) -> Result<Row, MeasureError> {
    eprintln!("kills: {} ...", role.name());
    let mut random = Random::new(11);
    let mut row = Row {
        process: role.name(),
        kills: 0,
        started_s: Vec::new(),
        back_s: Vec::new(),
        lost: 0,
        without_pose: 0,
        new_maps: 0,
        other_surface: (role != Role::Slam).then_some(0),
    };
    while row.kills < times {
        let (mut due, mut since) = (random.below(25) as u64, None);
        let (run, surface) = once(recording, &mut |told, ids| match told {
            RunEvent::Tracked(frame) if frame.number >= due && row.kills < times && since.is_none() => {
                // At any moment of the frames after.
                std::thread::sleep(Duration::from_micros(random.below(30_000) as u64));
                let id = ids.get(&role).and_then(|id| Pid::from_raw(*id as i32));
                // Capture that has delivered its last frame is gone.
                if id.is_some_and(|id| kill_process(id, Signal::KILL).is_ok()) {
                    (since, row.kills) = (Some(Instant::now()), row.kills + 1);
                }
                due = frame.number + 8 + random.below(25) as u64;
            }
            RunEvent::Started { role: started, .. } if *started == role => {
                row.started_s.extend(since.take().map(|at| at.elapsed().as_secs_f64()));
            }
            RunEvent::Relocalised { after_s, .. } => row.back_s.push(*after_s),
            RunEvent::DenseResumed { after_s, .. } => row.back_s.push(*after_s),
            _ => {}
        })?;
        let read_whole = run.frames.iter().filter(|f| matches!(f.outcome, Outcome::State(_))).count();
        row.lost += FRAMES.saturating_sub(read_whole);
        row.without_pose += run.frames.iter().filter(|f| f.pose.is_none()).count();
        row.new_maps += usize::from(run.map.snapshot.maps().count() != 1);
        row.other_surface = row.other_surface.map(|n| n + usize::from(surface != whole));
    }
    Ok(row)
}

/// A run, and the bytes of its surface.
fn once(
    recording: &Path,
    tell: &mut dyn FnMut(&RunEvent, &BTreeMap<Role, u32>),
) -> Result<(Supervised, Vec<u8>), MeasureError> {
    let folder = RunFolder::create(Path::new(SHARED_MEMORY)).map_err(|e| of(SHARED_MEMORY, e))?;
    let program = std::env::current_exe()?;
    let recording = recording.to_owned();
    let command = move |role: Role| {
        let mut command = Command::new(&program);
        command.args(["worker", role.name()]).env(RECORDING, &recording);
        command
    };
    let limit = Duration::from_secs(5);
    let how = Supervision {
        command: Box::new(command),
        hang_limit: limit,
        late_limit: limit,
        guide: false,
        records: false,
        surfaces: Some(SurfaceInput::Depth),
    };
    let mut ids = BTreeMap::new();
    let run = supervise(&how, &folder, &AtomicBool::new(false), &mut |told| {
        if let RunEvent::Started { role, id } = told {
            ids.insert(role, id);
        }
        tell(&told, &ids);
    });
    let run = run?;
    if let Err(e) = &run.surfaces {
        return Err(MeasureError::from(e.to_string()));
    }
    let surface = std::fs::read(folder.path().join(dense::SURFACE))?;
    Ok((run, surface))
}

/// Does the work of one process for [`run`].
///
/// # Errors
/// When the role is unknown. What fails later is told to the supervisor.
pub fn work(role: &str) -> Result<(), MeasureError> {
    let role =
        Role::named(role).ok_or_else(|| MeasureError::from(format!("there is no process '{role}'")))?;
    cairn_workers::die_with_parent();
    let (from, to) = (std::io::stdin(), std::io::stdout());
    let mut config = Config::default();
    config.inertial.enabled = false;
    match role {
        Role::Capture => capture::run(from, to, false, |delivered| {
            let source = delivered.map_or_else(source, |d| rest_of(source()?, &d))?;
            Ok((source, "rgbd".to_owned()))
        }),
        Role::Slam => slam::run(from, to, &config, Runner::Lockstep),
        Role::Dense => dense::run(from, to, || {
            let (config, saved) = (SubmapConfig::default(), Vec::new());
            Ok(dense::Work { config, saved, surface: Some(surface) })
        }),
        Role::Guide | Role::Walk => return Err(format!("{} is not measured here", role.name()).into()),
    }
    Ok(())
}

fn source() -> Result<Box<dyn Source>, Failure> {
    let recording = std::env::var_os(RECORDING).map(PathBuf::from).unwrap_or_default();
    let options = OpenOptions { frames: Some(FRAMES), ..OpenOptions::default() };
    Ok(open(&recording.to_string_lossy(), options)?)
}

fn surface(mapper: &mut DenseMapper, _: bool) -> Result<Vec<u8>, Failure> {
    let none = |why: String| Failure::new("the surface", why, "look at the recording");
    let map = mapper.largest_map().ok_or_else(|| none("there is no map".into()))?;
    let mesh = mapper.surface(map, TsdfConfig::default()).map_err(|e| none(e.to_string()))?;
    let mut bytes = Vec::new();
    write_ply(&mesh, &mut bytes).map_err(|e| none(e.to_string()))?;
    Ok(bytes)
}

/// The rows as a table.
pub fn table(rows: &[Row]) -> String {
    let mut out = format!(
        "7scenes-kitchen, RGB-D, {FRAMES} frames a run, `kill -9` at random moments; median, worst\n\n\
         | process | kills | the next is started, s | it works again, s | frames lost | frames without a pose | runs with a new map | \
         runs with another surface |\n|---|---|---|---|---|---|---|---|\n"
    );
    for row in rows {
        let (started, back) = (words(&row.started_s), words(&row.back_s));
        let surface = row.other_surface.map_or("-".into(), |n| n.to_string());
        let _ = writeln!(
            out,
            "| {} | {} | {started} | {back} | {} | {} | {} | {surface} |",
            row.process, row.kills, row.lost, row.without_pose, row.new_maps
        );
    }
    out
}

fn words(seconds: &[f64]) -> String {
    let mut s = seconds.to_vec();
    s.sort_by(f64::total_cmp);
    s.last().map_or("-".into(), |last| format!("{:.3}, {last:.3}", s[s.len() / 2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_tells_median_and_worst_and_what_was_lost() {
        let row = Row {
            process: "dense",
            kills: 3,
            started_s: vec![0.3, 0.1, 0.2],
            back_s: Vec::new(),
            lost: 4,
            without_pose: 5,
            new_maps: 6,
            other_surface: Some(7),
        };
        assert!(table(&[row]).ends_with("| dense | 3 | 0.200, 0.300 | - | 4 | 5 | 6 | 7 |\n"));
    }
}
