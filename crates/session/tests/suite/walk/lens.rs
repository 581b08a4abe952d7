//! A lens that is not known yet.

use crate::walk::scripted::{RATE_HZ, Walk, engine, folder, out};
use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_sensor::Camera;
use cairn_session::{LensKnowledge, LibraryCamera, Session, SessionConfig};
use cairn_sim::{SimConfig, SimSensor, WorldKind};

#[test]
fn a_guessed_lens_is_told_until_it_is_found() {
    let mut walk = Walk::named("lens");
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(&out()[..5]);
    assert!(walk.when("I do not know the camera of this phone yet", 0.0).is_some(), "{}", walk.transcript());
    assert!(walk.ask("record").unwrap().contains("may be wrong"));
    assert!(!walk.session.may_restart_slam(), "what is recorded hangs on the map");
    walk.session.knows_of_lens(LensKnowledge::FoundForLater);
    walk.see(&out()[5..]);
    // What is being said is said to its end.
    walk.see(out().iter().rev());
    walk.see(out());
    assert!(walk.when("I know the camera of this phone now", 0.0).is_some(), "{}", walk.transcript());
    let told = |words: &str| walk.said.iter().filter(|(_, said)| said.starts_with(words)).count();
    assert_eq!((told("I do not know"), told("I know")), (1, 1), "{}", walk.transcript());
    // The route says so of itself from then on.
    walk.ask("stop").unwrap();
    let loaded = walk.ask("load").unwrap();
    assert!(loaded.contains("recorded before I knew the camera"), "{loaded}");
    assert!(walk.session.route().unwrap().header.lens_guessed);

    let mut walk = Walk::named("lens-known");
    walk.see(&out()[..5]);
    assert_eq!(walk.ask("record").unwrap(), "Recording.");
    assert!(walk.when("I do not know", 0.0).is_none());
    walk.see(&out()[5..]);
    walk.ask("stop").unwrap();
    let loaded = walk.ask("load").unwrap();
    assert!(!loaded.contains("before I knew") && loaded.contains("metres"), "{loaded}");
}

#[test]
fn a_lens_that_becomes_known_is_used_at_once_and_nothing_is_recorded_before() {
    let camera = Camera::pinhole(320, 240, 270.0, 270.0, 159.5, 119.5);
    let config =
        SimConfig { sensor: SimSensor::Rgbd, imu: None, camera, ..SimConfig::new(WorldKind::Demo, 3) };
    let (rig, defaults) = (config.rig(), Config::default());
    let camera = LibraryCamera::of(&rig, SensorMode::Rgbd, &defaults, true).unwrap();
    let guess =
        Engine::new(&rig, SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &defaults, &Host::bare()).unwrap();
    let config =
        SessionConfig { folder: folder("begin-again"), auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(guess, config));
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(&out()[..60]);
    let guessed = walk.session.engine().snapshot().key_frame_count();
    assert!(guessed > 0 && !walk.session.is_recording(), "{}", walk.transcript());
    assert!(walk.session.may_restart_slam());
    walk.session.restart_slam(&camera, |_| Ok((engine(), Vec::new()))).unwrap();
    walk.session.knows_of_lens(LensKnowledge::Found);
    assert_eq!(walk.session.engine().snapshot().key_frame_count(), 0, "the map of the guess is gone");
    assert!(walk.session.place().is_none());
    walk.see(&out()[..60]);
    assert!(walk.session.is_recording() && !walk.session.may_restart_slam(), "{}", walk.transcript());
    walk.see(&out()[60..]);
    let known = walk.when("I know the camera of this phone now. From here on", 0.0);
    assert!(known.is_some(), "{}", walk.transcript());
    // Eight metres and a turn, in true metres.
    let ended = walk.ask("stop").unwrap();
    assert!(ended.starts_with("Recording has ended, 1"), "{ended}");
    // A lens that never becomes known does not cost the way home.
    let config =
        SessionConfig { folder: folder("never-known"), auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(engine(), config));
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(out());
    assert!(!walk.session.is_recording());
    for _ in 0..2 {
        walk.see(out().iter().rev());
        walk.see(out());
    }
    assert!(walk.session.is_recording(), "{}", walk.transcript());
}
