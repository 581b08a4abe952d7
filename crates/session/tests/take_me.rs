//! A walker who went out is taken back to where the recording started, over the recorded route, through the whole engine.

use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_geometry::Se3;
use cairn_guide::GuideState;
use cairn_sensor::{Camera, Stamp};
use cairn_session::{Command, Session, SessionConfig};
use cairn_sim::{LiveRig, SimConfig, SimSensor, WorldKind};

#[test]
fn a_walker_is_taken_back_to_the_start_of_a_recorded_route() {
    let folder = std::env::temp_dir().join(format!("cairn-take-me-{}", std::process::id()));
    let config = SimConfig {
        sensor: SimSensor::Rgbd,
        imu: None,
        camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
        rate_hz: 10.0,
        body_from_camera: Se3::identity(),
        ..SimConfig::new(WorldKind::Demo, 3)
    };
    let engine =
        Engine::new(&config.rig(), SensorMode::Rgbd, 10.0, Runner::Lockstep, &Config::default()).unwrap();
    let mut session =
        Session::new(engine, SessionConfig { folder: folder.clone(), ..SessionConfig::default() });
    let mut rig = LiveRig::new(&config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());

    assert!(session.take_me([], "kitchen").unwrap_err().contains("where you are"));
    session.command(&Command::Record).unwrap();
    for k in 0..100 {
        let t = 0.1 * f64::from(k);
        session.on_packet(&rig.packet(Stamp::from_seconds(t), &motion.pose(t)).unwrap()).unwrap();
    }
    session.command(&Command::Stop).unwrap();
    let route = session.route().unwrap().clone();
    let length_m = |points: &[cairn_guide::RoutePoint]| -> f64 {
        let step = |w: &[cairn_guide::RoutePoint]| {
            (w[1].odom_from_camera.translation - w[0].odom_from_camera.translation).norm()
        };
        points.windows(2).map(step).sum()
    };

    let unknown = session.take_me([("kitchen".to_owned(), &route)], "attic").unwrap_err();
    assert!(unknown.contains("attic"), "{unknown}");
    assert!(session.guide_state().is_none());
    session.take_me([("kitchen".to_owned(), &route)], "kitchen start").unwrap();
    assert!(session.guide_state().is_some_and(|s| s != GuideState::Arrived), "{:?}", session.guide_state());
    let planned = session.route().unwrap();
    let (out, back) = (length_m(&route.points), length_m(&planned.points));
    assert!(out > 5.0 && (back / out - 1.0).abs() < 0.2, "{back} m planned, {out} m recorded");
    let ends = [planned.points.last(), route.points.first()].map(|p| p.unwrap().odom_from_camera.translation);
    assert!((ends[0] - ends[1]).norm() < 0.3, "{ends:?}");
    let _ = std::fs::remove_dir_all(folder);
}
