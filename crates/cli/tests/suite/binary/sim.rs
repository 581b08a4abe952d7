//! `cairn sim`.

use crate::binary::{cairn, fails, folder, json, stderr, stdout};

#[test]
fn sim_writes_both_layouts_and_run_reads_them() {
    let folder = folder("sim");
    for (sensor, layout) in [("stereo-imu", "euroc"), ("rgbd", "tum")] {
        let out = folder.join(layout);
        let out = out.to_str().unwrap();
        let world = format!("demo?duration=0.5&resolution=320x240&sensor={sensor}");
        let written = json(&cairn(&["sim", &world, "--out", out, "--json"]));
        assert_eq!((&written["layout"], &written["frames"]), (&layout.into(), &11.into()), "{written}");
        let report = json(&cairn(&["run", out, "--json"]));
        assert_eq!(report["frames"], 11, "{report}");
        assert!(report["accuracy"]["pairs"].as_u64().is_some_and(|n| n > 0), "{report}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn sim_leaves_nothing_behind_on_failure() {
    let folder = folder("sim-wrong");
    let out = folder.join("out");
    let out = out.to_str().unwrap();
    fails(&["sim", "moon", "--out", out], &["no world \"moon\""]);
    fails(&["sim", "demo?sped=3", "--out", out], &["sped", "known keys are"]);
    fails(&["sim", "demo?sensor=mono", "--out", out, "--layout", "tum"], &["depth"]);
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "nothing is left behind");
    std::fs::create_dir(folder.join("out")).unwrap();
    std::fs::write(folder.join("out/mine.txt"), "kept").unwrap();
    fails(&["sim", "demo?duration=0.1", "--out", out], &["not empty"]);
    assert!(folder.join("out/mine.txt").exists());
    assert_eq!(cairn(&["sim", "demo"]).status.code(), Some(2));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn sim_help_lists_worlds_and_options() {
    let help = cairn(&["sim", "--help"]);
    assert!(help.stderr.is_empty(), "{}", stderr(&help));
    let help = stdout(&help);
    for word in ["corridor", "street", "seed", "passers", "trajectory"] {
        assert!(help.contains(word), "{word}: {help}");
    }
}
