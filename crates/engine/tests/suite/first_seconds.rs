//! Whether depth is registered is found from the first seconds of a recording, and nothing of them is lost.

use cairn_engine::with_checked_depth;
use cairn_sensor::{Source, Stamp};
use cairn_sim::SimSource;
use cairn_sources::{OpenOptions, open};

fn stamps(mut source: Box<dyn Source>) -> Vec<Stamp> {
    std::iter::from_fn(|| source.next_packet().expect("a packet")).map(|packet| packet.stamp).collect()
}

#[test]
fn depth_of_a_simulated_camera_is_registered() {
    for world in ["office", "apartment", "street"] {
        let address = format!("sim:{world}?sensor=rgbd&duration=4&rate=10&seed=7");
        let source = || Box::new(SimSource::open(&address).expect("a world"));
        let (checked, found) = with_checked_depth(source()).expect("packets");
        assert_eq!(found, None, "{world}");
        assert_eq!(stamps(checked), stamps(source()), "{world}");
    }
    let without_depth = SimSource::open("sim:office?sensor=mono&duration=1").expect("a world");
    let (_, found) = with_checked_depth(Box::new(without_depth)).expect("packets");
    assert_eq!(found, None);
}

#[test]
fn depth_of_the_kitchen_is_not_registered() {
    let Some(folder) = crate::kitchen() else { return };
    for start_s in [0.0, 2.0, 5.0] {
        let options = || OpenOptions { start_s, ..OpenOptions::default() };
        let source = || open(&folder, options()).expect("a recording");
        let (checked, found) = with_checked_depth(source()).expect("packets");
        // Colour 526 px, depth 585 px.
        let found = found.unwrap_or_else(|| panic!("from {start_s} s"));
        assert!((found.size - 0.90).abs() < 0.025, "from {start_s} s: {found:?}");
        assert_eq!(stamps(checked), stamps(source()), "from {start_s} s");
    }
}
