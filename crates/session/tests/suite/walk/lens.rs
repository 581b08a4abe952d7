//! A phone is learned before a route is recorded.

use crate::walk::scripted::{RATE_HZ, Walk, engine, folder, out};
use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_sensor::Camera;
use cairn_session::{LensKnowledge, LibraryCamera, Session, SessionConfig};
use cairn_sim::{SimConfig, SimSensor, WorldKind};

const LEARN: &str = "Let me learn this phone.";
const READY: &str = "I am ready.";

/// The camera of the walks, as its folder of routes knows it, and an engine that reads their images with a wrong guess of it.
fn guessed() -> (LibraryCamera, Engine) {
    let camera = Camera::pinhole(320, 240, 270.0, 270.0, 159.5, 119.5);
    let config =
        SimConfig { sensor: SimSensor::Rgbd, imu: None, camera, ..SimConfig::new(WorldKind::Demo, 3) };
    let (rig, defaults) = (config.rig(), Config::default());
    let camera = LibraryCamera::of(&rig, SensorMode::Rgbd, &defaults, true).unwrap();
    let guess =
        Engine::new(&rig, SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &defaults, &Host::bare()).unwrap();
    (camera, guess)
}

#[test]
fn no_route_is_recorded_before_the_phone_is_known_and_ready_is_said() {
    let (camera, guess) = guessed();
    // Not by itself either.
    let config = SessionConfig { folder: folder("learn"), auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(guess, config));
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(&out()[..5]);
    assert!(walk.when(LEARN, 0.0).is_some(), "{}", walk.transcript());
    assert!(walk.session.status().headline.starts_with("I am learning this phone."));
    let refused = walk.ask("record").unwrap_err();
    assert!(refused.starts_with(LEARN) && refused.contains("I tell you when I am ready."), "{refused}");
    walk.see(&out()[5..60]);
    assert!(!walk.session.is_recording() && walk.session.may_restart_slam(), "{}", walk.transcript());
    // Found: the map of the guess is gone, and the map of this lens has to prove itself first.
    walk.session.restart_slam(&camera, |_| Ok((engine(), Vec::new()))).unwrap();
    walk.session.knows_of_lens(LensKnowledge::Found);
    assert_eq!(walk.session.engine().snapshot().key_frame_count(), 0);
    assert!(walk.session.place().is_none());
    let found = walk.now;
    walk.see(&out()[..30]);
    assert!(walk.ask("record").unwrap_err().starts_with("Move a few metres first."));
    assert!(walk.when(READY, 0.0).is_none() && !walk.session.is_recording(), "{}", walk.transcript());
    walk.see(&out()[30..]);
    let ready = walk.when(READY, found).unwrap_or_else(|| panic!("{}", walk.transcript()));
    assert!(ready - found < 9.0, "{}", walk.transcript());
    assert_eq!(walk.said.iter().filter(|(_, said)| said.starts_with(READY)).count(), 1);
    // This session records by itself; then eight metres and a turn are eight metres.
    assert!(walk.session.is_recording(), "{}", walk.transcript());
    walk.ask("stop").unwrap();
    walk.see(out().iter().rev());
    walk.ask("record").unwrap();
    walk.see(out());
    let ended = walk.ask("stop").unwrap();
    assert!(ended.starts_with("Recording has ended, 1"), "{ended}");
    assert!(!walk.session.route().unwrap().header.lens_guessed);
    assert!(walk.ask("guide back").is_ok());
}

#[test]
fn a_phone_that_stays_unknown_records_nothing() {
    let config = SessionConfig { folder: folder("never"), auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(engine(), config));
    walk.session.knows_of_lens(LensKnowledge::WithoutMotion);
    walk.see(out());
    let refused = walk.ask("record").unwrap_err();
    assert!(refused.contains("without its motion sensors") && !walk.session.is_recording(), "{refused}");
    assert!(walk.when(READY, 0.0).is_none(), "{}", walk.transcript());
}

#[test]
fn a_route_that_was_recorded_on_a_guess_guides_nobody() {
    // The lens that was kept for this phone does not fit it, as turns out during a recording.
    let (camera, guess) = guessed();
    let config = SessionConfig { folder: folder("guess"), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(guess, config));
    walk.session.knows_of_lens(LensKnowledge::Found);
    walk.see(&out()[..60]);
    assert!(walk.when(LEARN, 0.0).is_none(), "{}", walk.transcript());
    walk.ask("record").unwrap();
    walk.see(&out()[60..100]);
    assert!(!walk.session.may_restart_slam(), "what is recorded hangs on the map");
    walk.session.knows_of_lens(LensKnowledge::FoundForLater);
    walk.see(&out()[100..]);
    assert!(walk.when("Distances are wrong on this route", 0.0).is_some(), "{}", walk.transcript());
    walk.ask("stop").unwrap();
    for line in ["guide home", "guide again"] {
        let refused = walk.ask(line).unwrap_err();
        assert!(refused.ends_with("Please record this route again."), "{refused}");
    }
    // The map of the wrong lens may go now, and the route says of itself why it leads nobody.
    assert!(walk.session.may_restart_slam());
    walk.session.restart_slam(&camera, |_| Ok((engine(), Vec::new()))).unwrap();
    walk.session.knows_of_lens(LensKnowledge::Found);
    let loaded = walk.ask("load").unwrap();
    assert!(loaded.contains("recorded before I knew this phone") && !loaded.contains("metres"), "{loaded}");
    assert!(walk.ask("guide home").is_err() && walk.ask("take me to route 1 start").is_err());
    walk.see(out());
    assert!(walk.when(READY, 0.0).is_some(), "{}", walk.transcript());
    assert_eq!(walk.ask("record").unwrap(), "Recording.");
}
