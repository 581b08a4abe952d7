//! Short simulated walks hold their floors: tracked to the end, with little drift.

use cairn_sim::WorldKind;
use xtask::Sensor;
use xtask::walks::{Walk, line, run};

#[test]
fn short_walks_are_tracked_to_the_end() {
    let mut walks = Vec::new();
    for world in [WorldKind::Corridor, WorldKind::Hall] {
        for seed in [0, 5] {
            walks.extend([Sensor::Stereo, Sensor::Rgbd].map(|sensor| Walk::new(world, sensor, seed)));
        }
    }
    for walked in run(&walks, 4.0, 2).expect("the walks run") {
        let m = &walked.measured;
        assert_eq!(m.coverage(), 1.0, "{}: {}", walked.address, line(m));
        let drift = m.drift().expect("poses to align");
        assert!(drift < 0.01, "{}: {}", walked.address, line(m));
    }
}
