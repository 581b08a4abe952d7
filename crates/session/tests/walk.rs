//! Walks through a rendered world with every command and with failures on the way: the stream stops, the disk is
//! full, the map is corrected. The walker returns with the camera facing back, so that the images of the way out in
//! reverse order are the images of the way home.

mod small;

use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use cairn_engine::{Config, Engine, Output, Phase, Runner, SensorMode, Status};
use cairn_geometry::Se3;
use cairn_guide::{Durable, Route};
use cairn_sensor::{Camera, ClockReading, FramePacket, Live, Stamp};
use cairn_session::{
    Age, Command, Disk, Event, LensKnowledge, LibraryCamera, Medium, NotTracked, Session, SessionConfig, Slam,
};
use cairn_sim::{LiveRig, SimConfig, SimSensor, Walker, WorldKind};
use cairn_vision::RectifiedCamera;
use small::Small;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

const RATE_HZ: f64 = 10.0;

/// Images of a walk of eight metres with a turn, ten a second.
fn out() -> &'static [FramePacket] {
    static OUT: OnceLock<Vec<FramePacket>> = OnceLock::new();
    OUT.get_or_init(|| {
        let config = SimConfig {
            sensor: SimSensor::Rgbd,
            imu: None,
            camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
            rate_hz: RATE_HZ,
            body_from_camera: Se3::identity(),
            walker: Walker { turn_rate: 0.8, ..Walker::default() },
            ..SimConfig::new(WorldKind::Demo, 3)
        };
        let mut rig = LiveRig::new(&config).unwrap();
        let route = rig.world().routes()[0].points.clone();
        let motion = config.walker.motion(&route);
        let frames = (motion.end().min(16.0) * RATE_HZ) as usize;
        (0..frames)
            .map(|k| {
                let t = k as f64 / RATE_HZ;
                rig.packet(Stamp::from_seconds(t), &motion.pose(t)).unwrap()
            })
            .collect()
    })
}

fn engine() -> Engine {
    let camera = Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5);
    let config =
        SimConfig { sensor: SimSensor::Rgbd, imu: None, camera, ..SimConfig::new(WorldKind::Demo, 3) };
    Engine::new(&config.rig(), SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &Config::default()).unwrap()
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cairn-session-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

/// A session with a clock, and its utterances with their times.
struct Walk {
    session: Session,
    now: f64,
    said: Vec<(f64, String)>,
    sounds: usize,
}

impl Walk {
    fn new(session: Session) -> Self {
        Self { session, now: 0.0, said: Vec::new(), sounds: 0 }
    }

    fn named(name: &str) -> Self {
        let config = SessionConfig { folder: folder(name), ..SessionConfig::default() };
        Self::new(Session::new(engine(), config))
    }

    fn hear(&mut self) {
        for event in self.session.events() {
            match event {
                Event::Said(said) => self.said.push((said.stamp.seconds(), said.text)),
                Event::Sound(_) => self.sounds += 1,
            }
        }
    }

    /// Passes images, one every tenth of a second.
    fn see<'a>(&mut self, pictures: impl IntoIterator<Item = &'a FramePacket>) {
        for picture in pictures {
            self.now += 1.0 / RATE_HZ;
            let packet = FramePacket { stamp: Stamp::from_seconds(self.now), ..picture.clone() };
            self.session.on_packet(&packet).unwrap();
            self.hear();
        }
    }

    /// Time passes without an image.
    fn wait(&mut self, seconds: f64) {
        let until = self.now + seconds;
        while self.now < until {
            self.now += 0.05;
            self.session.tick(Stamp::from_seconds(self.now));
            self.hear();
        }
    }

    fn ask(&mut self, line: &str) -> Result<String, String> {
        let done = self.session.command(&Command::parse(line).unwrap());
        self.hear();
        done.map_err(|why| why.words)
    }

    /// When an utterance with this beginning was first given after a time.
    fn when(&self, begins: &str, after: f64) -> Option<f64> {
        self.said.iter().find(|(t, words)| *t >= after && words.starts_with(begins)).map(|(t, _)| *t)
    }

    fn transcript(&self) -> String {
        self.said.iter().map(|(t, words)| format!("{t:6.1}  {words}\n")).collect()
    }
}

