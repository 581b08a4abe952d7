//! The tests, and the workers that they start.

use cairn_dense::{SubmapConfig, TsdfConfig, write_ply};
use cairn_engine::{Config, DenseMapper, Engine, Host, PoseTime, Runner, SensorMode};
use cairn_random::Random;
use cairn_sensor::Source;
use cairn_sources::{OpenOptions, open};
use cairn_workers::capture::rest_of;
use cairn_workers::message::{Failure, Outcome, SurfaceInput};
use cairn_workers::{
    Role, RunEvent, RunFolder, SuperviseError, Supervised, Supervision, capture, dense, slam, supervise,
};
use rustix::process::{Pid, Signal, kill_process};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

const FRAMES: usize = 150;

pub fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        Some("worker") => worker(arguments.get(1).and_then(|name| Role::named(name)).expect("a role")),
        filter => tests(filter.unwrap_or_default()),
    }
}

fn tests(filter: &str) {
    let all: [(&str, fn()); 9] = [
        ("result_equals_that_of_one_process", result_equals_that_of_one_process),
        ("killed_processes_go_on", killed_processes_go_on),
        ("stopped_process_is_started_again", stopped_process_is_started_again),
        ("process_beyond_its_memory_is_started_again", process_beyond_its_memory_is_started_again),
        ("crash_loop_backs_off_and_is_given_up", crash_loop_backs_off_and_is_given_up),
        ("failure_of_a_worker_is_told", failure_of_a_worker_is_told),
        ("run_folder_is_removed", run_folder_is_removed),
        ("surface_is_the_same_whatever_becomes_of_dense", surface_is_the_same_whatever_becomes_of_dense),
        ("run_goes_on_where_depth_cannot_be_kept", run_goes_on_where_depth_cannot_be_kept),
    ];
    if data().is_none() {
        println!("skipped: processes on a recording: no euroc-mh01 in CAIRN_DATA");
        return;
    }
    for (name, test) in all.iter().filter(|(name, _)| filter.starts_with('-') || name.contains(filter)) {
        let began = Instant::now();
        test();
        println!("test {name} ... ok ({:.1} s)", began.elapsed().as_secs_f64());
    }
}

fn data() -> Option<PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let folder = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(root), PathBuf::from);
    let name = if with_depth() { "7scenes-kitchen" } else { "euroc-mh01" };
    Some(folder.join(name)).filter(|path| path.is_dir())
}

/// A worker of a run with depth and surfaces.
fn with_depth() -> bool {
    std::env::var_os("WITH_DEPTH").is_some()
}

fn source() -> Box<dyn Source> {
    let all = open(data().unwrap().to_str().unwrap(), OpenOptions::default()).unwrap();
    let mut rig = all.rig().clone();
    rig.imu = None;
    let options = OpenOptions { rig: Some(rig), frames: Some(FRAMES), ..OpenOptions::default() };
    open(data().unwrap().to_str().unwrap(), options).unwrap()
}

fn worker(role: Role) {
    cairn_workers::die_with_parent();
    let (from, to) = (std::io::stdin(), std::io::stdout());
    match role {
        Role::Capture if std::env::var_os("NO_SOURCE").is_some() => {
            capture::run(from, to, false, |_| Err(Failure::new("the camera", "it is in use", "close it")));
        }
        Role::Capture => capture::run(from, to, false, |delivered| {
            let source = delivered.map_or_else(|| Ok(source()), |d| rest_of(source(), &d))?;
            Ok((source, if with_depth() { "rgbd" } else { "stereo" }.to_owned()))
        }),
        Role::Dense if std::env::var_os("DIES_AT_THE_END").is_some() => dense::run(from, to, || {
            let surface = |_: &mut DenseMapper, _| std::process::exit(3);
            Ok(dense::Work { config: in_colour(), saved: Vec::new(), surface: Some(surface) })
        }),
        Role::Dense => dense::run(from, to, || {
            Ok(dense::Work { config: in_colour(), saved: Vec::new(), surface: Some(surface) })
        }),
        Role::Slam => {
            let bound_mb = std::env::var("BOUND_MB").ok().and_then(|mb| mb.parse::<u64>().ok());
            match bound_mb {
                Some(mb) => {
                    cairn_workers::limit_memory(mb * 1_000_000).unwrap();
                    slam::run(from, Leaks { to, hoard: Vec::new() }, &Config::default(), Runner::Lockstep);
                }
                None => slam::run(from, to, &Config::default(), Runner::Lockstep),
            }
        }
        Role::Guide | Role::Walk => unreachable!("no test here has a guide"),
    }
}

