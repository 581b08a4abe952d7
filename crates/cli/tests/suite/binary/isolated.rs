//! `cairn run --isolated`: the same result as one process, a guide that says stop when another process dies, and nothing left
//! behind.
#![cfg(unix)]

use crate::binary::{cairn, folder, json, stderr, stdout};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const WORLD: &str = "sim:demo?duration=8&resolution=320x240&sensor=rgbd&rate=10";
/// One that lasts until several processes were killed on a quick machine.
const LONGER: &str = "sim:demo?duration=24&resolution=320x240&sensor=rgbd&rate=10";

/// The kitchen's depth is not registered to its pictures: poses are taken from depth, whoever runs the engine. By features the ATE is
/// 2.5 cm.
#[test]
fn depth_gives_the_poses_of_the_kitchen_in_one_process_and_in_several() {
    let data = std::env::var_os("CAIRN_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        std::path::PathBuf::from,
    );
    let kitchen = data.join("7scenes-kitchen");
    if !kitchen.is_dir() || !has_shared_memory() {
        println!("skipped: no folder {}", kitchen.display());
        return;
    }
    for more in [&[][..], &["--isolated"]] {
        let output = cairn(&[&["run", kitchen.to_str().unwrap(), "--json"][..], more].concat());
        let said = stderr(&output);
        assert!(said.contains("poses are taken from depth"), "{more:?}: {said}");
        let report = json(&output);
        let ate = report["accuracy"]["ate_m"]["rmse"].as_f64().unwrap();
        assert!(ate < 0.0225 && report["coverage"] == 1.0, "{more:?}: {ate} m, {report}");
    }
}

/// False, and said so, where there is no shared memory.
fn has_shared_memory() -> bool {
    let has = Path::new("/dev/shm").is_dir();
    if !has {
        println!("skipped: no /dev/shm on this machine");
    }
    has
}

#[test]
fn result_is_that_of_one_process() {
    if !has_shared_memory() {
        return;
    }
    let folder = folder("isolated");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let run = |name: &str, more: &[&str]| {
        let (poses, live) = (path(&format!("{name}.tum")), path(&format!("{name}-live.tum")));
        let mesh = path(&format!("{name}.ply"));
        let always = ["run", WORLD, "--frames", "30", "--json", "--trajectory", &poses];
        let always = [&always[..], &["--live-trajectory", &live, "--mesh", &mesh]].concat();
        let report = json(&cairn(&[&always[..], more].concat()));
        (report, [poses, live].map(|file| std::fs::read_to_string(file).unwrap()))
    };
    let surface = |name: &str| std::fs::read(path(&format!("{name}.ply"))).unwrap();
    let (one, poses) = run("one", &[]);
    let (isolated, same) = run("isolated", &["--isolated", "--map-out", &path("isolated.map")]);
    assert_eq!(poses, same, "bit for bit");
    assert_eq!(surface("one"), surface("isolated"), "bit for bit");
    for key in
        ["source", "sensor", "frames", "tracked", "coverage", "maps", "keyframes", "landmarks", "config"]
    {
        assert_eq!(isolated[key], one[key], "{key}");
    }
    assert_eq!(isolated["accuracy"]["ate_m"]["rmse"], one["accuracy"]["ate_m"]["rmse"]);
    assert!(isolated["deaths"].as_array().unwrap().is_empty());
    let info = json(&cairn(&["map", "info", &path("isolated.map"), "--json"]));
    assert_eq!(info["maps"][0]["key_frames"], one["keyframes"], "{info}");
    // The map carries the depth, also of a run that goes on from it.
    let images = |map: &str| {
        let surface =
            json(&cairn(&["mesh", &path(map), "--out", &path("again.ply"), "--overwrite", "--json"]));
        surface["images"].as_u64().unwrap_or_else(|| panic!("{surface}"))
    };
    let before = images("isolated.map");
    assert!(before >= 3, "{before} images");
    let always = [
        "run",
        WORLD,
        "--dense",
        "--colour",
        "--map-in",
        &path("isolated.map"),
        "--map-out",
        &path("on.map"),
    ];
    let on = cairn(&[&always[..], &["--isolated"]].concat());
    assert_eq!(on.status.code(), Some(0), "{}", stderr(&on));
    assert!(images("on.map") > before + 3, "{} images after {before}", images("on.map"));
    let nothing = cairn(&["run", "sim:demo?duration=2&resolution=320x240", "--isolated", "--dense"]);
    assert!(stderr(&nothing).contains("the run has no depth sensor"), "{}", stderr(&nothing));
    assert_eq!(nothing.status.code(), Some(1));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_processes_cannot_do_is_said() {
    let both = cairn(&["run", WORLD, "--isolated", "--mcap", "x.mcap"]);
    assert_eq!(both.status.code(), Some(2));
    assert!(stderr(&both).contains("--isolated"), "{}", stderr(&both));
    let live = cairn(&["run", "rtsp://127.0.0.1:1/none", "--isolated"]);
    assert!(stderr(&live).contains("live sources are not supported yet"), "{}", stderr(&live));
    if has_shared_memory() {
        let nothing = cairn(&["run", "/nowhere", "--isolated"]);
        let text = stderr(&nothing);
        assert_eq!(nothing.status.code(), Some(1), "{text}");
        assert!(text.contains("error: /nowhere: ") && text.contains("; hint: "), "{text}");
    }
}

/// A guided run in real time, with its lines as they come.
struct Guided {
    child: Child,
    lines: Receiver<(Instant, String)>,
}

impl Guided {
    fn start(route: &str, map: &str) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(["run", WORLD, "--isolated", "--realtime", "--guide", route, "--map-in", map])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, lines) = channel();
        let (out, err) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
        let other = to.clone();
        std::thread::spawn(move || {
            BufReader::new(out)
                .lines()
                .map_while(Result::ok)
                .for_each(|l| drop(to.send((Instant::now(), l))));
        });
        std::thread::spawn(move || {
            BufReader::new(err)
                .lines()
                .map_while(Result::ok)
                .for_each(|l| drop(other.send((Instant::now(), l))));
        });
        Self { child, lines }
    }

    /// The next line with this text, and when it came.
    #[track_caller]
    fn line(&self, text: &str) -> (Instant, String) {
        let mut before = Vec::new();
        while let Ok(line) = self.lines.recv_timeout(Duration::from_secs(40)) {
            if line.1.contains(text) {
                return line;
            }
            before.push(line.1);
        }
        panic!("no '{text}' after {before:?}");
    }

    /// The id of the process that begins next.
    #[track_caller]
    fn process(&self, role: &str) -> String {
        let (_, line) = self.line(&format!("{role}: process "));
        line.rsplit(' ').next().unwrap().to_owned()
    }
}

