//! The drift of ORB-SLAM2 on KITTI 00, as its paper states it. Prints "skipped" where the data is missing.

use cairn_eval::{EvalOptions, evaluate_files, load_trajectory};
use std::path::PathBuf;

#[test]
fn agrees_with_the_published_figures_of_kitti_00() {
    let root = std::env::var_os("CAIRN_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let [truth, estimate] = ["KITTI_00_gt.txt", "KITTI_00_ORB.txt"].map(|name| root.join("eval").join(name));
    if !truth.exists() {
        println!("skipped: no file {}", truth.display());
        return;
    }
    let (truth, estimate) = (load_trajectory(&truth).unwrap(), load_trajectory(&estimate).unwrap());
    let kitti = evaluate_files(&truth, &estimate, &EvalOptions::default()).unwrap().kitti.unwrap();
    // Mur-Artal and Tardos, "ORB-SLAM2", 2017, table I: 0.70 %, 0.25 deg/100 m; more digits from a few lines of numpy.
    assert_eq!(kitti.all.segments, 3283);
    assert!((kitti.all.translation_percent - 0.699_729).abs() < 1e-5, "{:?}", kitti.all);
    assert!((kitti.all.rotation_deg_per_100m - 0.253_330).abs() < 1e-5, "{:?}", kitti.all);
    assert_eq!(kitti.by_length.len(), 8);
}
