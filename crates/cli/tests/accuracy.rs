//! Whole runs on real recordings, in lockstep: error against truth and coverage stay within their limits.
//!
//! The limits guard against falling back; README has the figures themselves. Lockstep does not depend on load, so
//! the error of a version is one number. Recordings that are not here are skipped aloud.

use serde_json::Value;
use std::path::PathBuf;
use std::process::Command;

/// Where recordings are: `CAIRN_DATA`, else `../shared/data` beside the checkout.
fn recording(name: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    let path = std::env::var_os("CAIRN_DATA").map_or(beside, PathBuf::from).join(name);
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: no recording at {}", path.display());
    None
}

/// Runs and holds ATE (RMSE in metres) and coverage against their limits.
#[track_caller]
fn within(name: &str, sensor: &str, ate_m: f64, coverage: f64) {
    let Some(path) = recording(name) else { return };
    let output = Command::new(env!("CARGO_BIN_EXE_cairn"))
        .args(["run", "--sensor", sensor, "--json"])
        .arg(&path)
        .output()
        .expect("the binary starts");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{name} {sensor}: {}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_str(&text).expect("a report");
    let got = |path: &str| report.pointer(path).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let (ate, covered) = (got("/accuracy/ate_m/rmse"), got("/coverage"));
    println!("{name} {sensor}: ATE {ate:.4} m (limit {ate_m}), coverage {covered:.3} (limit {coverage})");
    assert!(ate <= ate_m, "{name} {sensor}: ATE {ate} m, limit {ate_m} m");
    assert!(covered >= coverage, "{name} {sensor}: coverage {covered}, limit {coverage}");
}

#[test]
fn euroc_stereo() {
    within("euroc-mh01", "stereo", 0.0055, 1.0);
}

#[test]
fn seven_scenes_rgbd() {
    within("7scenes-kitchen", "rgbd", 0.065, 1.0);
}

#[test]
fn kitti_stereo() {
    within("kitti-a", "stereo", 0.18, 1.0);
}
