//! Short simulated walks are tracked to the end with little drift.

use bench::walks::{Walk, line, run};
use bench::{RunOptions, Sensors, measure};
use cairn_sim::WorldKind;
use cairn_sources::{OpenOptions, open};

#[test]
fn short_walks_are_tracked_to_the_end() {
    let mut walks = Vec::new();
    for world in [WorldKind::Corridor, WorldKind::Hall] {
        for seed in [0, 5] {
            walks.extend([Sensors::Stereo, Sensors::Rgbd].map(|sensor| Walk::new(world, sensor, seed)));
        }
    }
    for walked in run(&walks, 4.0, 2).expect("the walks run") {
        let m = &walked.measured;
        assert_eq!(m.coverage(), 1.0, "{}: {}", walked.address, line(m));
        let drift = m.drift().expect("poses to align");
        // 10 % above today's worst, 0.16 %.
        assert!(drift < 0.0018, "{}: {}", walked.address, line(m));
    }
}

/// A person walks close ahead, slower than the camera, and covers most of the near landmarks between plain walls.
/// Without static-landmark gating the pose follows that person by more than half a metre.
#[test]
fn pose_does_not_follow_a_person_ahead() {
    for sensor in [Sensors::Stereo, Sensors::Rgbd] {
        let walk =
            Walk { poor: 0.35, passers: 1, blur_ms: 0.0, ..Walk::new(WorldKind::Corridor, sensor, 12) };
        let address = format!("{}&start=18.5", walk.address(6.0));
        let mut source = open(&address, OpenOptions::default()).expect("a simulated walk");
        let m = measure(source.as_mut(), &RunOptions::new(sensor)).expect("the walk runs");
        println!("{address}: {}", line(&m));
        assert_eq!(m.coverage(), 1.0, "{address}: {}", line(&m));
        // 10 % above today's 0.025 and 0.020 m.
        let most_m = if sensor == Sensors::Stereo { 0.028 } else { 0.0225 };
        assert!(m.ate_m.expect("poses to align") < most_m, "{address}: {}", line(&m));
    }
}
