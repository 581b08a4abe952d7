//! Who uses the library gets poses from depth where depth is not registered to the picture, without having asked for it.

use cairn::{Slam, StageEvent};
use std::path::PathBuf;

#[test]
fn depth_gives_the_poses_of_the_kitchen() {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let root = std::env::var_os("CAIRN_DATA").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = root.join("7scenes-kitchen");
    if !folder.is_dir() {
        println!("skipped: {} is missing", folder.display());
        return;
    }
    let mut source = cairn::open(folder.to_str().unwrap()).unwrap();
    let mut slam = Slam::for_source(&*source).build().unwrap();
    let mut found = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        let output = slam.track(&packet).unwrap();
        found.extend(output.events.iter().filter_map(StageEvent::misregistered).copied());
    }
    slam.finish();
    let ate = slam.accuracy(&source.info().truth).unwrap().ate_m.rmse;
    println!("ATE {ate:.4} m, {found:?}");
    // By features 2.5 cm.
    assert!(ate < 0.0225 && found.len() == 1, "{ate} m, {found:?}");
}