/// A pipe with a leak: every message costs four more megabytes.
struct Leaks<W> {
    to: W,
    hoard: Vec<Vec<u8>>,
}

impl<W: Write> Write for Leaks<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.to.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.hoard.push(vec![1; 4_000_000]);
        self.to.flush()
    }
}

fn this_program(role: Role) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["worker", role.name()]);
    command
}

/// A run of the recording; `tell` may kill processes, whose ids it is given.
fn run(tell: impl FnMut(&RunEvent, &BTreeMap<Role, u32>)) -> Result<Supervised, SuperviseError> {
    run_with(this_program, Duration::from_secs(1), tell)
}

fn run_with(
    command: impl Fn(Role) -> Command + 'static,
    hang_limit: Duration,
    mut tell: impl FnMut(&RunEvent, &BTreeMap<Role, u32>),
) -> Result<Supervised, SuperviseError> {
    let folder = RunFolder::create(&std::env::temp_dir()).unwrap();
    supervised(command, hang_limit, &folder, false, &mut tell)
}

fn supervised(
    command: impl Fn(Role) -> Command + 'static,
    hang_limit: Duration,
    folder: &RunFolder,
    dense: bool,
    tell: &mut dyn FnMut(&RunEvent, &BTreeMap<Role, u32>),
) -> Result<Supervised, SuperviseError> {
    let how = Supervision {
        command: Box::new(command),
        hang_limit,
        late_limit: hang_limit,
        guide: false,
        records: false,
        surfaces: dense.then_some(SurfaceInput::DepthAndGray),
    };
    let mut ids = BTreeMap::new();
    supervise(&how, folder, &AtomicBool::new(false), &mut |told| {
        if let RunEvent::Started { role, id } = told {
            ids.insert(role, id);
        }
        tell(&told, &ids);
    })
}

fn signal(id: u32, signal: Signal) {
    kill_process(Pid::from_raw(id as i32).unwrap(), signal).unwrap();
}

/// Every frame is there once and in order, none torn or overtaken.
fn no_frame_is_lost(run: &Supervised) {
    let numbers: Vec<u64> = run.frames.iter().map(|f| f.number).collect();
    assert_eq!(numbers, (0..FRAMES as u64).collect::<Vec<_>>());
    assert!(run.frames.windows(2).all(|w| w[0].stamp < w[1].stamp));
    assert!(run.frames.iter().all(|f| matches!(f.outcome, Outcome::State(_))), "a frame was not read whole");
}

fn result_equals_that_of_one_process() {
    let mut source = source();
    let (rate_hz, rig) = (source.info().rate_hz, source.rig().clone());
    let mut config = Config::default();
    config.inertial.enabled = false;
    let mut engine =
        Engine::new(&rig, SensorMode::Stereo, rate_hz, Runner::Lockstep, &config, &Host::bare()).unwrap();
    while let Some(packet) = source.next_packet().unwrap() {
        engine.on_packet(&packet).unwrap();
    }
    let live = engine.live_trajectory();
    engine.finish();
    let isolated = run(|_, _| ()).unwrap();
    no_frame_is_lost(&isolated);
    assert!(isolated.deaths.is_empty());
    assert_eq!(isolated.camera_poses(PoseTime::Live).trajectory(), live, "the poses as they were told");
    assert_eq!(
        isolated.camera_poses(PoseTime::Corrected).trajectory(),
        engine.trajectory(),
        "the poses in the end"
    );
    assert_eq!(isolated.map.snapshot.landmark_count(), engine.snapshot().landmark_count());
}

