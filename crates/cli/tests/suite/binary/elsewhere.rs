//! Coming from elsewhere: folders of images, video with another program's settings, vocabularies, shells, manuals, logs.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};
use std::path::Path;
use std::process::Command;

/// A recording of the demo world, 160x120 stereo, as an EuRoC folder.
fn recording(folder: &Path) -> String {
    let out = folder.join("recording").to_str().unwrap().to_owned();
    let written = cairn(&["sim", "demo?duration=1&resolution=320x240&sensor=stereo", "--out", &out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    out
}

/// Settings of ORB-SLAM2 without the size of the images.
const SETTINGS: &str = "%YAML:1.0\n\nCamera.fx: 210.0\nCamera.fy: 210.0\nCamera.cx: 159.5\nCamera.cy: 119.5\n\
    Camera.k1: 0\nCamera.k2: 0\nCamera.p1: 0\nCamera.p2: 0\nCamera.fps: 20.0\n";

#[test]
fn a_folder_of_images_runs_with_settings_that_state_no_size() {
    let folder = folder("elsewhere-images");
    let images = format!("{}/mav0/cam0/data", recording(&folder));
    let settings = folder.join("TUM1.yaml");
    std::fs::write(&settings, SETTINGS).unwrap();
    let settings = settings.to_str().unwrap();
    // The walk is too short for a map from one camera: the report says how far it came.
    let report = folder.join("report.json");
    let arguments = ["run", &images, "--rig", settings, "--report", report.to_str().unwrap()];
    let output = cairn(&arguments);
    let text = std::fs::read_to_string(&report).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&report["frames"], &report["sensor"]), (&21.into(), &"mono".into()), "{report}");
    assert!(report["source"].as_str().unwrap().contains("folder of images"), "{report}");
    let checked = cairn(&["rig", "check", settings, "--with", &images]);
    assert_eq!(checked.status.code(), Some(0), "{}", stderr(&checked));
    assert!(stdout(&checked).contains("320x240"), "{}", stdout(&checked));
    fails(&["rig", "check", settings], &["Camera.width"]);
    fails(&["run", &images, "--as", "kitti"], &["calib.txt: is missing"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn video_runs_with_an_rgbd_rig_and_with_one_without_a_size() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    let folder = folder("elsewhere-video");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let images = format!("{}/mav0/cam0/data/*.png", recording(&folder));
    let video = file("walk.mp4");
    let made = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-framerate", "20", "-pattern_type", "glob", "-i", &images])
        .args(["-pix_fmt", "yuv420p", &video])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    std::fs::write(file("size-less.yaml"), SETTINGS).unwrap();
    let depth = "RGBD.DepthMapFactor: 1000\nCamera.width: 320\nCamera.height: 240\n";
    std::fs::write(file("rgbd.yaml"), format!("{SETTINGS}{depth}")).unwrap();
    for rig in ["size-less.yaml", "rgbd.yaml"] {
        let report = file(&format!("{rig}.json"));
        let output = cairn(&["run", &video, "--rig", &file(rig), "--report", &report]);
        let text = std::fs::read_to_string(&report).unwrap_or_else(|_| panic!("{rig}: {}", stderr(&output)));
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!((&report["frames"], &report["sensor"]), (&21.into(), &"mono".into()), "{rig}: {report}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_vocabulary_of_ones_own_recognises_places() {
    let folder = folder("elsewhere-vocabulary");
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let recording = recording(&folder);
    let train =
        ["vocab", "train", &recording, "--branching", "6", "--depth", "3", "--out", &file("own.vocab")];
    assert_eq!(cairn(&train).status.code(), Some(0));
    let run = |more: &[&str]| cairn(&[&["run", &recording, "--json"], more].concat());
    let first = run(&["--vocabulary", &file("own.vocab"), "--map-out", &file("own.map")]);
    assert_eq!(json(&first)["tracked"], 21, "{}", stderr(&first));
    // A map of the built-in vocabulary is converted, and its places are recognised.
    assert_eq!(run(&["--map-out", &file("usual.map")]).status.code(), Some(0));
    let again = run(&["--vocabulary", &file("own.vocab"), "--map-in", &file("usual.map"), "--localize-only"]);
    assert_eq!(json(&again)["tracked"], 21, "{}", stderr(&again));
    fails(&["run", &recording, "--vocabulary", &file("usual.map")], &["usual.map", "cairn vocab"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn names_of_rigs_are_listed() {
    for arguments in [&["run", "--rig", "list"][..], &["serve", "--rig=list"]] {
        let output = cairn(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
        assert!(stdout(&output).contains("phone-854x480") && stdout(&output).contains("stella_vslam"));
    }
    let listed = json(&cairn(&["run", "--rig", "list", "--json"]));
    assert_eq!(listed["rigs"][0]["name"], "phone-854x480");
}

#[test]
fn shells_get_completions_and_readers_manual_pages() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let output = cairn(&["completions", shell]);
        assert_eq!(output.status.code(), Some(0), "{shell}");
        let text = stdout(&output);
        assert!(text.contains("cairn") && text.contains("map-out") && text.contains("doctor"), "{shell}");
    }
    assert_eq!(cairn(&["completions", "tcsh"]).status.code(), Some(2));
    let folder = folder("elsewhere-man");
    let out = folder.join("man1");
    let output = cairn(&["man", "--out", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let page = std::fs::read_to_string(out.join("cairn-map-repair.1")).unwrap();
    assert!(page.contains(".TH cairn-map-repair 1") && page.contains("damaged"), "{page}");
    assert!(out.join("cairn.1").exists() && out.join("cairn-run.1").exists());
    fails(&["man", "--out", out.to_str().unwrap()], &["it exists already"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn help_is_in_groups_and_names_every_command() {
    let help = stdout(&cairn(&["--help"]));
    let at = |text: &str| help.find(text).unwrap_or_else(|| panic!("no {text} in {help}"));
    assert!(at("Start here:") < at("Maps and routes:") && at("  run ") < at("  ekf "), "{help}");
    assert!(!help.contains('\x1b'), "no colours where there is no terminal");
    let run = stdout(&cairn(&["run", "--help"]));
    let at = |text: &str| run.find(text).unwrap_or_else(|| panic!("no {text} in {run}"));
    assert!(at("Source and calibration:") < at("Results:") && at("Results:") < at("--trajectory"), "{run}");
    assert!(at("Maps:") < at("--map-out") && at("Announcements:") < at("--say"), "{run}");
}

#[test]
fn rust_log_decides_what_is_logged() {
    let world = "sim:demo?duration=0.3&resolution=160x120&sensor=rgbd";
    let run = |level: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cairn"));
        command.args(["run", world]).env_remove("RUST_LOG");
        level.map(|level| command.env("RUST_LOG", level));
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stderr(&output)
    };
    assert_eq!(run(None), "");
    let debug = run(Some("cairn=debug"));
    assert!(
        debug.lines().any(|l| l.starts_with("debug: opened") && l.contains("sensor=\"rgbd\"")),
        "{debug}"
    );
    assert!(run(Some("cairn=trace")).lines().filter(|l| l.starts_with("trace: frame")).count() == 7);
    assert!(run(Some("cairn=loud=loud")).contains("warning: RUST_LOG=cairn=loud=loud is not understood"));
}

#[test]
fn what_went_wrong_comes_first() {
    let folder = folder("elsewhere-problems");
    let recording = recording(&folder);
    let list = Path::new(&recording).join("mav0/cam1/data.csv");
    let text = std::fs::read_to_string(&list).unwrap();
    std::fs::write(&list, text.lines().take(12).collect::<Vec<_>>().join("\n")).unwrap();
    let output = cairn(&["run", &recording]);
    let text = stdout(&output);
    assert!(text.starts_with("problem   10 of 21 frames (47.6 %) have no pose: 10 skipped."), "{text}");
    let problems = json(&cairn(&["run", &recording, "--json"]))["problems"].clone();
    assert_eq!(problems[0], "10 of 21 frames (47.6 %) have no pose: 10 skipped.");
    std::fs::remove_dir_all(&folder).unwrap();
}