fn signal(name: &str, id: &str) -> Instant {
    assert!(Command::new("kill").args([name, id]).status().unwrap().success());
    Instant::now()
}

#[test]
fn guide_says_stop_when_another_process_dies_or_hangs() {
    if !has_shared_memory() {
        return;
    }
    let folder = folder("isolated-guide");
    let (route, map) = (folder.join("home.route"), folder.join("home.map"));
    let (route, map) = (route.to_str().unwrap(), map.to_str().unwrap());
    let recorded = cairn(&["run", WORLD, "--record", route, "--map-out", map]);
    assert_eq!(recorded.status.code(), Some(0), "{}", stderr(&recorded));
    let walk = |role: &str, how: &str| {
        let mut run = Guided::start(route, map);
        let ids = ["capture", "slam", "guide"].map(|role| (role, run.process(role)));
        let (_, id) = ids.iter().find(|(name, _)| *name == role).unwrap();
        run.line("Continue");
        let at = signal(how, id);
        let (stopped, words) = run.line("Stop.");
        let after_s = (stopped - at).as_secs_f64();
        println!("{role} {how}: '{words}' after {after_s:.3} s");
        assert!(after_s < 1.5, "{role}: '{words}' after {after_s} s");
        // The walk goes on to its end, and no frame is lost: a machine that is too busy for real time leaves some out, and says so.
        let (_, line) = run.line("frames    81, ");
        let number = |word: &str| -> usize {
            let before = line.split(word).next().unwrap().trim_end();
            before.rsplit(' ').next().unwrap().parse().unwrap()
        };
        assert_eq!(number(" tracked") + number(" dropped"), 81, "{line}");
        run.line(&format!("died      {role}"));
        assert_eq!(run.child.wait().unwrap().code(), Some(0));
        after_s
    };
    // Other tests run beside this one: one walk of three has to be as fast as it is alone.
    let fast = |role: &str, how: &str, limit_s: f64| {
        assert!(
            (0..3).any(|_| walk(role, how) < limit_s),
            "{role} {how}: 'stop' takes longer than {limit_s} s"
        );
    };
    for role in ["slam", "guide", "capture"] {
        fast(role, "-KILL", 0.3);
    }
    // SLAM is late after 0.25 s.
    fast("slam", "-STOP", 0.6);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn supervisor_that_is_killed_leaves_no_process_and_its_memory_is_freed() {
    if !has_shared_memory() {
        return;
    }
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["run", WORLD, "--isolated", "--realtime"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let mut id_of = |role: &str| {
        let line = lines.find(|l| l.starts_with(role)).unwrap();
        line.rsplit(' ').next().unwrap().to_owned()
    };
    let workers = [id_of("capture: process"), id_of("slam: process")];
    let left = Path::new("/dev/shm").join(format!("cairn-{}", child.id()));
    // SLAM has begun.
    while !left.join("map-000000000000.cairn").exists() {
        std::thread::sleep(Duration::from_millis(20));
    }
    signal("-STOP", &workers[1]);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(left.is_dir());
    let deadline = Instant::now() + Duration::from_secs(5);
    let runs = |id: &String| {
        let state = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
        !(state.is_empty() || state.contains(") Z "))
    };
    while cfg!(target_os = "linux") && workers.iter().any(runs) {
        assert!(Instant::now() < deadline, "a worker outlived its supervisor");
        std::thread::sleep(Duration::from_millis(20));
    }
    let next = cairn(&["run", WORLD, "--isolated", "--frames", "5"]);
    let text = stderr(&next);
    assert!(text.contains(&format!("a run which was killed has left (process {})", child.id())), "{text}");
    assert!(!left.exists() && stdout(&next).contains("5 tracked"), "{}", stdout(&next));
}

/// A run that records a route, as processes; those of `role` are killed a moment after they began, so often.
fn recorded(file: &Path, role: &str, kills: usize) -> String {
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["run", LONGER, "--isolated", "--record", file.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut killed = 0;
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    for line in lines.by_ref() {
        if let Some(id) = line.strip_prefix(&format!("{role}: process "))
            && killed < kills
        {
            std::thread::sleep(Duration::from_millis(150));
            // One that has ended by itself is not there any more.
            killed += usize::from(Command::new("kill").args(["-KILL", id]).status().unwrap().success());
        }
    }
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(killed, kills, "{role}");
    std::fs::read_to_string(file).unwrap()
}

#[test]
fn recorded_route_is_that_of_one_process_whatever_dies() {
    if !has_shared_memory() {
        return;
    }
    let folder = folder("isolated-record");
    let one = folder.join("one.route");
    let run = cairn(&["run", LONGER, "--record", one.to_str().unwrap()]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let one = std::fs::read_to_string(one).unwrap();
    assert!(one.lines().count() > 30, "{one}");
    assert_eq!(recorded(&folder.join("whole.route"), "guide", 0), one, "nothing dies");
    assert_eq!(recorded(&folder.join("guide.route"), "guide", 4), one, "who records dies");
    assert_eq!(recorded(&folder.join("capture.route"), "capture", 1), one, "who captures dies");
    // Without SLAM there is no pose: the route has a gap where it died, and goes on.
    recorded(&folder.join("slam.route"), "slam", 2);
    let points = |file: &str| {
        let info = json(&cairn(&["route", "info", folder.join(file).to_str().unwrap(), "--json"]));
        info["points"].as_u64().unwrap_or_else(|| panic!("{info}"))
    };
    let (all, left) = (points("whole.route"), points("slam.route"));
    assert!(left + 6 >= all, "{left} of {all} points");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn supervisor_that_is_killed_leaves_the_map_of_a_moment_ago_and_the_route_fits_it() {
    if !has_shared_memory() {
        return;
    }
    let folder = folder("isolated-saved");
    let (route, map) = (folder.join("home.route"), folder.join("home.map"));
    let (shown, route) = (map.to_str().unwrap(), route.to_str().unwrap());
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["run", LONGER, "--isolated", "--realtime", "--record", route])
        .args(["--map-out", shown, "--map-every", "0.5"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    let saved = |than: Option<std::time::SystemTime>| {
        let at = map.metadata().and_then(|m| m.modified()).ok();
        at.filter(|at| than.is_none_or(|than| *at > than))
    };
    let mut seen = None;
    // Saved again and again while the run goes on.
    for _ in 0..3 {
        while saved(seen).is_none() {
            assert!(child.try_wait().unwrap().is_none() && began.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(20));
        }
        seen = saved(seen);
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let info = json(&cairn(&["map", "info", shown, "--json"]));
    assert!(info["maps"][0]["key_frames"].as_u64().unwrap() > 0, "{info}");
    let guided = cairn(&["run", WORLD, "--frames", "20", "--map-in", shown, "--guide", route]);
    assert_eq!(guided.status.code(), Some(0), "{}", stderr(&guided));
    std::fs::remove_dir_all(&folder).unwrap();
}