fn killed_processes_go_on() {
    let mut rng = Random::new(7);
    for role in [Role::Slam, Role::Capture] {
        let at = 30 + rng.below(90) as u64;
        let mut maps = Vec::new();
        let killed = run(|told, ids| match told {
            RunEvent::Tracked(frame) if frame.number == at => signal(ids[&role], Signal::KILL),
            RunEvent::Resumed { key_frames, .. } => maps.push(*key_frames),
            _ => {}
        });
        let killed = killed.unwrap();
        no_frame_is_lost(&killed);
        let deaths: Vec<_> = killed.deaths.iter().map(|d| (d.role, d.how.as_str())).collect();
        assert_eq!(deaths, [(role, "it was killed (signal 9)")]);
        let posed = killed.frames.iter().filter(|f| f.pose.is_some()).count();
        println!(
            "  {} at frame {at}: {posed} of {FRAMES} frames with a pose, {:?}",
            role.name(),
            killed.relocalised
        );
        assert!(posed >= FRAMES - 2, "{posed} of {FRAMES} frames have a pose");
        assert_eq!(killed.map.snapshot.maps().count(), 1, "the place was recognised: no new map began");
        if role == Role::Slam {
            assert!(maps.len() == 1 && maps[0] >= 3, "SLAM went on in a map of {maps:?} key frames");
            let [(frames, after_s)] = killed.relocalised[..] else { panic!("{:?}", killed.relocalised) };
            assert!(frames <= 2 && after_s < 2.0, "{frames} frames, {after_s} s");
        }
    }
}

fn in_colour() -> SubmapConfig {
    let tsdf = TsdfConfig { colour: true, ..TsdfConfig::default() };
    SubmapConfig { tsdf, ..SubmapConfig::default() }
}

/// The largest map's surface.
fn surface(mapper: &mut DenseMapper, _: bool) -> Result<Vec<u8>, Failure> {
    let map = mapper.largest_map().expect("a map");
    let mesh = mapper.surface(map, in_colour().tsdf).expect("poses");
    let mut bytes = Vec::new();
    write_ply(&mesh, &mut bytes).expect("memory");
    Ok(bytes)
}

/// A run with depth, and the bytes of its surface.
fn with_surface(
    variable: &'static str,
    mut tell: impl FnMut(&RunEvent, &BTreeMap<Role, u32>),
) -> (Supervised, Option<Vec<u8>>) {
    let folder = RunFolder::create(&std::env::temp_dir()).unwrap();
    let command = move |role| {
        let mut command = this_program(role);
        command.env("WITH_DEPTH", "1").env(variable, "1");
        command
    };
    let run = supervised(command, Duration::from_secs(1), &folder, true, &mut tell).unwrap();
    let surface = std::fs::read(folder.path().join(dense::SURFACE)).ok();
    (run, surface)
}

