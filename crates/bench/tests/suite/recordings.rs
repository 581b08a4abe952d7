//! The engine on the real recordings keeps to the limits of the scenario `accuracy`, and its page states what it does.

use crate::scenarios::{run, run_with};
use bench::{data_folder, halves};

fn check(name: &str) {
    let Some(row) = run("accuracy", &[("recording", name)]).pop() else { return };
    // Old figures do not stay unnoticed. Processors differ in the last bits.
    let page = include_str!("../../../../docs/figures/accuracy.md");
    let line = page.lines().find(|line| line.starts_with(&format!("| {name} |"))).expect("a row of the page");
    let stated = line.split('|').nth(3).and_then(|cell| cell.split_whitespace().next());
    let (stated, ate_m) = (stated.unwrap().parse::<f64>().unwrap(), row.ate_m.unwrap());
    assert!(
        (stated - ate_m).abs() <= 0.02 * ate_m + 5e-5,
        "docs/figures/accuracy.md states {stated} m for {name}, it is {ate_m:.4} m: cargo run --release -p bench -- run accuracy --write"
    );
}

#[test]
fn euroc_stereo_accuracy() {
    check("euroc-mh01-stereo");
}

#[test]
fn euroc_mono_accuracy() {
    check("euroc-mh01-mono");
}

#[test]
fn kitti_mono_accuracy() {
    check("kitti-a-mono");
}

#[test]
fn kitti_stereo_accuracy() {
    check("kitti-a-stereo");
}

#[test]
fn kitchen_rgbd_accuracy() {
    check("7scenes-kitchen-rgbd");
}

/// The pose of each frame from its depth: better than features here, whose depth is not registered to the picture exactly.
#[test]
fn kitchen_dense_accuracy() {
    let kitchen = [("recording", "7scenes-kitchen-rgbd"), ("ate_most", "0.0228")];
    run_with("accuracy", &kitchen, "tracker.dense = true");
}

#[test]
fn the_first_seconds_are_bit_identical() {
    for name in ["euroc-mh01-stereo", "7scenes-kitchen-rgbd"] {
        let first = [("recording", name), ("seconds", "3.5"), ("frames_least", "50")];
        let [a, b] = [(); 2].map(|()| run("accuracy", &first).pop());
        assert_eq!(a.map(|row| row.hash), b.map(|row| row.hash), "{name}");
    }
}

#[test]
fn second_half_is_localized_in_the_saved_map_of_the_first() {
    let all = halves::all(&data_folder()).expect("the halves run");
    println!("{}", halves::table(&all));
    for found in all {
        // The car leaves the mapped street: mono is localized for half of it only.
        let (share, off_m) = match found.name.as_str() {
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
