//! `cairn bench`: one table over several recordings.

use crate::binary::{cairn, folder, json, stderr};

#[test]
fn recordings_sensors_and_repeats_become_one_table() {
    let root = folder("bench");
    let (walks, out) = (root.join("walks"), root.join("out"));
    for (name, seed) in [("one", "1"), ("two", "2")] {
        let address = format!("sim:office?seed={seed}&sensor=stereo&rate=10&duration=2&resolution=320x240");
        let to = walks.join(name);
        let made = cairn(&["sim", &address, "--out", &to.to_string_lossy()]);
        assert!(made.status.success(), "{}", stderr(&made));
    }
    std::fs::create_dir_all(walks.join("notes")).unwrap();
    let (from, to) = (walks.to_string_lossy().into_owned(), out.to_string_lossy().into_owned());
    let done = cairn(&["bench", &from, "--out", &to, "--sensor", "mono,stereo", "--repeats", "2", "--json"]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stderr(&done).contains("left out:") && stderr(&done).contains("notes"), "{}", stderr(&done));
    let results = json(&done);
    let runs = results["runs"].as_array().unwrap();
    let named =
        |r: &serde_json::Value| format!("{} {} {}", r["sequence"], r["sensor"], r["repeat"]).replace('"', "");
    let names: Vec<String> = runs.iter().map(named).collect();
    assert_eq!(names[..4], ["one mono 1", "one mono 2", "one stereo 1", "one stereo 2"]);
    assert_eq!(names.len(), 8);
    // Lockstep: repeats have the same poses; and they are those of cairn run.
    assert_eq!(runs[2]["ate_m"], runs[3]["ate_m"]);
    let alone = cairn(&["run", &walks.join("one").to_string_lossy(), "--sensor", "stereo", "--json"]);
    assert_eq!(json(&alone)["accuracy"]["ate_m"]["rmse"], runs[2]["ate_m"]);
    assert!(runs[2]["ate_m"].as_f64().unwrap() < 0.05 && runs[2]["coverage"] == 1.0, "{}", runs[2]);
    let csv = std::fs::read_to_string(out.join("runs.csv")).unwrap();
    assert_eq!(csv.lines().count(), 9);
    assert!(csv.lines().all(|l| l.split(',').count() == 23), "{csv}");
    let table = std::fs::read_to_string(out.join("table.md")).unwrap();
    assert_eq!(
        table.lines().filter(|l| l.starts_with("| one") || l.starts_with("| two")).count(),
        4,
        "{table}"
    );
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    for run in ["one.mono.1", "two.stereo.2"] {
        assert!(page.contains(&format!("runs/{run}/report.html")), "{run}");
        for file in
            ["report.html", "report.json", "trajectory.tum", "trajectory.csv", "trajectory.kitti", "live.tum"]
        {
            assert!(out.join("runs").join(run).join(file).exists(), "{run}/{file}");
        }
    }
    // The formats hold the same poses.
    let run = out.join("runs/one.stereo.1");
    let same = cairn(&[
        "eval",
        &run.join("trajectory.tum").to_string_lossy(),
        &run.join("trajectory.csv").to_string_lossy(),
        "--align",
        "none",
        "--json",
    ]);
    assert!(json(&same)["ate_m"]["max"].as_f64().unwrap() < 1e-6);
    // Nothing is overwritten.
    let again = cairn(&["bench", &from, "--out", &to]);
    assert!(!again.status.success() && stderr(&again).contains("not empty"), "{}", stderr(&again));
}

#[test]
fn a_run_that_fails_is_a_row_and_an_exit_code() {
    let root = folder("bench-fails");
    let wrong = root.join("wrong.toml");
    std::fs::write(&wrong, "[tracker]\nno_such_entry = 1\n").unwrap();
    let out = root.join("out").to_string_lossy().into_owned();
    let source = "sim:office?rate=5&duration=1&resolution=160x120";
    let done =
        cairn(&["bench", source, "--out", &out, "--sensor", "mono", "--config", &wrong.to_string_lossy()]);
    assert_eq!(done.status.code(), Some(1));
    assert!(
        stderr(&done).contains("no_such_entry") && stderr(&done).contains("1 of 1 runs failed"),
        "{}",
        stderr(&done)
    );
    assert!(root.join("out/table.md").exists());
    let none = cairn(&["bench", &root.to_string_lossy(), "--out", &root.join("new").to_string_lossy()]);
    assert!(!none.status.success(), "a folder without recordings");
}