#[test]
fn a_guessed_lens_is_told_until_it_is_found() {
    let mut walk = Walk::named("lens");
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(&out()[..5]);
    assert!(walk.when("I do not know the camera of this phone yet", 0.0).is_some(), "{}", walk.transcript());
    assert!(walk.ask("record").unwrap().contains("may be wrong"));
    assert!(!walk.session.may_begin_again(), "what is recorded hangs on the map");
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
    let guess = Engine::new(&rig, SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &defaults).unwrap();
    let config =
        SessionConfig { folder: folder("begin-again"), auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(guess, config));
    walk.session.knows_of_lens(LensKnowledge::Guessed);
    walk.see(&out()[..60]);
    let guessed = walk.session.engine().snapshot().key_frame_count();
    assert!(guessed > 0 && !walk.session.is_recording(), "{}", walk.transcript());
    assert!(walk.session.may_begin_again());
    walk.session.begin_again(&camera, |_| Ok((engine(), Vec::new()))).unwrap();
    walk.session.knows_of_lens(LensKnowledge::Found);
    assert_eq!(walk.session.engine().snapshot().key_frame_count(), 0, "the map of the guess is gone");
    assert!(walk.session.place().is_none());
    walk.see(&out()[..60]);
    assert!(walk.session.is_recording() && !walk.session.may_begin_again(), "{}", walk.transcript());
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

#[test]
fn record_stop_guide_back_arrives_with_the_route_on_disk() {
    let mut walk = Walk::named("whole");
    walk.see(&out()[..5]);
    assert_eq!(walk.ask("record").unwrap(), "Recording.");
    assert!(walk.ask("record").is_err());
    walk.see(&out()[5..]);
    let ended = walk.ask("stop").unwrap();
    assert!(ended.starts_with("Recording has ended, 1") && ended.ends_with("metres."), "{ended}");
    // Before leaving: how well the map covers the views to come. The camera never faced home on the way out.
    assert!(walk.ask("guide home").unwrap().contains("from this direction"));
    assert_eq!(walk.ask("guide backwards").unwrap(), "I should recognise this whole route.");
    let told = walk.now;
    assert_eq!(walk.ask("guide back").unwrap(), "I should recognise this whole route.");
    walk.see(out().iter().rev());
    assert!(walk.session.has_arrived(), "{}", walk.transcript());
    let transcript = walk.transcript();
    assert!(walk.when("I should recognise", told) < walk.when("The route is 1", told), "{transcript}");
    for words in ["Recording.", "The route is 1", "Stop. You have arrived"] {
        assert!(walk.when(words, 0.0).is_some(), "\"{words}\" was not said:\n{transcript}");
    }
    assert!(walk.said.iter().any(|(_, words)| words.contains("Turn ")), "{transcript}");
    assert!(!transcript.contains("lost") && walk.sounds > 5, "{transcript}");
    let on_disk = Route::load(&folder_of("whole").join("route-0001.route")).unwrap();
    same(&on_disk, walk.session.route().unwrap());
    // The latest route can be loaded; in another session it belongs to another map.
    let loaded = walk.ask("load").unwrap();
    assert!(loaded.starts_with("Route 1, 1") && loaded.contains(" metres, today. Loaded."), "{loaded}");
    assert!(walk.ask("guide again").is_ok());
    let mut other =
        Walk::new(Session::new(engine(), SessionConfig { folder: folder_of("whole"), ..Default::default() }));
    assert!(other.ask("load").unwrap().contains("I cannot guide along it"));
    assert!(other.ask("guide home").unwrap_err().contains("map that is not loaded"));
}

/// The same points; reading normalises rotations, which may change their last digit.
fn same(a: &Route, b: &Route) {
    assert_eq!(a.points.len(), b.points.len());
    for (p, q) in a.points.iter().zip(&b.points) {
        let apart = p.odom_from_camera.inverse() * q.odom_from_camera;
        assert!(p.stamp == q.stamp && p.anchor == q.anchor && apart.translation.norm() < 1e-9, "{p:?} {q:?}");
    }
}

fn folder_of(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("cairn-session-{name}-{}", std::process::id()))
}

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
    let started = walk.when("The route is 1", 0.0);
    assert!(started.is_some(), "{}", walk.transcript());
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

impl Disk for Small {
    fn create(&self, _: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(self.clone()))
    }

    fn replace(&self, _: &Path, _: &[u8]) -> io::Result<()> {
        Err(io::Error::new(io::ErrorKind::StorageFull, "no space left on device"))
    }
}

#[test]
fn full_disk_is_announced_and_loses_no_point() {
    let disk = Small::default();
    disk.0.lock().unwrap().1 = 6000;
    let config = SessionConfig { folder: folder("disk"), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(engine(), config).on_disk(Box::new(disk.clone())));
    walk.see(&out()[..1]);
    walk.ask("record").unwrap();
    walk.see(&out()[1..80]);
    assert!(
        walk.when("The disk is full. The route is kept in memory.", 0.0).is_some(),
        "{}",
        walk.transcript()
    );
    assert!(walk.session.status().recording.unwrap().trouble.is_some());
    // The file on the disk holds whole lines.
    let kept = Route::read(disk.0.lock().unwrap().0.as_slice()).unwrap();
    assert!(!kept.torn && kept.points.len() > 5);
    // Room is freed.
    disk.0.lock().unwrap().1 = 10_000_000;
    walk.see(&out()[80..]);
    assert!(walk.when("The route is on disk again.", 0.0).is_some(), "{}", walk.transcript());
    walk.ask("stop").unwrap();
    let whole = Route::read(disk.0.lock().unwrap().0.as_slice()).unwrap();
    same(&whole, walk.session.route().unwrap());
    // The disk stays full to the end: this is said, and guidance home works all the same.
    let disk = Small::default();
    disk.0.lock().unwrap().1 = 3000;
    let config = SessionConfig { folder: folder("disk"), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(engine(), config).on_disk(Box::new(disk)));
    walk.see(&out()[..1]);
    walk.ask("record").unwrap();
    walk.see(&out()[1..]);
    assert!(walk.ask("stop").unwrap_err().contains("incomplete"));
    walk.ask("guide back").unwrap();
    walk.see(out().iter().rev());
    assert!(walk.session.has_arrived(), "{}", walk.transcript());
}

#[test]
fn auto_record_starts_after_a_hundred_tracked_frames() {
    let config = SessionConfig { folder: folder("auto"), auto_record: Some(100), ..SessionConfig::default() };
    let mut walk = Walk::new(Session::new(engine(), config));
    walk.see(&out()[..99]);
    assert!(!walk.session.is_recording());
    walk.see(&out()[99..120]);
    assert!(walk.session.is_recording() && walk.when("Recording.", 9.0).is_some(), "{}", walk.transcript());
    // A walker who stopped guidance does not want it to start again.
    walk.ask("stop").unwrap();
    walk.see(&out()[120..]);
    assert!(!walk.session.is_recording());
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
