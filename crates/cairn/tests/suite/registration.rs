//! Who uses the library gets poses from depth where depth is not registered to the picture, without having asked for it.

use crate::recordings::recording;
use cairn::{Slam, StageEvent};

#[test]
fn depth_gives_the_poses_of_the_kitchen() {
    let Some(folder) = recording("7scenes-kitchen") else { return };
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
