//! An engine that goes on in the map of another that ended a moment ago, where the map shows too little for its place to be recognised.

use cairn_engine::{Config, Engine, Host, Runner, SensorMode, State};
use cairn_sensor::{FramePacket, Source};
use cairn_sim::{SimConfig, SimSource};
use std::collections::BTreeMap;

#[test]
fn one_that_resumes_has_a_pose_where_recognition_finds_too_few_landmarks() {
    let config =
        SimConfig::parse("sim:corridor?sensor=rgbd&seed=1&rate=15&resolution=320x240&duration=6").unwrap();
    let mut source = SimSource::new(&config).unwrap();
    let (rig, rate_hz) = (source.rig().clone(), source.info().rate_hz);
    let mut settings = Config::default();
    // So few that a pose from the last one is believed, and a place is not.
    settings.front_end.orb.features = 52;
    settings.inertial.enabled = false;
    let mut next = || source.next_packet().unwrap().expect("a packet");
    let mut engine =
        Engine::new(&rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, &settings, &Host::bare()).unwrap();
    while engine.snapshot().key_frame_count() < 1 {
        engine.on_packet(&next()).unwrap();
    }
    let map = engine.to_save("test", BTreeMap::new());
    drop(engine);
    let after: Vec<FramePacket> = (0..6).map(|_| next()).collect();
    let go_on = |resumes: bool, packets: &[FramePacket]| -> Vec<bool> {
        let begun =
            Engine::in_map(&rig, SensorMode::Rgbd, rate_hz, Runner::Lockstep, &settings, &Host::bare(), &map);
        let mut engine = begun.unwrap().0;
        if resumes {
            engine.resume(packets[0].stamp);
        }
        let lost = packets.iter().map(|p| matches!(engine.on_packet(p).unwrap().state, State::Lost { .. }));
        let lost = lost.collect();
        assert_eq!(engine.snapshot().maps().count(), 1);
        lost
    };
    let (with, without) = (go_on(true, &after), go_on(false, &after));
    assert!(with.iter().all(|lost| !lost), "with: {with:?}");
    assert!(without.iter().all(|lost| *lost), "without: {without:?}");
    // A map of long ago tells nothing of where the camera is.
    let late: Vec<FramePacket> =
        after.iter().map(|p| FramePacket { stamp: p.stamp.plus_seconds(60.0), ..p.clone() }).collect();
    let long_ago = go_on(true, &late);
    assert!(long_ago.iter().all(|lost| *lost), "{long_ago:?}");
}
