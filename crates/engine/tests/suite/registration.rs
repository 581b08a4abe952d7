//! Depth that is not registered to its picture is found from the packets themselves, whoever gives them, and poses are then those of the
//! depth.

use cairn_engine::{Config, Engine, Runner, SensorMode, StageEvent};
use cairn_sensor::{Source, Stamp};
use cairn_sim::SimSource;
use cairn_sources::{OpenOptions, open, std_host};
use cairn_vision::Misregistration;

/// What the engine found in the first frames, and when.
fn found(mut source: Box<dyn Source>, runner: Runner, frames: usize) -> Option<(Stamp, Misregistration)> {
    let rig = source.rig().clone();
    let rate_hz = source.info().rate_hz;
    let mut engine =
        Engine::new(&rig, SensorMode::Rgbd, rate_hz, runner, &Config::default(), &std_host()).expect("a rig");
    let mut all = Vec::new();
    for _ in 0..frames {
        let Some(packet) = source.next_packet().expect("a packet") else { break };
        let output = engine.on_packet(&packet).expect("images of the rig");
        all.extend(output.events.iter().filter_map(StageEvent::misregistered).map(|m| (output.stamp, *m)));
    }
    engine.finish();
    assert!(all.len() < 2, "told once: {all:?}");
    all.pop()
}

#[test]
fn depth_of_a_simulated_camera_is_registered() {
    for world in ["office", "apartment", "street"] {
        let address = format!("sim:{world}?sensor=rgbd&duration=4&rate=10&seed=7");
        let source = SimSource::open(&address).expect("a world");
        assert_eq!(found(Box::new(source), Runner::Lockstep, usize::MAX), None, "{world}");
    }
}

#[test]
fn depth_of_the_kitchen_is_not_registered() {
    let Some(folder) = crate::kitchen() else { return };
    for (start_s, runner) in [(0.0, Runner::Lockstep), (2.0, Runner::Threaded), (5.0, Runner::Lockstep)] {
        let source = open(&folder, OpenOptions { start_s, ..OpenOptions::default() }).expect("a recording");
        // Colour 526 px, depth 585 px.
        let (_, found) = found(source, runner, 60).unwrap_or_else(|| panic!("from {start_s} s"));
        assert!((found.size - 0.90).abs() < 0.025, "from {start_s} s: {found:?}");
    }
}
