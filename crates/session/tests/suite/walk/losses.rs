//! Images that stay away, are late, or come from a clock that shows anything; SLAM that is away.

use crate::walk::scripted::{RATE_HZ, Walk, engine, folder, out};
use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use cairn_engine::{Engine, Output, Phase, Status};
use cairn_sensor::{Camera, ClockReading, FramePacket, Live, Rig, Source, SourceError, SourceInfo, Stamp};
use cairn_session::{
    Age, Clock, Command, Ended, Event, NotTracked, Observer, Script, Session, SessionConfig, Slam, drive,
};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[test]
fn stream_loss_stops_and_resumes_guidance() {
    let mut walk = Walk::named("stream");
    walk.see(&out()[..1]);
    walk.ask("record").unwrap();
    walk.see(&out()[1..60]);
    // While recording: the loss is announced, and nothing recorded is lost.
    let points = walk.session.status().recording.unwrap().points;
    let gone = walk.now;
    walk.wait(4.0);
    assert!(
        walk.when("No picture from the camera. Stand still.", gone).is_some_and(|t| t - gone < 1.3),
        "{}",
        walk.transcript()
    );
    let status = walk.session.status();
    assert_eq!((status.phase, status.words.as_str()), (Phase::WaitFrames, "No image from the camera."));
    assert!(!status.engine.valid && walk.session.engine().status().valid);
    assert_eq!(walk.session.status().recording.unwrap().points, points);
    walk.see(&out()[59..]);
    assert!(walk.when("The picture is back.", gone).is_some(), "{}", walk.transcript());
    assert_eq!(walk.session.status().phase, Phase::Tracking);
    walk.ask("stop").unwrap();
    let recorded = walk.session.route().unwrap().points.len();
    walk.ask("guide back").unwrap();
    let half = out().len() / 2;
    walk.see(out()[half..].iter().rev());
    // Under guidance: stop within the half second that a pose is valid for, repeated while it lasts, then resumed.
    let gone = walk.now;
    walk.wait(7.0);
    let stop = walk.when("Stop. No picture from the camera.", gone).unwrap_or(f64::INFINITY);
    assert!(stop - gone < 0.7, "after {} s:\n{}", stop - gone, walk.transcript());
    assert!(walk.when("Stop. No picture from the camera.", stop + 1.0).is_some(), "said once only");
    let back = walk.now;
    walk.see(out()[..half].iter().rev());
    let resumed = walk.when("I found my place.", back).unwrap_or(f64::INFINITY);
    assert!(resumed - back < 2.0, "{}", walk.transcript());
    assert!(walk.session.has_arrived(), "{}", walk.transcript());
    assert_eq!(walk.session.route().unwrap().points.len(), recorded);
}

/// The clock of a phone may show anything; a time before zero is a time.
#[test]
fn a_clock_that_begins_before_zero_is_followed() {
    let mut walk = Walk::named("before-zero");
    walk.now = -1e6;
    walk.see(&out()[..20]);
    walk.wait(0.3);
    let status = walk.session.status();
    assert_eq!(status.phase, Phase::Tracking, "{}", status.words);
    assert!((walk.session.elapsed_s() - 2.2).abs() < 0.15, "{}", walk.session.elapsed_s());
    walk.wait(2.0);
    assert!(walk.when("No picture from the camera.", -1e6).is_some(), "{}", walk.transcript());
}

/// A live source whose images have the age set by the test; `None`: the age is unknown.
#[derive(Default)]
struct Delayed {
    age_s: Mutex<Option<f64>>,
    newest: Mutex<Stamp>,
    trouble: Mutex<Option<String>>,
}

impl Live for Delayed {
    fn clock(&self) -> Option<ClockReading> {
        let age_s = (*self.age_s.lock().unwrap())?;
        let now = self.newest.lock().unwrap().plus_seconds(age_s);
        Some(ClockReading { now, bound_s: 0.04, delivery_s: 0.03 })
    }

    fn trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap().clone()
    }
}

