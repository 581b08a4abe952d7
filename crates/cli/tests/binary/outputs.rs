//! The rules for output files: checked before the work, never overwritten unseen, written independently.

use crate::{cairn, fails, folder, json, stderr, stdout};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Half a second of the demo world at low resolution.
const WORLD: &str = "sim:demo?duration=0.5&resolution=320x240&sensor=rgbd";

/// Ten minutes of it: a test that lets this run to its end does not end in time.
const LONG: &str = "sim:demo?duration=600&resolution=320x240&sensor=rgbd";

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = names.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Asserts wrong usage: exit code 2 and one line on stderr that contains these words.
#[track_caller]
fn misused(arguments: &[&str], words: &[&str]) {
    let output = cairn(arguments);
    let line = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {line}");
    assert_eq!(line.lines().count(), 1, "{arguments:?}: {line}");
    for word in words {
        assert!(line.contains(word), "{arguments:?}: no '{word}' in: {line}");
    }
}

/// The options of `cairn run` that name an output, without --record and --say.
const OUTPUTS: [&str; 7] =
    ["--trajectory", "--live-trajectory", "--report", "--report-html", "--events", "--map-out", "--journal"];

/// The arguments of a run that writes to `path` by this option.
fn run_to<'a>(world: &'a str, option: &'a str, path: &'a str) -> Vec<&'a str> {
    let mut arguments = vec!["run", world, option, path];
    if option == "--journal" {
        arguments.push("--realtime");
    }
    arguments
}