/// Nobody waits for the process of surfaces, and the next one goes on from the same changes.
fn surface_is_the_same_whatever_becomes_of_dense() {
    let (whole, surface) = with_surface("WITH_DEPTH", |_, _| ());
    let images = |run: &Supervised| run.map.depth().unwrap().iter().map(|p| p.images.len()).sum::<usize>();
    assert!(whole.deaths.is_empty() && surface.as_ref().is_some_and(|bytes| bytes.len() > 100_000));
    assert!(images(&whole) >= 5 && images(&whole) >= whole.map.snapshot.key_frame_count());
    let mut resumed = Vec::new();
    let (killed, same) = with_surface("WITH_DEPTH", |told, ids| match told {
        RunEvent::Tracked(frame) if [20, 90, FRAMES as u64 - 1].contains(&frame.number) => {
            signal(ids[&Role::Dense], Signal::KILL)
        }
        RunEvent::DenseResumed { key_frames, .. } => resumed.push(*key_frames),
        _ => {}
    });
    no_frame_is_lost(&killed);
    println!("  dense went on with the depth of {resumed:?} key frames");
    assert!(resumed.len() == 3 && resumed[2] >= 5, "{resumed:?}");
    assert!(killed.deaths.len() == 3 && killed.deaths.iter().all(|d| d.role == Role::Dense));
    assert!(same == surface, "killed three times: another surface");
    assert_eq!(images(&killed), images(&whole));
    assert_eq!(
        killed.camera_poses(PoseTime::Corrected).trajectory(),
        whole.camera_poses(PoseTime::Corrected).trajectory()
    );
    let (hung, same) = with_surface("WITH_DEPTH", |told, ids| match told {
        RunEvent::Tracked(frame) if frame.number == 60 => signal(ids[&Role::Dense], Signal::STOP),
        _ => {}
    });
    no_frame_is_lost(&hung);
    let deaths: Vec<_> = hung.deaths.iter().map(|d| (d.role, d.how.as_str())).collect();
    assert_eq!(deaths, [(Role::Dense, "it did not answer for 1.0 s and was killed")]);
    assert!(same == surface, "stopped: another surface");
    // SLAM that dies takes no depth with it.
    let (slam, _) = with_surface("WITH_DEPTH", |told, ids| match told {
        RunEvent::Tracked(frame) if frame.number == 90 => signal(ids[&Role::Slam], Signal::KILL),
        _ => {}
    });
    no_frame_is_lost(&slam);
    assert!(images(&slam) >= slam.map.snapshot.key_frame_count(), "{} images", images(&slam));
    // One that dies again and again is given up, and the rest of the run is there.
    let (without, none) = with_surface("DIES_AT_THE_END", |_, _| ());
    no_frame_is_lost(&without);
    let why = without.surfaces.as_ref().unwrap_err().to_string();
    assert!(why.contains("died 7 times in a row: it ended with code 3"), "{why}");
    assert!(none.is_none());
    assert_eq!(
        without.camera_poses(PoseTime::Corrected).trajectory(),
        whole.camera_poses(PoseTime::Corrected).trajectory()
    );
}

/// Without a place for the depth of key frames there is no surface; the map and all poses are there.
fn run_goes_on_where_depth_cannot_be_kept() {
    let folder = RunFolder::create(&std::env::temp_dir()).unwrap();
    let log = folder.path().join("depth.log");
    let command = |role| {
        let mut command = this_program(role);
        command.env("WITH_DEPTH", "1");
        command
    };
    let mut spoil = |told: &RunEvent, ids: &BTreeMap<Role, u32>| match told {
        RunEvent::Tracked(frame) if frame.number == 60 => {
            std::fs::remove_file(&log).unwrap();
            std::fs::create_dir(&log).unwrap();
            signal(ids[&Role::Slam], Signal::KILL);
        }
        _ => {}
    };
    let run = supervised(command, Duration::from_secs(1), &folder, true, &mut spoil).unwrap();
    no_frame_is_lost(&run);
    let why = run.surfaces.as_ref().unwrap_err().to_string();
    assert!(why.contains("depth.log"), "{why}");
    assert!(run.map.snapshot.key_frame_count() > 5);
    assert!(run.deaths.iter().all(|death| death.role == Role::Slam), "{:?}", run.deaths);
}

fn stopped_process_is_started_again() {
    let mut stopped_at = None;
    let mut found_after = None;
    let stopped = run(|told, ids| match told {
        RunEvent::Tracked(frame) if frame.number == 60 && stopped_at.is_none() => {
            stopped_at = Some(Instant::now());
            signal(ids[&Role::Slam], Signal::STOP);
        }
        RunEvent::Died(_) => found_after = stopped_at.map(|at| at.elapsed().as_secs_f64()),
        _ => {}
    });
    let stopped = stopped.unwrap();
    no_frame_is_lost(&stopped);
    assert_eq!(stopped.deaths[0].how, "it did not answer for 1.0 s and was killed");
    let found_after = found_after.unwrap();
    assert!((0.9..1.5).contains(&found_after), "found after {found_after} s");
}