#[test]
fn old_pictures_guide_nobody() {
    let mut walk = Walk::named("old");
    walk.see(&out()[..1]);
    walk.ask("record").unwrap();
    walk.see(&out()[1..]);
    walk.ask("stop").unwrap();
    let live = Arc::new(Delayed::default());
    walk.session.follow(live.clone());
    let mut home = out().iter().rev();
    // Images that arrive in time, one each 0.1 s, and are this old when their pose is known.
    let mut see = |walk: &mut Walk, age_s: Option<f64>, count: usize| {
        *live.age_s.lock().unwrap() = age_s;
        for picture in home.by_ref().take(count) {
            *live.newest.lock().unwrap() = Stamp::from_seconds(walk.now + 1.0 / RATE_HZ);
            walk.see([picture]);
        }
    };
    walk.ask("guide back").unwrap();
    see(&mut walk, Some(0.2), 60);
    assert!(walk.transcript().contains("The route is 1"), "{}", walk.transcript());
    assert_eq!(walk.session.age(), Age::Known { age_s: 0.2, bound_s: 0.04, delivery_s: 0.03 });
    assert!(walk.session.status().headline.starts_with("Guiding"), "{}", walk.session.status().headline);
    // As on a slow link: images keep arriving, 0.9 s old. A tenth of a second later the walker is told to stop.
    let slow = walk.now;
    see(&mut walk, Some(0.9), 20);
    let stop = walk.when("Stop. The pictures come too late.", slow).unwrap_or(f64::INFINITY);
    assert!(stop - slow < 0.15, "{}", walk.transcript());
    let status = walk.session.status();
    assert_eq!(
        (status.headline.as_str(), status.guiding.unwrap().state),
        ("Stop. The pictures come too late.", "stopped")
    );
    let words = walk.ask("status").unwrap();
    assert!(words.contains("The picture is 0.9 seconds old, too old to guide."), "{words}");
    // An unknown age counts as too old as well.
    see(&mut walk, None, 35);
    assert!(
        walk.when("Stop. I do not know how old the pictures are.", slow).is_some(),
        "{}",
        walk.transcript()
    );
    let told = walk.said.iter().filter(|(t, _)| *t > slow);
    let other: Vec<_> = told.filter(|(_, words)| !words.starts_with("Stop. ")).collect();
    assert!(other.len() <= 1, "only the status, on request: {other:?}");
    // Fresh images resume guidance after they have arrived for a second.
    let fresh = walk.now;
    see(&mut walk, Some(0.1), 30);
    let back = walk.when("I found my place.", fresh).unwrap_or(f64::INFINITY);
    assert!((1.0..1.4).contains(&(back - fresh)), "{}", walk.transcript());
    // A reason why images are refused is said once.
    *live.trouble.lock().unwrap() = Some("The picture is 480 by 640 now.".into());
    walk.wait(8.0);
    assert_eq!(
        walk.said.iter().filter(|(_, words)| words.contains("480 by 640")).count(),
        1,
        "{}",
        walk.transcript()
    );
}

/// An engine that is away for a while, as one in a process that died.
struct Mortal {
    engine: Engine,
    away: Option<String>,
}

impl Slam for Mortal {
    fn on_packet(&mut self, packet: &FramePacket) -> Result<Output, NotTracked> {
        match &self.away {
            Some(why) => Err(NotTracked::Away(why.clone())),
            None => Slam::on_packet(&mut self.engine, packet),
        }
    }

    fn away(&self) -> Option<&str> {
        self.away.as_deref()
    }

    fn snapshot(&self) -> Arc<Snapshot> {
        self.engine.snapshot()
    }

    fn camera(&self) -> &RectifiedCamera {
        Slam::camera(&self.engine)
    }

    fn status(&self) -> &Status {
        self.engine.status()
    }

    fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        self.engine.to_save(program, attached)
    }
}

