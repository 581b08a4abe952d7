//! What a command reads and waits for: nothing that is too large, no device, no pipe; and every wait ends at a signal.

use crate::binary::outputs::hang_ups_are_ignored;
use crate::binary::{cairn, folder, json, stderr, stdout};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Half a second of the demo world at low resolution.
const WORLD: &str = "sim:demo?duration=0.5&resolution=320x240&sensor=rgbd";

#[test]
fn damaged_imu_rows_do_not_lower_the_coverage() {
    let folder = folder("ends-imu");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let world = "demo?duration=1&resolution=160x120&sensor=stereo-imu";
    let written = cairn(&["sim", world, "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let imu = recording.join("mav0/imu0/data.csv");
    let text = std::fs::read_to_string(&imu).unwrap();
    let damaged: Vec<&str> =
        text.lines().enumerate().map(|(i, line)| if i % 10 == 5 { "damaged" } else { line }).collect();
    std::fs::write(&imu, damaged.join("\n")).unwrap();
    let page = folder.join("report.html");
    let output = cairn(&["run", out, "--json", "--report-html", page.to_str().unwrap()]);
    let report = json(&output);
    assert_eq!((&report["frames"], &report["skipped"]), (&21.into(), &0.into()), "{report}");
    assert_eq!(report["tracked"], 21);
    let skips = report["skips"].as_array().unwrap();
    let rows = skips.iter().find(|s| s["what"] == "IMU reading" && s["reason"] == "not an IMU sample");
    let rows = rows.unwrap_or_else(|| panic!("{skips:?}"));
    assert_eq!(rows["count"], damaged.iter().filter(|line| **line == "damaged").count());
    assert!(rows["first"].as_str().unwrap().contains("data.csv, line 6"), "{rows}");
    let page = std::fs::read_to_string(page).unwrap();
    assert!(page.contains("IMU readings") && page.contains("not an IMU sample"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn skips_outside_of_the_requested_part_do_not_count() {
    let folder = folder("ends-part");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let written = cairn(&["sim", "demo?duration=1&resolution=160x120&sensor=stereo", "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let right = recording.join("mav0/cam1/data.csv");
    let text = std::fs::read_to_string(&right).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    std::fs::write(&right, lines[..lines.len() - 3].join("\n")).unwrap();
    let report = json(&cairn(&["run", out, "--json", "--frames", "10"]));
    assert_eq!((&report["frames"], &report["coverage"]), (&10.into(), &1.0.into()), "{report}");
    let report = json(&cairn(&["run", out, "--json"]));
    assert_eq!(
        (&report["frames"], &report["skipped"], &report["tracked"]),
        (&21.into(), &3.into(), &18.into())
    );
    assert_eq!(report["skips"][0]["reason"], "the left image has no right one");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Arguments that read the path as each kind of input.
fn readers(path: &str) -> Vec<Vec<&str>> {
    let run = |option| vec!["run", WORLD, option, path];
    let mut all: Vec<Vec<&str>> =
        ["--map-in", "--config", "--rig", "--script", "--guide", "--replay"].map(run).into();
    all.push(vec!["run", path]);
    all.extend(["info", "clean", "show"].map(|what| vec!["route", what, path]));
    all.extend(["info", "check", "repair"].map(|what| vec!["map", what, path]));
    all.last_mut().unwrap().extend(["--out", "/tmp/cairn-never.map"]);
    all.push(vec!["solve", "graph", path]);
    all.push(vec!["solve", "bundle", path]);
    all.push(vec!["vocab", "info", path]);
    all.push(vec!["rig", "check", path]);
    all.push(vec!["eval", path, path]);
    all.push(vec!["plan", path, "--from", "0,0", "--to", "1,1"]);
    all.push(vec!["ekf", path]);
    all
}

#[track_caller]
fn refused_at_once(path: &Path, words: &[&str]) {
    for arguments in readers(path.to_str().unwrap()) {
        let began = Instant::now();
        let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        while child.try_wait().unwrap().is_none() {
            if began.elapsed() > Duration::from_secs(5) {
                child.kill().unwrap();
                panic!("{arguments:?} reads it");
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let output = child.wait_with_output().unwrap();
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {text}");
        assert!(words.iter().any(|word| text.contains(word)), "{arguments:?}: {text}");
        assert!(began.elapsed() < Duration::from_secs(2), "{arguments:?}: {:?}", began.elapsed());
    }
}

#[cfg(unix)]
#[test]
fn what_is_too_large_and_what_is_no_file_is_refused_before_it_is_read() {
    let folder = folder("ends-large");
    // Sparse: takes no room on the disk.
    let large = folder.join("large");
    std::fs::File::create(&large).unwrap().set_len(20_000_000_000).unwrap();
    refused_at_once(&large, &["20.0 GB", "not a map file", "is a file, not a folder", "not a rig", "no log"]);
    let pipe = folder.join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.as_path(), Path::new("/dev/zero")] {
        refused_at_once(path, &["a device or a pipe", "no log"]);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A command that waits, after it printed a line on stderr that contains `ready`.
#[cfg(unix)]
fn waiting(arguments: &[&str], ready: Option<&str>) -> Child {
    let mut child = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    match ready {
        Some(ready) => {
            let mut lines = BufReader::new(child.stderr.as_mut().unwrap()).lines().map_while(Result::ok);
            assert!(lines.any(|line| line.contains(ready)), "{arguments:?}");
            std::thread::sleep(Duration::from_millis(300));
        }
        None => std::thread::sleep(Duration::from_millis(700)),
    }
    assert!(child.try_wait().unwrap().is_none(), "{arguments:?} does not wait");
    child
}

/// Sends a signal; the command must end within a second, or two on a loaded machine.
#[cfg(unix)]
#[track_caller]
fn ends(child: Child, signal: &str) -> Output {
    let began = Instant::now();
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert!(began.elapsed() < Duration::from_secs(2), "{:?}", began.elapsed());
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    output
}

#[cfg(unix)]
#[test]
fn a_signal_ends_waiting_for_a_stream_and_frees_its_port() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("rtmp-listen://127.0.0.1:{port}/cairn");
    for signal in ["-TERM", "-INT", "-HUP"] {
        if signal == "-HUP" && hang_ups_are_ignored() {
            println!("skipped: -HUP, which is ignored here");
            continue;
        }
        let output = ends(waiting(&["run", &address], Some("waiting for video")), signal);
        assert_eq!(stderr(&output).trim(), "interrupted: nothing was written");
        std::net::TcpListener::bind(("127.0.0.1", port)).expect("the port is free again");
    }
    let output = ends(waiting(&["run", &address, "--json"], Some("waiting for video")), "-TERM");
    assert_eq!(json(&output)["interrupted"], true);
}

#[cfg(unix)]
#[test]
fn a_signal_ends_waiting_for_the_next_packet() {
    let folder = folder("ends-gap");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let world = "demo?duration=0.5&resolution=160x120&sensor=rgbd";
    let written = cairn(&["sim", world, "--layout", "tum", "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    // The last images come an hour later.
    let list = recording.join("rgb.txt");
    let text = std::fs::read_to_string(&list).unwrap();
    let lines: Vec<&str> = text.trim_end().lines().collect();
    let (before, last) = lines.split_at(lines.len() - 4);
    let late = last.iter().enumerate().filter_map(|(i, line)| {
        let (_, file) = line.split_once(' ')?;
        Some(format!("{}.0 {file}", 3600 + i))
    });
    let late: Vec<String> = late.collect();
    std::fs::write(&list, format!("{}\n{}\n", before.join("\n"), late.join("\n"))).unwrap();
    let report = folder.join("report.json");
    let child = waiting(&["run", out, "--realtime", "--report", report.to_str().unwrap()], None);
    let output = ends(child, "-TERM");
    assert!(stdout(&output).starts_with("ended     interrupted"), "{}", stdout(&output));
    assert!(std::fs::read_to_string(&report).unwrap().contains("\"interrupted\": true"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(unix)]
#[test]
fn a_signal_ends_commands_without_results_of_their_own() {
    let folder = folder("ends-demo");
    let out = folder.join("demo");
    let output = ends(waiting(&["demo", "--out", out.to_str().unwrap()], None), "-INT");
    assert!(stderr(&output).contains("interrupted: nothing was written"), "{}", stderr(&output));
    assert!(!out.join("report.html").exists());
    std::fs::remove_dir_all(&folder).unwrap();
}
