//! Coming back: a lens goes black around a corner, a new world begins, and the worlds merge when a place is known again;
//! rooms that look alike are not taken for one another.

use cairn_engine::Config;
use cairn_sim::WorldKind;
use xtask::Sensor;
use xtask::revisit::{Revisit, Trial, line};

#[test]
fn a_black_lens_costs_neither_map_nor_way() {
    let walk = Revisit { trial: Trial::Dark, world: WorldKind::Hall, sensor: Sensor::Mono, seed: 4 };
    let walked = walk.run(&Config::default(), false).expect("the walk runs");
    let (m, text) = (&walked.measured, line(&walked));
    assert_eq!((m.worlds, m.merges), (1, 1), "{text}");
    assert!(m.ate_m.is_some_and(|ate| ate < 0.15), "{text}");
    assert!(m.coverage() > 0.93, "{text}");
}
