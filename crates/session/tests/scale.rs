//! Mono with IMU: recording starts before the scale is initialised, and the finished route is metric.

use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_guide::{Facing, Route};
use cairn_sensor::Source;
use cairn_session::{Command, Event, Session, SessionConfig};
use cairn_sim::SimSource;

const HALL: &str =
    "sim:hall?seed=4&sensor=mono-imu&resolution=400x300&focal=260&rate=15&detail=0.5&speed=1.1&duration=14";

#[test]
fn recording_becomes_metric_with_late_scale() {
    let mut source = SimSource::open(HALL).unwrap();
    let mut config = Config::default();
    config.inertial.enabled = true;
    let rate_hz = source.info().rate_hz;
    let engine = Engine::new(source.rig(), SensorMode::Mono, rate_hz, Runner::Lockstep, &config).unwrap();
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
