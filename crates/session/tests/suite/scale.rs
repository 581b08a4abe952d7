//! Mono with IMU: recording starts before the scale is initialised, and the finished route is metric.

use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_guide::{Facing, Route};
use cairn_sensor::{FramePacket, Source};
use cairn_session::{Command, Event, Session, SessionConfig, View, anchor_in_map};
use cairn_sim::SimSource;
use std::path::PathBuf;

const HALL: &str =
    "sim:hall?seed=4&sensor=mono-imu&resolution=400x300&focal=260&rate=15&detail=0.5&speed=1.1&duration=14";

#[test]
fn recording_becomes_metric_with_late_scale() {
    let mut source = SimSource::open(HALL).unwrap();
    let mut config = Config::default();
    config.inertial.enabled = true;
    let rate_hz = source.info().rate_hz;
    let engine =
        Engine::new(source.rig(), SensorMode::Mono, rate_hz, Runner::Lockstep, &config, &Host::bare())
            .unwrap();
    let folder = std::env::temp_dir().join(format!("cairn-session-scale-{}", std::process::id()));
    let config = SessionConfig { folder: folder.clone(), ..SessionConfig::default() };
    let mut session = Session::new(engine, config);
    let mut said = Vec::new();
    let mut hear = |session: &mut Session| {
        said.extend(session.events().into_iter().filter_map(|event| match event {
            Event::Said(said) => Some(said.text),
            _ => None,
        }))
    };

    // Recording from the first pose on, before the scale is initialised.
    let mut known = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        session.on_packet(&packet).unwrap();
        if session.tracked() == 1 && !session.is_recording() {
            let words = session.command(&Command::Record).unwrap();
            assert!(words.contains("cannot measure distances"), "{words}");
        }
        known.push(session.status().metric);
        hear(&mut session);
    }
    let found = known.iter().position(|metric| *metric).expect("scale is found");
    assert!(found > 15 && known[found..].iter().all(|metric| *metric), "from frame {found} on");

    // What was walked before the scale was initialised counts in metres too.
    let length = session.status().recording.unwrap().length;
    session.command(&Command::Stop).unwrap();
    let route = session.route().unwrap();
    let [first, last] = [route.points[0].stamp, route.points[route.points.len() - 1].stamp];
    let truth: Vec<_> = source.info().truth.iter().filter(|(t, _)| (first..=last).contains(t)).collect();
    let walked: f64 =
        truth.windows(15).step_by(14).map(|w| (w[14].1.translation - w[0].1.translation).norm()).sum();
    assert!((length / walked - 1.0).abs() < 0.15, "{length} m recorded, {walked} m walked");

    // The file is metric too, and guidance says distances.
    let file = std::fs::read_dir(&folder).unwrap().next().unwrap().unwrap().path();
    let kept = Route::load(&file).unwrap();
    assert!(kept.header.metric && kept.points.len() == route.points.len());
    session.command(&Command::Guide { facing: Some(Facing::Home), again: false }).unwrap();
    let guiding = session.status().guiding.unwrap();
    assert!((guiding.length_m / walked - 1.0).abs() < 0.15, "{} m of {walked} m", guiding.length_m);
    hear(&mut session);
    for _ in 0..40 {
        let now = session.now().plus_seconds(0.25);
        session.tick(now);
        hear(&mut session);
    }
    assert!(said.iter().any(|words| words.contains("I can measure distances now.")), "{said:?}");
    assert!(said.iter().any(|words| words.contains("metres")), "{said:?}");
    std::fs::remove_dir_all(folder).unwrap();
}

/// The packets of a world with all times later by so many seconds.
fn packets(world: &str, later_s: f64) -> Vec<FramePacket> {
    let mut source = SimSource::open(world).unwrap();
    let mut all = Vec::new();
    while let Some(mut packet) = source.next_packet().unwrap() {
        packet.stamp = packet.stamp.plus_seconds(later_s);
        packet.imu.iter_mut().for_each(|reading| reading.stamp = reading.stamp.plus_seconds(later_s));
        all.push(packet);
    }
    all
}