#[test]
fn unwritable_outputs_are_reported_before_anything_runs() {
    let folder = folder("outputs-unwritable");
    let good = folder.join("good.tum");
    let mut wrong = vec!["/no/folder/out"];
    // Nobody, not even root, can create a file there.
    wrong.extend(cfg!(target_os = "linux").then_some("/proc/out"));
    for path in wrong {
        for option in OUTPUTS.into_iter().chain(["--record"]) {
            fails(&run_to(LONG, option, path), &[path]);
        }
        fails(&["run", LONG, "--say", &format!("wav:{path}")], &[path]);
        let other = if path.starts_with("/no") { "--trajectory" } else { "--live-trajectory" };
        fails(&["run", LONG, other, text(&good), "--report", path], &[path]);
    }
    let elapsed = (0..5).map(|_| {
        let began = Instant::now();
        fails(&["run", LONG, "--report", "/no/folder/out"], &["make the folder first"]);
        began.elapsed()
    });
    assert!(elapsed.min().unwrap() < Duration::from_millis(100));
    assert!(names(&folder).is_empty(), "nothing is left behind: {:?}", names(&folder));
    #[cfg(unix)]
    fails(&["run", LONG, "--report", "/dev/null"], &["/dev/null", "a device or a pipe"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn existing_files_are_replaced_with_overwrite_only() {
    let folder = folder("outputs-existing");
    let path = folder.join("out");
    for option in OUTPUTS {
        std::fs::write(&path, "of before").unwrap();
        let arguments = run_to(WORLD, option, text(&path));
        fails(&arguments, &["out: it exists already", "--overwrite"]);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "of before", "{option}");
        let output = cairn(&[&arguments[..], &["--overwrite"]].concat());
        assert_eq!(output.status.code(), Some(0), "{option}: {}", stderr(&output));
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.len() > 20 && !bytes.starts_with(b"of before"), "{option}");
    }
    fails(&["run", WORLD, "--say", &format!("wav:{}", text(&path))], &["it exists already"]);
    // A route is never overwritten.
    fails(&["run", WORLD, "--record", text(&path), "--overwrite"], &["never overwritten"]);
    // A source that cannot be opened leaves the old file alone.
    std::fs::write(&path, "of before").unwrap();
    fails(&["run", "sim:moon", "--events", text(&path), "--overwrite"], &["no world"]);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "of before");
    assert_eq!(names(&folder), ["out"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn an_output_is_no_input_and_no_other_output() {
    let folder = folder("outputs-clash");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (a, twisted) = (file("a"), file("none/../a"));
    std::fs::create_dir(folder.join("none")).unwrap();
    for pair in OUTPUTS.windows(2).filter(|pair| pair[1] != "--journal") {
        misused(&["run", LONG, pair[0], &a, pair[1], &twisted], &[pair[0], pair[1], "the same file"]);
    }
    misused(&["run", LONG, "--record", &a, "--report", &a], &["the same file", "--record"]);
    misused(&["run", LONG, "--say", &format!("wav:{a}"), "--report", &a], &["the same file", "--report"]);
    assert!(!Path::new(&a).exists());

    let input = file("input");
    std::fs::write(&input, "at 1 quit\n").unwrap();
    for option in ["--rig", "--config", "--script", "--guide", "--map-in", "--replay"] {
        let run = ["run", LONG, option, &input, "--overwrite", "--trajectory", &input];
        misused(&run, &["--trajectory", option, "which is read"]);
    }
    misused(&["run", LONG, "--guide", &input, "--record", &input], &["--record", "--guide"]);
    // A file of the recording's folder, and a single file as source.
    let inside = ["run", text(&folder), "--overwrite", "--report", &input];
    misused(&inside, &["--report", "folder of the source"]);
    misused(&["run", &input, "--overwrite", "--report", &input], &["--report", "is the source"]);
    #[cfg(unix)]
    {
        let (soft, hard) = (file("soft"), file("hard"));
        std::os::unix::fs::symlink(&input, &soft).unwrap();
        std::fs::hard_link(&input, &hard).unwrap();
        for link in [&soft, &hard] {
            misused(&["run", LONG, "--script", &input, "--overwrite", "--report", link], &["--script"]);
        }
        std::os::unix::fs::symlink(file("new"), file("to-new")).unwrap();
        misused(&["run", LONG, "--events", &file("new"), "--report", &file("to-new")], &["the same file"]);
    }
    assert_eq!(std::fs::read_to_string(&input).unwrap(), "at 1 quit\n");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_map_may_be_saved_to_the_file_it_was_opened_from() {
    let folder = folder("outputs-map");
    let (map, other) = (folder.join("a.map"), folder.join("b.map"));
    let run = |more: &[&str]| cairn(&[&["run", WORLD], more].concat());
    assert_eq!(run(&["--map-out", text(&map)]).status.code(), Some(0));
    std::fs::copy(&map, &other).unwrap();
    let output = run(&["--map-in", text(&map), "--map-out", text(&map)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    fails(&["run", WORLD, "--map-in", text(&map), "--map-out", text(&other)], &["b.map: it exists already"]);
    assert_eq!(names(&folder), ["a.map", "b.map"], "no lock is left");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(unix)]
#[test]
fn symbolic_links_are_written_through() {
    let folder = folder("outputs-links");
    std::fs::create_dir(folder.join("real")).unwrap();
    let link = |name: &str, to: &str| {
        std::os::unix::fs::symlink(to, folder.join(name)).unwrap();
        folder.join(name)
    };
    let (old, new, map) =
        (link("old.tum", "real/old.tum"), link("new.json", "real/new.json"), link("a.map", "real/a.map"));
    let events = link("e.jsonl", "real/e.jsonl");
    std::fs::write(folder.join("real/old.tum"), "of before").unwrap();
    fails(&["run", WORLD, "--trajectory", text(&old)], &["old.tum: it exists already"]);
    let files = ["--trajectory", text(&old), "--report", text(&new), "--map-out", text(&map)];
    let output = cairn(&[&["run", WORLD, "--overwrite", "--events", text(&events)], &files[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!([&old, &new, &map, &events].iter().all(|p| p.is_symlink()));
    assert_eq!(names(&folder.join("real")), ["a.map", "e.jsonl", "new.json", "old.tum"]);
    assert!(std::fs::read_to_string(folder.join("real/old.tum")).unwrap().lines().count() > 5);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A long run that has tracked some frames, with its messages and its result captured.
#[cfg(unix)]
struct Running(Child);

#[cfg(unix)]
impl Running {
    /// Starts a run; it is ready when the route it records has some points.
    fn start(folder: &Path, more: &[&str]) -> Self {
        let route = folder.join("ready.route");
        let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args([&["run", LONG, "--record", text(&route)], more].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let began = Instant::now();
        while std::fs::read_to_string(&route).map_or(0, |text| text.lines().count()) < 4 {
            let runs = began.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none();
            assert!(runs, "the run ended or took too long");
            std::thread::sleep(Duration::from_millis(20));
        }
        Self(child)
    }

    /// Sends a signal and waits for the end.
    fn end(self, signal: &str) -> std::process::Output {
        assert!(Command::new("kill").args([signal, &self.0.id().to_string()]).status().unwrap().success());
        self.0.wait_with_output().unwrap()
    }
}

/// Whether whoever started the tests has hang-ups ignored (`nohup` does), which the program then does as well.
#[cfg(unix)]
fn hang_ups_are_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).map_or("", str::trim);
    u64::from_str_radix(mask, 16).is_ok_and(|mask| mask & 1 == 1)
}

#[cfg(unix)]
#[test]
fn interrupted_runs_write_everything_and_say_so() {
    for signal in ["-INT", "-TERM", "-HUP"] {
        if signal == "-HUP" && hang_ups_are_ignored() {
            println!("skipped: -HUP, which is ignored here");
            continue;
        }
        let folder = folder(&format!("outputs{signal}"));
        let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
        let (tum, report, page, map) = (file("a.tum"), file("a.json"), file("a.html"), file("a.map"));
        let files = ["--trajectory", &tum, "--report", &report, "--report-html", &page, "--map-out", &map];
        let as_json = signal != "-HUP";
        let more = [&files[..], if as_json { &["--json"] } else { &[] }].concat();
        let output = Running::start(&folder, &more).end(signal);
        assert_eq!(output.status.code(), Some(130), "{signal}: {}", stderr(&output));
        let saved: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
        assert_eq!(saved["interrupted"], true);
        match as_json {
            true => assert_eq!(json(&output), saved),
            false => assert!(stdout(&output).starts_with("ended     interrupted"), "{}", stdout(&output)),
        }
        let poses = std::fs::read_to_string(&tum).unwrap().lines().filter(|l| !l.starts_with('#')).count();
        assert_eq!(saved["tracked"].as_u64(), Some(poses as u64));
        assert!(std::fs::read_to_string(&page).unwrap().contains("The run was interrupted."));
        assert_eq!(cairn(&["map", "check", &map]).status.code(), Some(0));
        assert_eq!(names(&folder), ["a.html", "a.json", "a.map", "a.tum", "ready.route"]);
        std::fs::remove_dir_all(&folder).unwrap();
    }
    assert_eq!(json(&cairn(&["run", WORLD, "--json"]))["interrupted"], false);
}

#[cfg(unix)]
#[test]
fn one_failing_output_does_not_keep_the_others_from_being_written() {
    let folder = folder("outputs-independent");
    let lost = folder.join("lost");
    std::fs::create_dir(&lost).unwrap();
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (tum, page) = (file("a.tum"), file("a.html"));
    let (map, report, live) = (file("lost/a.map"), file("lost/a.json"), file("lost/live.tum"));
    let files = ["--map-out", &map, "--report", &report, "--report-html", &page, "--trajectory", &tum];
    let running = Running::start(&folder, &[&files[..], &["--live-trajectory", &live, "--json"]].concat());
    std::fs::remove_dir_all(&lost).unwrap();
    let output = running.end("-INT");
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 3, "{text}");
    for (error, name) in errors.iter().zip(["a.map", "a.json", "live.tum"]) {
        assert!(error.contains(name), "{text}");
    }
    let shown = json(&output)["error"].clone();
    assert!(shown["what"].as_str().unwrap().ends_with("a.map"), "{shown}");
    assert_eq!(shown["also"].as_array().map(Vec::len), Some(2), "{shown}");
    assert_eq!(names(&folder), ["a.html", "a.tum", "ready.route"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(unix)]
#[test]
fn a_map_file_has_one_writer() {
    let folder = folder("outputs-lock");
    let (map, lock) = (folder.join("a.map"), folder.join(".a.map.lock"));
    // Left behind by a process that was killed.
    std::fs::write(&lock, "4000000\n").unwrap();
    let running = Running::start(&folder, &["--map-out", text(&map)]);
    let owner = format!("process {} is writing this map", running.0.id());
    fails(&["run", LONG, "--map-out", text(&map), "--overwrite"], &["a.map", &owner]);
    // By another name too; the message names the file itself.
    let link = folder.join("link.map");
    std::os::unix::fs::symlink(&map, &link).unwrap();
    fails(&["run", LONG, "--map-out", text(&link), "--overwrite"], &["a.map", &owner]);
    assert_eq!(running.end("-INT").status.code(), Some(130));
    assert_eq!(names(&folder), ["a.map", "link.map", "ready.route"], "the lock is removed");

    let mut killed = Running::start(
        &{
            let other = folder.join("other");
            std::fs::create_dir(&other).unwrap();
            other
        },
        &["--map-out", text(&map), "--overwrite"],
    );
    killed.0.kill().unwrap();
    killed.0.wait().unwrap();
    assert!(lock.exists());
    let again = cairn(&["run", WORLD, "--map-out", text(&map), "--overwrite"]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_ignores_hang_ups_goes_on() {
    let folder = folder("outputs-nohup");
    let route = folder.join("a.route");
    let command = format!(
        "trap '' HUP; exec '{}' run '{LONG}' --record '{}'",
        env!("CARGO_BIN_EXE_cairn"),
        text(&route)
    );
    let mut child = Command::new("sh").args(["-c", &command]).stdout(Stdio::null()).spawn().unwrap();
    let points = || std::fs::read_to_string(&route).map_or(0, |text| text.lines().count());
    let wait_for = |wanted: usize| {
        let began = Instant::now();
        while points() < wanted {
            assert!(began.elapsed() < Duration::from_secs(60), "the run does not go on");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait_for(4);
    assert!(Command::new("kill").args(["-HUP", &child.id().to_string()]).status().unwrap().success());
    wait_for(points() + 4);
    assert!(child.try_wait().unwrap().is_none());
    child.kill().unwrap();
    child.wait().unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A map of a few frames.
fn saved_map(folder: &Path, name: &str) -> PathBuf {
    let map = folder.join(name);
    let output = cairn(&["run", WORLD, "--map-out", text(&map)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    map
}

#[test]
fn the_rules_hold_for_maps_and_meshes() {
    let folder = folder("outputs-commands");
    let (a, b) = (saved_map(&folder, "a.map"), saved_map(&folder, "b.map"));
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let before = std::fs::read(&a).unwrap();

    let merge =
        |out: &str| ["map", "merge", text(&a), text(&b), "--overwrite", "--out", out].map(str::to_owned);
    let merged = |out: &str| {
        let arguments = merge(out);
        cairn(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    };
    misused(&["map", "merge", text(&a), text(&b), "--out", text(&a), "--overwrite"], &["a map to merge"]);
    let both = file("both.map");
    assert_eq!(merged(&both).status.code(), Some(0));
    fails(&["map", "merge", text(&a), text(&b), "--out", &both], &["both.map: it exists already"]);
    assert_eq!(merged(&both).status.code(), Some(0));

    let points = file("points.ply");
    let export = ["map", "export", text(&a), "--points", &points];
    misused(&[&export[..], &["--trajectory", &points]].concat(), &["the same file"]);
    misused(&["map", "export", text(&a), "--overwrite", "--points", text(&a)], &["--points", "the map"]);
    assert_eq!(cairn(&export).status.code(), Some(0));
    fails(&export, &["points.ply: it exists already"]);
    assert_eq!(cairn(&[&export[..], &["--overwrite"]].concat()).status.code(), Some(0));
    // A folder that is missing for the routes does not keep the points from being written.
    std::fs::remove_file(&points).unwrap();
    let with_route = file("with-route.map");
    let record = ["run", WORLD, "--map-out", &with_route, "--record", &file("home.route")];
    assert_eq!(cairn(&record).status.code(), Some(0));
    let nowhere = file("nowhere");
    fails(&["map", "export", &with_route, "--points", &points, "--routes", &nowhere], &["home.route"]);
    assert!(Path::new(&points).exists());

    let mesh = file("mesh.ply");
    let arguments = ["mesh", WORLD, "--every", "5", "--voxel", "0.1", "--out", &mesh];
    assert_eq!(cairn(&arguments).status.code(), Some(0));
    fails(&arguments, &["mesh.ply: it exists already"]);
    assert_eq!(cairn(&[&arguments[..], &["--overwrite"]].concat()).status.code(), Some(0));
    misused(&["mesh", WORLD, "--poses", &mesh, "--overwrite", "--out", &mesh], &["--poses"]);
    fails(&["mesh", LONG, "--out", "/no/folder/mesh.ply"], &["make the folder first"]);
    assert_eq!(std::fs::read(&a).unwrap(), before);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_rules_hold_for_plans_logs_and_simulated_recordings() {
    let folder = folder("outputs-others");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (yaml, image, log) = (file("room.yaml"), file("room.png"), file("walk_DR.txt"));
    std::fs::write(&yaml, "image: room.png\n").unwrap();
    for name in [&image, &log, &file("walk_TD.txt")] {
        std::fs::write(name, "something").unwrap();
    }
    let plan = ["plan", &yaml, "--from", "0,0", "--to", "1,1", "--overwrite", "--out", &image];
    misused(&plan, &["--out", "the image of the map"]);
    misused(&["ekf", &log, "--overwrite", "--out", &log], &["--out", "the log"]);
    misused(&["ekf", &log, "--overwrite", "--out", &file("walk_TD.txt")], &["second file of the log"]);
    fails(&["ekf", &log, "--out", &image], &["room.png: it exists already"]);
    fails(&["ekf", &log, "--out", "/no/folder/page.html"], &["make the folder first"]);
    fails(&["sim", "demo?duration=600", "--out", text(&folder)], &["is not empty"]);
    assert_eq!(std::fs::read_to_string(&image).unwrap(), "something");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A g2o graph of three poses.
const GRAPH: &str = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1.1 0 0\nVERTEX_SE2 2 2.1 0.1 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n";

/// Asserts the rules for one command that reads `input` and writes by `option`: it refuses an existing file, its own
/// input, a folder that is not there, a device; it writes through a link; with --overwrite it replaces.
#[cfg(unix)]
#[track_caller]
fn obeys_the_rules(folder: &Path, command: &[&str], option: &str, input: &Path, named: &str) {
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (out, soft) = (file("out-new"), file("out-soft"));
    let with = |path: &str, more: &[&str]| -> Vec<String> {
        [command, &[option, path], more].concat().iter().map(|a| (*a).to_owned()).collect()
    };
    let run = |arguments: &[String]| cairn(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let fails_with = |arguments: Vec<String>, words: &[&str]| {
        fails(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), words);
    };
    fails_with(with("/no/folder/out", &[]), &["/no/folder/out", "make the folder first"]);
    fails_with(with("/dev/null", &[]), &["a device or a pipe"]);
    let before = std::fs::read(input).unwrap();
    let own = with(text(input), &["--overwrite"]);
    misused(&own.iter().map(String::as_str).collect::<Vec<_>>(), &[option, named]);
    assert_eq!(std::fs::read(input).unwrap(), before);
    let output = run(&with(&out, &[]));
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    let written = std::fs::read(&out).unwrap();
    assert!(!written.is_empty());
    fails_with(with(&out, &[]), &["out-new: it exists already", "--overwrite"]);
    std::fs::write(&out, "of before").unwrap();
    std::os::unix::fs::symlink(&out, &soft).unwrap();
    let output = run(&with(&soft, &["--overwrite"]));
    assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    assert!(Path::new(&soft).is_symlink(), "{command:?} replaces the link");
    assert_eq!(std::fs::read(&out).unwrap(), written, "{command:?}");
    std::fs::remove_file(&soft).unwrap();
    std::fs::remove_file(&out).unwrap();
}

#[cfg(unix)]
#[test]
fn the_rules_hold_for_solvers_rigs_routes_and_vocabularies() {
    let folder = folder("outputs-rest");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let graph = file("graph.g2o");
    std::fs::write(&graph, GRAPH).unwrap();
    obeys_the_rules(&folder, &["solve", "graph", &graph], "--out", Path::new(&graph), "the graph");

    let rig = file("rig.toml");
    std::fs::write(
        &rig,
        "[[cameras]]\nresolution = [320, 240]\nfocal = [200.0, 200.0]\ncentre = [160.0, 120.0]\n",
    )
    .unwrap();
    obeys_the_rules(&folder, &["rig", "check", &rig], "--write", Path::new(&rig), "the calibration");

    let route = file("home.route");
    assert_eq!(cairn(&["run", WORLD, "--record", &route]).status.code(), Some(0));
    obeys_the_rules(&folder, &["route", "show", &route], "--out", Path::new(&route), "the route");

    let recording = file("recording");
    let written = cairn(&["sim", "demo?duration=0.3&resolution=320x240&sensor=stereo", "--out", &recording]);
    assert_eq!(written.status.code(), Some(0));
    let images = folder.join("recording/mav0/cam0/data");
    let image = std::fs::read_dir(&images).unwrap().next().unwrap().unwrap().path();
    let train = ["vocab", "train", text(&images), text(&image), "--branching", "4", "--depth", "2"];
    obeys_the_rules(&folder, &train, "--out", &image, "an image");

    // A folder of images is read with a rig for them, and its files are no outputs.
    let into = file("recording/mav0/cam0/data/new.json");
    let existing = text(&image);
    misused(
        &["run", text(&images), "--rig", &rig, "--overwrite", "--report", existing],
        &["folder of the source"],
    );
    assert!(!Path::new(&into).exists());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn maps_and_routes_are_not_replaced_by_other_files() {
    let folder = folder("outputs-kinds");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (map, route) = (file("a.map"), file("a.route"));
    let output = cairn(&["run", WORLD, "--map-out", &map, "--record", &route]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for (path, kind) in [(&map, "a saved map"), (&route, "a recorded route")] {
        let before = std::fs::read(path).unwrap();
        for option in ["--trajectory", "--report", "--events"] {
            fails(&["run", LONG, "--overwrite", option, path], &[kind, "another kind of file"]);
        }
        assert_eq!(&std::fs::read(path).unwrap(), &before);
    }
    fails(&["run", LONG, "--overwrite", "--map-out", &route], &["a recorded route"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_rules_hold_for_the_demo() {
    let folder = folder("outputs-demo");
    let out = folder.join("demo");
    let arguments = ["demo", "--metres", "5", "--out", text(&out)];
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("demo.json"), "of before").unwrap();
    let began = Instant::now();
    fails(&arguments, &["demo.json: it exists already", "--overwrite"]);
    assert!(began.elapsed() < Duration::from_secs(1));
    assert_eq!(names(&out), ["demo.json"]);
    std::fs::remove_dir_all(&out).unwrap();
    // A file is in the way of the folder.
    std::fs::write(&out, "a file").unwrap();
    fails(&arguments, &["demo"]);
    std::fs::remove_file(&out).unwrap();
    // An earlier route is replaced only where the user says so.
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("demo.route"), "of before").unwrap();
    fails(&arguments, &["demo.route: it exists already"]);
    let output = cairn(&[&arguments[..], &["--overwrite"]].concat());
    assert!(stdout(&output).contains("report.html"), "{}", stderr(&output));
    assert!(std::fs::read_to_string(out.join("demo.route")).unwrap().contains("\"crc\""));
    assert_eq!(names(&out).len(), 7, "{:?}", names(&out));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_folder_that_cannot_be_written_is_told_before_serving() {
    if cfg!(target_os = "linux") {
        let began = Instant::now();
        fails(&["serve", "--port", "0", "--routes", "/proc/routes"], &["/proc/routes"]);
        assert!(began.elapsed() < Duration::from_secs(1));
    }
}

#[test]
fn damaged_maps_are_repaired_into_a_new_file() {
    let folder = folder("outputs-repair");
    let map = saved_map(&folder, "a.map");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (whole, damaged, repaired) =
        (std::fs::read(&map).unwrap(), file("damaged.map"), file("repaired.map"));
    std::fs::write(&damaged, &whole[..whole.len() - 100]).unwrap();
    fails(&["map", "info", &damaged], &["cairn map repair"]);
    misused(&["map", "repair", &damaged, "--overwrite", "--out", &damaged], &["the damaged map"]);
    let output = cairn(&["map", "repair", &damaged, "--out", &repaired, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = json(&output);
    assert!(!report["lost"].as_array().unwrap().is_empty() && report["key_frames"].as_u64().unwrap() > 0);
    assert_eq!(cairn(&["map", "check", &repaired]).status.code(), Some(0));
    assert_eq!(cairn(&["map", "check", &damaged]).status.code(), Some(1), "the damaged file is as it was");
    fails(&["map", "repair", &damaged, "--out", &repaired], &["it exists already"]);
    std::fs::write(&damaged, "no map at all").unwrap();
    fails(&["map", "repair", &damaged, "--out", &file("none.map")], &["not a map file"]);
    assert!(!Path::new(&file("none.map")).exists());
    let same = json(&cairn(&["map", "repair", text(&map), "--out", &file("same.map"), "--json"]));
    assert_eq!(same["lost"].as_array().map(Vec::len), Some(0));
    assert_eq!(std::fs::read(file("same.map")).unwrap(), whole);
    std::fs::remove_dir_all(&folder).unwrap();
}