/// A process that needs more and more memory ends at its bound; the run goes on as if it had been killed.
fn process_beyond_its_memory_is_started_again() {
    const BOUND_MB: u64 = 500;
    let command = |role| {
        let mut command = this_program(role);
        command.env("BOUND_MB", BOUND_MB.to_string());
        command
    };
    let (mut most_mb, mut at) = (0, Vec::new());
    let bounded = run_with(command, Duration::from_secs(5), |told, ids| match told {
        RunEvent::Tracked(_) => most_mb = most_mb.max(ids.get(&Role::Slam).map_or(0, |id| data_mb(*id))),
        RunEvent::Died(death) => at.push(death.at_frame),
        _ => {}
    });
    let bounded = bounded.unwrap();
    println!("  bound {BOUND_MB} MB: SLAM had at most {most_mb} MB and died at frames {at:?}");
    no_frame_is_lost(&bounded);
    assert!(!bounded.deaths.is_empty(), "the bound did not act");
    for death in &bounded.deaths {
        assert_eq!(death.how, "it aborted (signal 6), as when its memory limit is reached");
    }
    assert!(most_mb <= BOUND_MB);
    let posed = bounded.frames.iter().filter(|f| f.pose.is_some()).count();
    assert!(posed >= FRAMES - 2 * bounded.deaths.len(), "{posed} of {FRAMES} frames have a pose");
    assert_eq!(bounded.map.snapshot.maps().count(), 1, "the place was recognised: no new map began");
}

/// What the bound counts of a process, MB; 0 where the system does not say.
fn data_mb(id: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmData:"));
    let kib = line.and_then(|l| l.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kib.unwrap_or(0) * 1024 / 1_000_000
}

fn crash_loop_backs_off_and_is_given_up() {
    let (mut waits, began) = (Vec::new(), Instant::now());
    let command = |role| match role {
        Role::Capture => this_program(role),
        _ => Command::new("false"),
    };
    let failed = run_with(command, Duration::from_secs(1), |told, _| {
        if let RunEvent::Waits { delay_s, .. } = told {
            waits.push(*delay_s);
        }
    });
    let why = failed.unwrap_err().to_string();
    assert_eq!(why, "the process for slam died 7 times in a row: it ended with code 1");
    assert_eq!(waits, [0.25, 0.5, 1.0, 2.0, 4.0]);
    assert!(began.elapsed() >= Duration::from_secs_f64(waits.iter().sum()), "it did not wait");
}

fn failure_of_a_worker_is_told() {
    let command = |role| {
        let mut command = this_program(role);
        command.env("NO_SOURCE", "1");
        command
    };
    let failed = run_with(command, Duration::from_secs(1), |_, _| ());
    assert_eq!(failed.unwrap_err().to_string(), "the camera: it is in use; close it");
}

fn run_folder_is_removed() {
    let parent = std::env::temp_dir().join(format!("folders-{}", std::process::id()));
    std::fs::create_dir(&parent).unwrap();
    let folder = RunFolder::create(&parent).unwrap();
    std::fs::write(folder.ring(), [0; 1000]).unwrap();
    // One of a process that is gone, and one that is not ours.
    let mut gone = Command::new("true").spawn().unwrap();
    gone.wait().unwrap();
    let abandoned = parent.join(format!("cairn-{}", gone.id()));
    std::fs::create_dir(&abandoned).unwrap();
    std::fs::write(abandoned.join("frames.ring"), [0; 3000]).unwrap();
    std::fs::create_dir(parent.join("cairn-notes")).unwrap();
    assert_eq!(cairn_workers::remove_abandoned(&parent), [(gone.id(), 3000)]);
    assert!(folder.ring().exists() && !abandoned.exists() && parent.join("cairn-notes").exists());
    drop(folder);
    assert_eq!(std::fs::read_dir(&parent).unwrap().count(), 1);
    std::fs::remove_dir_all(&parent).unwrap();
}
