//! `cairn run`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};

/// 1.5 s of the demo world at low resolution, to keep tests short.
const WORLD: &str = "sim:demo?duration=1.5&resolution=320x240&sensor=rgbd";

#[test]
fn run_writes_results_deterministically() {
    let folder = folder("run");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let run = |n: &str| {
        let (a, b, c) =
            (path(&format!("{n}.tum")), path(&format!("{n}-live.tum")), path(&format!("{n}.route")));
        let output = cairn(&["run", WORLD, "--trajectory", &a, "--live-trajectory", &b, "--record", &c]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(output.stderr.is_empty(), "no progress bar without a terminal: {}", stderr(&output));
        let text = stdout(&output);
        assert!(
            text.contains("frames    31, 31 tracked (coverage 1.000)") && text.contains("truth     ATE"),
            "{text}"
        );
        [a, b, c].map(|file| std::fs::read_to_string(file).unwrap())
    };
    let first = run("first");
    assert_eq!(first, run("second"), "lockstep is bit-identical");
    assert_eq!(first[0].lines().filter(|l| !l.starts_with('#')).count(), 31);
    let info = json(&cairn(&["route", "info", &path("first.route"), "--json"]));
    assert!(info["points"].as_u64().unwrap() >= 5 && info["metric"] == true, "{info}");
    fails(&["run", WORLD, "--record", &path("first.route")], &["first.route", "never overwritten"]);
    assert_eq!(std::fs::read_to_string(path("first.route")).unwrap(), first[2], "the route is unchanged");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn run_reports_as_json_and_html() {
    let folder = folder("run-report");
    let (report, page) = (folder.join("report.json"), folder.join("report.html"));
    let (report, page) = (report.to_str().unwrap(), page.to_str().unwrap());
    let output =
        cairn(&["run", WORLD, "--json", "--report", report, "--report-html", page, "--frames", "20"]);
    let shown = json(&output);
    let saved: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
    assert_eq!(shown, saved);
    assert_eq!(
        (&shown["frames"], &shown["tracked"], &shown["sensor"]),
        (&20.into(), &20.into(), &"rgbd".into())
    );
    for stage in ["decode", "extract", "track", "map"] {
        assert!(shown["stages"][stage]["p99"].as_f64().is_some_and(|ms| ms >= 0.0), "{stage}: {shown}");
    }
    assert!(shown["accuracy"]["ate_m"]["rmse"].as_f64().unwrap() < 0.02, "{shown}");
    assert_eq!(
        shown["config"],
        json(&cairn(&["config", "--json"])),
        "the report contains the complete configuration"
    );
    let page = std::fs::read_to_string(page).unwrap();
    assert!(
        page.starts_with("<!DOCTYPE html>")
            && page.contains("The map")
            && page.contains("What happened when")
            && page.contains("</html>")
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn run_in_real_time_accounts_for_every_frame() {
    let report = json(&cairn(&["run", WORLD, "--realtime", "--json"]));
    assert_eq!(report["frames"], 31);
    assert!(report["tracked"].as_u64().unwrap() + report["dropped"].as_u64().unwrap() <= 31, "{report}");
    assert!(report["wall_s"].as_f64().unwrap() >= 1.5, "{report}");
}

#[test]
fn run_reads_config_and_rejects_invalid_entries() {
    let folder = folder("run-config");
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let fewer = write("fewer.toml", "[front_end.orb]\nfeatures = 400\n");
    let report = json(&cairn(&["run", WORLD, "--config", &fewer, "--json", "--frames", "5"]));
    assert_eq!(report["config"]["front_end"]["orb"]["features"], 400);
    fails(
        &["run", WORLD, "--config", &write("word.toml", "[front_end.orb]\nfeatures = \"all\"\n")],
        &["word.toml, line 2"],
    );
    fails(&["run", WORLD, "--config", &write("name.toml", "[eyes]\n")], &["name.toml", "eyes"]);
    fails(&["run", WORLD, "--config", "/no/config.toml"], &["/no/config.toml"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn run_rejects_invalid_sources_and_arguments() {
    let folder = folder("run-wrong");
    let empty = folder.to_str().unwrap();
    fails(&["run", "/no/recording"], &["/no/recording", "does not exist"]);
    fails(&["run", empty], &["not a recording of a known kind"]);
    // Without ffmpeg the error names the missing program instead of the address.
    let ffmpeg = std::process::Command::new("ffmpeg").arg("-version").output().is_ok();
    fails(&["run", "rtsp://camera"], &[if ffmpeg { "rtsp:" } else { "apt install ffmpeg" }]);
    fails(&["run", "sim:moon"], &["no world \"moon\""]);
    fails(&["run", "sim:demo?sensor=mono", "--sensor", "stereo"], &["sim:demo", "--sensor"]);
    fails(&["run", WORLD, "--rig", "/no/rig.toml"], &["/no/rig.toml"]);
    fails(&["run", WORLD, "--start=-1"], &["0 or more"]);
    fails(&["run", WORLD, "--start", "1000"], &["past the end"]);
    fails(&["run", WORLD, "--report", "/no/folder/r.json"], &["/no/folder/r.json", "does not exist"]);
    fails(&["run", WORLD, "--trajectory", empty], &["is a folder"]);
    for usage in
        [&["run"][..], &["run", WORLD, "--sensor", "sonar"], &["run", WORLD, "--lockstep", "--realtime"]]
    {
        assert_eq!(cairn(usage).status.code(), Some(2), "{usage:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn run_without_any_pose_fails_with_the_reason() {
    // Monocular initialisation needs motion, and two frames have almost none.
    let folder = folder("run-none");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (tum, route, report) = (path("a.tum"), path("a.route"), path("a.json"));
    let files = ["--trajectory", &tum, "--record", &route, "--report", &report];
    let run = ["run", WORLD, "--sensor", "mono", "--frames", "2"];
    fails(&[&run[..], &files[..]].concat(), &["no frame got a pose", "the start has"]);
    let left: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["a.json"], "only the report is written, no trajectory and no route");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn run_skips_and_reports_a_damaged_image() {
    let folder = folder("run-damaged");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let written = cairn(&["sim", "demo?duration=0.5&resolution=160x120&sensor=stereo", "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let images = recording.join("mav0/cam0/data");
    let mut names: Vec<_> = std::fs::read_dir(&images).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let whole = std::fs::read(&names[4]).unwrap();
    std::fs::write(&names[4], &whole[..whole.len() / 2]).unwrap();
    let output = cairn(&["run", out, "--json"]);
    let report = json(&output);
    assert_eq!((&report["skipped"], &report["frames"]), (&1.into(), &11.into()), "{report}");
    assert_eq!(report["tracked"], 10);
    assert!(stderr(&output).contains("warning: skipped: "), "{}", stderr(&output));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_recording_fails_when_under_half_of_its_frames_have_a_pose_however_short_it_is() {
    let folder = folder("run-under-half");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let written = cairn(&["sim", "demo?duration=1&resolution=160x120&sensor=stereo", "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let images = recording.join("mav0/cam0/data");
    let mut names: Vec<_> = std::fs::read_dir(&images).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let damage =
        |names: &[std::path::PathBuf]| names.iter().for_each(|name| std::fs::write(name, "").unwrap());
    damage(&names[11..]);
    let half = cairn(&["run", out, "--json"]);
    assert_eq!((half.status.code(), &json(&half)["tracked"]), (Some(0), &11.into()), "{}", stderr(&half));
    damage(&names[10..11]);
    // The report is printed all the same: the error is its last word.
    let under = cairn(&["run", out]);
    assert_eq!(under.status.code(), Some(1), "{}", stderr(&under));
    assert!(stdout(&under).contains("21, 10 tracked (coverage 0.476)"), "{}", stdout(&under));
    let words = "only 10 of 21 frames got a pose; hint: mend what was skipped";
    assert!(stderr(&under).contains(words), "{}", stderr(&under));
    // A try of a few frames is one.
    assert_eq!(cairn(&["run", out, "--frames", "10"]).status.code(), Some(0));
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Each picture of the recording has a second line in its index, half a frame later.
#[test]
fn a_recording_that_gives_each_picture_twice_has_a_pose_for_each_picture_and_counts_the_repeats() {
    let folder = folder("run-doubled");
    let recording = folder.join("recording");
    let out = recording.to_str().unwrap();
    let world = "corridor?duration=6&start=14&rate=10&resolution=320x240&sensor=mono-imu";
    let written = cairn(&["sim", world, "--out", out]);
    assert_eq!(written.status.code(), Some(0), "{}", stderr(&written));
    let index = recording.join("mav0/cam0/data.csv");
    let lines = std::fs::read_to_string(&index).unwrap();
    let twice = lines.lines().map(|line| match line.split_once(',') {
        Some((stamp, file)) if !line.starts_with('#') => {
            format!("{line}\n{},{file}\n", stamp.parse::<u64>().unwrap() + 50_000_000)
        }
        _ => format!("{line}\n"),
    });
    std::fs::write(&index, twice.collect::<String>()).unwrap();
    let pictures = lines.lines().filter(|line| !line.starts_with('#')).count();
    let output = cairn(&["run", out, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = json(&output);
    let number = |of: &serde_json::Value| of.as_u64().unwrap_or_default() as usize;
    assert_eq!((&report["skipped"], &report["coverage"]), (&0.into(), &1.0.into()), "{report}");
    let skips = report["skips"].as_array().expect("what was left out");
    let repeats = skips.iter().find(|skip| skip["what"] == "repeated frame").expect("repeats");
    let repeats = number(&repeats["count"]);
    assert_eq!(number(&report["tracked"]) + repeats, 2 * pictures, "{report}");
    assert!(4 * repeats > 3 * pictures, "{repeats} of {pictures}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn realtime_run_is_replayed_and_events_are_written() {
    let folder = folder("run-journal");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (journal, live, again) = (path("a.journal"), path("live.tum"), path("again.tum"));
    let more = ["--realtime", "--journal", &journal, "--live-trajectory", &live];
    let output = cairn(&[&["run", WORLD][..], &more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let events = path("events.jsonl");
    let more = ["--replay", &journal, "--live-trajectory", &again, "--events", &events];
    let output = cairn(&[&["run", WORLD][..], &more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("frames equal bit for bit, and the map"), "{}", stderr(&output));
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    assert_eq!(read(&live), read(&again));
    // The first map is created with its root; versions only increase.
    let lines: Vec<serde_json::Value> =
        read(&events).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(
        (&lines[0]["event"], &lines[0]["map"], &lines[0]["map_prior"]),
        (&"map_created".into(), &0.into(), &().into())
    );
    assert!(lines.iter().any(|l| l["event"] == "born" && l["key_frames"][0]["id"] == 0), "{lines:?}");
    let versions: Vec<u64> = lines.iter().filter_map(|l| l["version"].as_u64()).collect();
    assert!(versions.is_sorted() && lines.iter().all(|l| l["stamp_ns"].is_i64()), "{lines:?}");
    // A journal of another run and a file that is not a Cairn journal are rejected.
    fails(
        &["run", "sim:demo?duration=1&seed=5", "--replay", &journal],
        &["a.journal", "the journal is of", "options"],
    );
    fails(&["run", WORLD, "--replay", &live], &["live.tum", "not a Cairn journal"]);
    assert_eq!(cairn(&["run", WORLD, "--journal", &journal]).status.code(), Some(2), "needs --realtime");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The lines of `--status`, without their prefix.
fn status_lines(output: &std::process::Output) -> Vec<String> {
    stderr(output).lines().filter_map(|l| l.strip_prefix("status: ")).map(str::to_owned).collect()
}

/// The phase in a status line.
fn phase(line: &str) -> &str {
    line.split([' ', ';']).nth(2).unwrap()
}

#[test]
fn status_of_a_run_without_imu() {
    let world = "sim:demo?sensor=stereo&resolution=320x240&duration=2.3&rate=10";
    let output = cairn(&["run", world, "--status", "--json"]);
    let lines = status_lines(&output);
    let phases: Vec<&str> = lines.iter().map(|l| phase(l)).collect();
    assert_eq!(phases, ["LOADING_VOCAB", "WAIT_FRAMES", "TRACKING", "TRACKING", "TRACKING"], "{lines:?}");
    assert!(
        lines[2].starts_with(
            "0.000 s TRACKING; pose 1 valid; map 0 initialised; 0 points; event: map 0 is created"
        )
    );
    assert!(lines[4].starts_with("2.000 s TRACKING; pose 21 valid; map 0 initialised; "), "{lines:?}");
    assert!(lines.iter().all(|l| !l.contains("IMU") && !l.contains('\x1b')), "{lines:?}");
    let report = json(&output);
    let standing = &report["standing"];
    assert!((standing["seconds"]["TRACKING"].as_f64().unwrap() - 2.3).abs() < 1e-6, "{standing}");
    assert_eq!((&standing["first_metric_pose_s"], &standing["imu"]), (&0.0.into(), &().into()));
    assert_eq!(report["resets"], 0);
}

#[test]
fn status_of_imu_initialisation() {
    let world = "sim:demo?sensor=mono-imu&resolution=480x360&duration=11&rate=10";
    let output = cairn(&["run", world, "--status", "--json"]);
    let lines = status_lines(&output);
    let first = |name: &str| lines.iter().position(|l| phase(l) == name);
    let (motion, tracking) = (first("WAIT_MOTION"), first("TRACKING"));
    assert!(motion.is_some() && first("INITIALIZING").is_some() && motion < tracking, "{lines:#?}");
    assert!(lines.iter().any(|l| l.contains("waits for") && l.contains(": failed)")), "{lines:#?}");
    assert!(lines.iter().any(|l| l.contains("event: map 0 is gravity-aligned")), "{lines:#?}");
    assert!(lines[tracking.unwrap()].contains("map 0 initialised"), "{lines:#?}");
    let report = json(&output);
    let (standing, imu) = (&report["standing"], &report["standing"]["imu"]);
    assert_eq!((&imu["initialised"], &imu["gaps"]), (&true.into(), &0.into()), "{imu}");
    assert!(
        imu["gates"].as_array().is_some_and(|g| g.len() > 5 && g.iter().all(|g| g["passed"] == true)),
        "{imu}"
    );
    assert!(standing["first_metric_pose_s"].as_f64().is_some_and(|s| s > 0.5), "{standing}");
    assert!(standing["seconds"]["TRACKING"].as_f64().is_some_and(|s| s > 0.5), "{standing}");
}