#[test]
fn slam_that_is_away_stops_the_walker_and_guidance_goes_on_with_it() {
    const STOP: &str = "Stop. Part of the guide has stopped working.";
    let config = SessionConfig { folder: folder("away"), ..SessionConfig::default() };
    let mut session = Session::new(Mortal { engine: engine(), away: None }, config);
    let (mut now, mut said) = (0.0, Vec::new());
    let mut step = |session: &mut Session<Mortal>, picture: Option<&FramePacket>| {
        now += 1.0 / RATE_HZ;
        let stamp = Stamp::from_seconds(now);
        let seen = picture.map(|p| session.on_packet(&FramePacket { stamp, ..p.clone() }).is_ok());
        if picture.is_none() {
            session.tick(stamp);
        }
        let words = |event| match event {
            Event::Said(said) => Some(said.text),
            Event::Sound(_) => None,
        };
        let heard: Vec<String> = session.events().into_iter().filter_map(words).collect();
        said.extend(heard.iter().cloned());
        (seen, heard)
    };
    let dies = |session: &mut Session<Mortal>| session.engine_mut().away = Some("it was killed".into());
    session.command(&Command::parse("record").unwrap()).unwrap();
    for (n, picture) in out().iter().enumerate() {
        // For two seconds in the middle of the recording.
        if n == 60 {
            dies(&mut session);
            let heard: Vec<String> = (0..20).flat_map(|_| step(&mut session, Some(picture)).1).collect();
            assert_eq!(heard, ["Tracking is starting again. Stand still."]);
            assert_eq!(session.status().phase, Phase::Error);
            session.engine_mut().away = None;
        }
        assert_eq!(step(&mut session, Some(picture)).0, Some(true));
    }
    session.command(&Command::parse("stop").unwrap()).unwrap();
    session.command(&Command::parse("guide back").unwrap()).unwrap();
    let home: Vec<&FramePacket> = out().iter().rev().collect();
    // Until the first direction has been given, and some steps of it.
    let mut pictures = home.iter();
    (0..160).for_each(|_| drop(step(&mut session, Some(home[0]))));
    pictures.by_ref().take(30).for_each(|p| drop(step(&mut session, Some(p))));
    dies(&mut session);
    let (_, heard) = step(&mut session, None);
    assert_eq!(heard, [STOP], "at the next moment");
    assert_eq!(step(&mut session, Some(home[30])).0, Some(false));
    session.engine_mut().away = None;
    pictures.for_each(|p| drop(step(&mut session, Some(p))));
    (0..30).for_each(|_| drop(step(&mut session, Some(home[home.len() - 1]))));
    assert!(session.has_arrived(), "{said:#?}");
    assert_eq!(said.iter().filter(|text| *text == STOP).count(), 1, "{said:#?}");
}

/// The images of a walk, of which one takes long to read.
struct Halting(SourceInfo, Rig, usize);

impl Source for Halting {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn rig(&self) -> &Rig {
        &self.1
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        self.2 += 1;
        if self.2 == 12 {
            std::thread::sleep(Duration::from_millis(1600));
        }
        Ok(out()[..14].get(self.2 - 1).cloned())
    }

    fn skipped(&self) -> &[String] {
        &[]
    }
}

/// The phases of a session, each once where it lasts.
#[derive(Default)]
struct Phases(Vec<Phase>);

impl Observer for Phases {
    fn on_step(&mut self, session: &mut Session) {
        let phase = session.engine_status().phase;
        if self.0.last() != Some(&phase) {
            self.0.push(phase);
        }
    }
}

#[test]
fn a_recording_that_gives_no_image_is_not_said_to_be_tracked_meanwhile() {
    let config = SessionConfig { folder: folder("halting"), ..SessionConfig::default() };
    let mut session = Session::new(engine(), config);
    let info = SourceInfo {
        name: "halting".into(),
        frames: Some(14),
        rate_hz: RATE_HZ,
        truth: Vec::new(),
        assumed: None,
    };
    let rig = Rig::mono(Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5));
    let mut phases = Phases::default();
    let ended =
        drive(&mut session, Clock::Paced(&mut Halting(info, rig, 0)), &mut Script::default(), &mut phases)
            .unwrap();
    assert_eq!(ended, Ended::Source);
    let found = phases.0.iter().position(|p| *p == Phase::Tracking).expect("it tracks");
    assert_eq!(phases.0[found..], [Phase::Tracking, Phase::WaitFrames, Phase::Tracking], "{:?}", phases.0);
}
