//! The camera is covered around a corner: a new map begins, and the maps merge when a place is recognised again.

use bench::Sensors;
use bench::revisit::{Revisit, Trial, line};
use cairn_engine::Config;
use cairn_sim::WorldKind;

#[test]
fn maps_merge_after_a_covered_camera() {
    let walk = Revisit { trial: Trial::Dark, world: WorldKind::Hall, sensor: Sensors::Mono, seed: 4 };
    let walked = walk.run(&Config::default(), false).expect("the walk runs");
    let (m, text) = (&walked.measured, line(&walked));
    println!("{text}");
    assert_eq!((m.worlds, m.merges), (1, 1), "{text}");
    assert!(m.ate_m.is_some_and(|ate| ate < 0.036), "{text}");
    assert!(m.coverage() > 0.945, "{text}");
}
