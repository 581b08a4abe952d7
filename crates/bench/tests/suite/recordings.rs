//! Limits for the engine on the real recordings, 10 % above the measured figures. A limit is tightened when the
//! engine improves, and never loosened to make a test pass.

use bench::accuracy::{run_here, stated_ate};
use bench::recordings::{RECORDINGS, data_folder, recording};
use bench::{Measured, RunOptions, halves};
use std::path::Path;

/// Runs a recording; prints "skipped" if it is missing.
fn run(name: &str, frames: usize) -> Option<Measured> {
    run_with(name, frames, false)
}

/// The same, with the dense front end or without.
fn run_with(name: &str, frames: usize, dense: bool) -> Option<Measured> {
    let recording = recording(name).expect("a row of the table");
    let data = data_folder();
    if !Path::new(&data).join(recording.folder).exists() {
        println!("skipped: {} is not in {}", recording.folder, data.display());
        return None;
    }
    let mut config = RunOptions { frames, ..RunOptions::new(recording.sensor) };
    config.config.tracker.dense = dense;
    Some(run_here(&data, &recording, &config).expect("the engine runs"))
}

fn check(name: &str, ate_at_most_m: f64, coverage_at_least: f64) {
    let Some(m) = run(name, usize::MAX) else { return };
    limit(name, &m, ate_at_most_m, coverage_at_least);
    // Old figures do not stay unnoticed. Processors differ in the last bits.
    let page = include_str!("../../../../docs/figures/accuracy.md");
    let (stated, ate) =
        (stated_ate(page, name).expect("a row of docs/figures/accuracy.md"), m.ate_m.unwrap());
    assert!(
        (stated - ate).abs() <= 0.02 * ate + 5e-5,
        "docs/figures/accuracy.md states {stated} m for {name}, it is {ate:.4} m: cargo run --release -p bench -- accuracy --write"
    );
}

fn limit(name: &str, m: &Measured, ate_at_most_m: f64, coverage_at_least: f64) {
    let ate = m.ate_m.expect("poses to align");
    println!("{name}: ATE {ate:.4} m, coverage {:.3}, lost {:?}", m.coverage(), m.lost);
    assert!(ate <= ate_at_most_m, "{name}: ATE {ate:.4} m, the limit is {ate_at_most_m} m");
    let coverage = m.coverage();
    assert!(
        coverage >= coverage_at_least,
        "{name}: coverage {coverage:.3}, the limit is {coverage_at_least}"
    );
}

#[test]
fn euroc_stereo_accuracy() {
    check("euroc-mh01-stereo", 0.0046, 1.0);
}

#[test]
fn euroc_mono_accuracy() {
    check("euroc-mh01-mono", 0.0047, 1.0);
}

#[test]
fn kitti_mono_accuracy() {
    check("kitti-a-mono", 0.0239, 1.0);
}

#[test]
fn kitchen_rgbd_accuracy() {
    check("7scenes-kitchen-rgbd", 0.0208, 1.0);
}

/// The pose of each frame from its depth: better than features here, whose depth is not registered to the picture exactly.
#[test]
fn kitchen_dense_accuracy() {
    let name = "7scenes-kitchen-rgbd";
    let Some(m) = run_with(name, usize::MAX, true) else { return };
    limit(name, &m, 0.0228, 1.0);
}

#[test]
fn kitti_stereo_accuracy() {
    check("kitti-a-stereo", 0.0282, 1.0);
}

#[test]
fn a_hundred_frames_are_bit_identical() {
    for name in ["euroc-mh01-stereo", "7scenes-kitchen-rgbd"] {
        let (Some(a), Some(b)) = (run(name, 100), run(name, 100)) else { continue };
        assert_eq!(a.hash, b.hash, "{name}");
        assert!(a.tracked > 50, "{name}: only {} of {} frames have a pose", a.tracked, a.frames);
    }
}

#[test]
fn second_half_is_localized_in_the_saved_map_of_the_first() {
    for r in &RECORDINGS {
        if !data_folder().join(r.folder).exists() {
            println!("skipped: {} is missing", r.folder);
            continue;
        }
        let found = halves::run(&data_folder(), r).expect("the halves run");
        println!("{}", halves::table(std::slice::from_ref(&found)));
        // The car leaves the mapped street: mono is localized for half of it only.
        let (share, off_m) = match r.name {
            "kitti-a-mono" => (0.45, 0.1),
            "kitti-a-stereo" => (1.0, 0.264),
            "7scenes-kitchen-rgbd" => (1.0, 0.0815),
            "euroc-mh01-stereo" => (1.0, 0.0061),
            _ => (1.0, 0.0071),
        };
        assert!(found.found[0] as f64 >= share * found.found[1] as f64, "{found:?}");
        assert!(found.off_m < off_m, "{found:?}");
    }
}
