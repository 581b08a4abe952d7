//! The rules for output files: checked before the work, never overwritten unseen, written independently. Here those of
//! `cairn run`; the other commands' are in `outputs/commands.rs`.

mod commands;

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use std::path::Path;
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
pub fn hang_ups_are_ignored() -> bool {
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