/// A phone that is put away and taken out again elsewhere: a moment in another map, whose place and unit of length are guesses, while a
/// recording begins. What is said in metres, and the route, are as if that had not been.
#[test]
fn moment_in_another_map_takes_no_metres_away() {
    let away = packets(&HALL.replace("seed=4", "seed=9"), 30.0);
    let again = packets(HALL, 40.0);
    let (mut session, folder) = walked_session("astray");
    away[..14].iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    session.command(&Command::Record).unwrap();
    away[14..30].iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    assert!(session.engine().snapshot().maps().count() > 1, "the other room has no map");
    assert!(!session.status().metric);
    let mut known = None;
    for (k, packet) in again.iter().enumerate() {
        session.on_packet(packet).unwrap();
        known = known.or_else(|| session.status().metric.then_some(k));
    }
    // The map of the moment is still there, without metres.
    assert!(!session.engine().is_metric());
    assert_eq!(View::of_map(&session.engine().snapshot(), None, 10).up, [0.0, 0.0, 1.0]);
    let known = known.expect("metres are known again");
    assert!(known < 45 && session.status().metric, "after {known} frames");
    let spoken = session.command(&Command::Stop).unwrap();
    let route = session.route().unwrap();
    assert!(route.header.metric);
    let source = SimSource::open(HALL).unwrap();
    let truth = &source.info().truth;
    let length: f64 =
        truth.windows(15).step_by(14).map(|w| (w[14].1.translation - w[0].1.translation).norm()).sum();
    let map = session.engine().snapshot();
    let placed = route.resolve(|anchor| anchor_in_map(&map, anchor));
    let steps = placed
        .windows(2)
        .map(|w| (w[1].frame_from_camera.translation - w[0].frame_from_camera.translation).norm());
    let recorded: f64 = steps.sum();
    println!("{spoken} {length} m walked, {recorded} m recorded, metres after {known} frames");
    // A second of the way in the other room, no faster than the walk, lies before it.
    assert!((length - 0.5..length + 2.0).contains(&recorded), "{length} m walked, {recorded} m recorded");
    std::fs::remove_dir_all(folder).unwrap();
}

/// A session of one camera with an IMU that has walked through the hall and knows metres.
fn walked_session(name: &str) -> (Session<Engine>, PathBuf) {
    let mut config = Config::default();
    config.inertial.enabled = true;
    let source = SimSource::open(HALL).unwrap();
    let rate_hz = source.info().rate_hz;
    let engine =
        Engine::new(source.rig(), SensorMode::Mono, rate_hz, Runner::Lockstep, &config, &Host::bare())
            .unwrap();
    let folder = std::env::temp_dir().join(format!("cairn-session-{name}-{}", std::process::id()));
    let mut session =
        Session::new(engine, SessionConfig { folder: folder.clone(), ..SessionConfig::default() });
    packets(HALL, 0.0).iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    assert!(session.status().metric);
    (session, folder)
}

/// Where tracking is lost, it is not known in which map the walker will be.
#[test]
fn recording_that_begins_without_a_pose_has_no_metres_yet() {
    let (mut session, folder) = walked_session("unplaced");
    let away = packets(&HALL.replace("seed=4", "seed=9"), 30.0);
    away[..2].iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    let tracked = session.tracked();
    session.on_packet(&away[2]).unwrap();
    assert_eq!(session.tracked(), tracked, "tracked in another room");
    let words = session.command(&Command::Record).unwrap();
    assert!(words.contains("cannot measure distances yet"), "{words}");
    packets(HALL, 40.0).iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    assert!(session.status().metric);
    session.command(&Command::Stop).unwrap();
    assert!(session.route().unwrap().header.metric);
    std::fs::remove_dir_all(folder).unwrap();
}

/// What cannot be placed beside the rest has lengths that nobody knows.
#[test]
fn route_with_much_of_it_in_a_map_without_metres_has_none() {
    let (mut session, folder) = walked_session("much-astray");
    let again = packets(HALL, 20.0);
    again[..45].iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    let words = session.command(&Command::Record).unwrap();
    assert_eq!(words, "Recording.");
    again[45..75].iter().for_each(|packet| drop(session.on_packet(packet).unwrap()));
    // Four seconds in the map of another room, which gets no metres: the sensors of the phone are silent there.
    let mut away = packets(&HALL.replace("seed=4", "seed=9"), 30.0);
    away.iter_mut().for_each(|packet| packet.imu.clear());
    let mut astray = Vec::new();
    for packet in &away {
        let tracked = session.tracked();
        session.on_packet(packet).unwrap();
        astray.extend((session.tracked() > tracked && !session.status().metric).then_some(packet.stamp));
        if astray.last().is_some_and(|last| *last - astray[0] > 4.0) {
            break;
        }
    }
    println!("{} frames astray of {}", astray.len(), away.len());
    assert!(astray.len() > 45 && !session.status().metric, "the other room had metres");
    let words = session.command(&Command::Stop).unwrap();
    assert!(!words.contains("metres"), "{words}");
    assert!(!session.route().unwrap().header.metric);
    let file = std::fs::read_dir(&folder).unwrap().next().unwrap().unwrap().path();
    assert!(!Route::load(&file).unwrap().header.metric);
    std::fs::remove_dir_all(folder).unwrap();
}
