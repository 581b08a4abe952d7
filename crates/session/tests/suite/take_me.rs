//! A walker who went out is taken back to where the recording started, by the command, over the recorded routes, through
//! the whole engine; and what cannot be done is refused with the reason.

use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_geometry::Se3;
use cairn_guide::GuideState;
use cairn_sensor::{Camera, Stamp};
use cairn_session::{Command, MapKeeper, RoutesLock, Session, SessionConfig};
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
    let engine = Engine::new(
        &config.rig(),
        SensorMode::Rgbd,
        10.0,
        Runner::Lockstep,
        &Config::default(),
        &Host::bare(),
    )
    .unwrap();
    let mut session =
        Session::new(engine, SessionConfig { folder: folder.clone(), ..SessionConfig::default() });
    let mut rig = LiveRig::new(&config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());

    let ask = |session: &mut Session, line: &str| {
        session.command(&Command::parse(line).unwrap()).map_err(|why| why.words)
    };
    assert!(ask(&mut session, "take me").unwrap().contains("no route was recorded"));
    assert!(ask(&mut session, "take me to the kitchen").unwrap_err().contains("no route was recorded"));
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

    ask(&mut session, "rename 1 to the kitchen").unwrap();
    let unknown = ask(&mut session, "take me to the attic").unwrap_err();
    assert!(
        unknown.contains("called the attic. I can take you to: the kitchen, the start of the kitchen."),
        "{unknown}"
    );
    assert_eq!(ask(&mut session, "t").unwrap(), "I can take you to: the kitchen, the start of the kitchen.");
    assert_eq!(ask(&mut session, "take me to the kitchen").unwrap_err(), "You are there already.");
    assert!(session.guide_state().is_none());
    for line in ["take me to 1 start", "take me to route 1 start", "take me to the start of the kitchen"] {
        let going = ask(&mut session, line).unwrap();
        let metres =
            going.strip_prefix("Going to the start of the kitchen, ").and_then(|s| s.split_once(' '));
        let metres: f64 = metres.unwrap_or_else(|| panic!("{going}")).0.parse().unwrap();
        assert!((5.0..15.0).contains(&metres), "{going}");
    }
    session.command(&Command::parse("set language de").unwrap()).unwrap();
    let going = ask(&mut session, "take me Anfang von the kitchen").unwrap();
    assert!(going.starts_with("Ziel: Anfang von the kitchen, "), "{going}");
    assert!(session.guide_state().is_some_and(|s| s != GuideState::Arrived), "{:?}", session.guide_state());
    let planned = session.route().unwrap();
    let (out, back) = (length_m(&route.points), length_m(&planned.points));
    assert!(out > 5.0 && (back / out - 1.0).abs() < 0.2, "{back} m planned, {out} m recorded");
    let ends = [planned.points.last(), route.points.first()].map(|p| p.unwrap().odom_from_camera.translation);
    assert!((ends[0] - ends[1]).norm() < 0.3, "{ends:?}");
    // Refused: guidance goes on along the way that was begun, and the recording with it.
    assert!(ask(&mut session, "take me to nowhere").is_err());
    assert!(session.guide_state().is_some() && session.route().unwrap().points.len() > 2);
    let _ = std::fs::remove_dir_all(folder);
}

#[test]
fn a_place_that_is_not_recognised_is_not_guided_from() {
    let folder = std::env::temp_dir().join(format!("cairn-take-me-lost-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let config = SimConfig {
        sensor: SimSensor::Rgbd,
        imu: None,
        camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
        rate_hz: 10.0,
        body_from_camera: Se3::identity(),
        ..SimConfig::new(WorldKind::Demo, 3)
    };
    let mut rig = LiveRig::new(&config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());
    let open = || {
        let lock = RoutesLock::take(&folder).unwrap();
        let (rig, engine) = (config.rig(), Config::default());
        let kept =
            MapKeeper::open(lock, &rig, SensorMode::Rgbd, 10.0, Runner::Lockstep, &engine, &Host::bare())
                .unwrap();
        Session::new(kept.engine, SessionConfig::default()).keeping(kept.keeper)
    };
    let mut walk = |session: &mut Session, range: std::ops::Range<u32>, at_s: f64| {
        for k in range {
            let t = 0.1 * f64::from(k);
            let packet = rig.packet(Stamp::from_seconds(at_s + t), &motion.pose(t)).unwrap();
            session.on_packet(&packet).unwrap();
        }
    };
    let mut session = open();
    session.command(&Command::Record).unwrap();
    walk(&mut session, 0..80, 0.0);
    session.command(&Command::Stop).unwrap();
    session.close().unwrap();
    drop(session);
    // Another day: before the first image nothing is known of the place; then it is recognised, and the way is taken.
    let mut session = open();
    let to_start = Command::TakeMe("1 start".into());
    assert_eq!(session.command(&to_start).unwrap_err().words, "I do not know yet where you are.");
    walk(&mut session, 60..75, 100.0);
    let going = session.command(&to_start).unwrap();
    assert!(going.starts_with("Going to the start of route 1, "), "{going}");
    drop(session);
    let _ = std::fs::remove_dir_all(folder);
}
