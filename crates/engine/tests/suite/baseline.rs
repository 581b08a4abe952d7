//! A stereo pair whose baseline is in another unit, while the IMU knows better: it is reported with its factor.

use cairn_engine::{Config, Engine, Host, Runner, ScaleVerdict, SensorMode, StageEvent};
use cairn_sources::{OpenOptions, open};

/// What the IMU says of the metres of 9 s of MH_01, its baseline so many times too long: metres in one of the map, and since when.
fn contradicted(folder: &str, times: f64) -> Option<(f64, f64)> {
    let mut source = open(folder, OpenOptions::default()).expect("a recording");
    let mut rig = source.rig().clone();
    let left = rig.cameras[0].body_from_camera.translation;
    let right = &mut rig.cameras[1].body_from_camera.translation;
    *right = left + (*right - left) * times;
    let mut config = Config::default();
    config.inertial.enabled = true;
    let host = Host::bare();
    let mut engine =
        Engine::new(&rig, SensorMode::Stereo, 20.0, Runner::Lockstep, &config, &host).expect("an engine");
    let mut first = None;
    for _ in 0..180 {
        let packet = source.next_packet().expect("a packet").expect("20 s");
        let since_s = packet.stamp - *first.get_or_insert(packet.stamp);
        let output = engine.on_packet(&packet).expect("it fits the rig");
        let check = output.events.iter().find_map(StageEvent::scale_check);
        if let Some(check) = check.filter(|check| check.verdict == ScaleVerdict::Contradicted) {
            assert!(!output.pose.expect("it is tracked").scale.supported);
            return Some((check.scale, since_s));
        }
    }
    None
}

#[test]
fn a_baseline_in_another_unit_is_contradicted_by_the_imu_with_its_factor() {
    let Some(folder) = crate::recording("euroc-mh01") else { return };
    assert_eq!(contradicted(&folder, 1.0), None);
    for times in [0.1, 0.5, 2.0, 10.0] {
        let (scale, since_s) = contradicted(&folder, times).unwrap_or_else(|| panic!("{times}"));
        println!("{times}: {scale:.3} after {since_s:.1} s");
        assert!((scale * times).ln().abs() < 0.1, "{times}: {scale}");
        assert!(since_s < 6.0, "{times}: {since_s} s");
    }
}
