//! Routes kept for another day, with the session driven in lockstep through a rendered building: two routes are recorded,
//! the program ends (or is killed), and another session finds them, guides along both, and from the middle.

use crate::small;

use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_geometry::Se3;
use cairn_guide::Route;
use cairn_sensor::{Camera, FramePacket, Rig, Stamp};
use cairn_session::{
    Command, Disk, Event, LibraryCamera, LibraryError, MapKeeper, Medium, RoutesLock, Session, SessionConfig,
    WallTime,
};
use cairn_sim::{LiveRig, SimConfig, SimSensor, Walker, WorldKind};
use small::Small;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, OnceLock};

const RATE_HZ: f64 = 10.0;
const DAY_S: i64 = 86_400;
/// The first route ends and the second begins at this image; both have a corner.
const FIRST: usize = 160;
const SECOND: usize = 300;

fn config(seed: u64) -> SimConfig {
    SimConfig {
        sensor: SimSensor::Rgbd,
        imu: None,
        camera: Camera::pinhole(320, 240, 210.0, 210.0, 159.5, 119.5),
        rate_hz: RATE_HZ,
        body_from_camera: Se3::identity(),
        walker: Walker { turn_rate: 0.8, ..Walker::default() },
        ..SimConfig::new(WorldKind::Demo, seed)
    }
}

fn images(seed: u64, count: usize) -> Vec<FramePacket> {
    images_of(&config(seed), count)
}

fn images_of(config: &SimConfig, count: usize) -> Vec<FramePacket> {
    let mut rig = LiveRig::new(config).unwrap();
    let motion = config.walker.motion(&rig.world().routes()[0].points.clone());
    let packet = |k: usize| {
        let t = k as f64 / RATE_HZ;
        rig.packet(Stamp::from_seconds(t), &motion.pose(t)).unwrap()
    };
    (0..count).map(packet).collect()
}

/// Images of a walk through the building.
fn walk_through() -> &'static [FramePacket] {
    static OUT: OnceLock<Vec<FramePacket>> = OnceLock::new();
    OUT.get_or_init(|| images(3, SECOND))
}

fn rig() -> Rig {
    config(3).rig()
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("cairn-library-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn copy(from: &Path, to: &Path) {
    let _ = std::fs::remove_dir_all(to);
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

struct Walk {
    session: Session,
    now: f64,
    said: Vec<String>,
    notes: Vec<String>,
}

impl Walk {
    fn of(session: Session, notes: Vec<String>) -> Self {
        Self { session, now: 0.0, said: Vec::new(), notes }
    }

    /// A session on the routes of a folder, at a time of day.
    fn on_day(folder: &Path, clock: &Arc<AtomicI64>) -> Self {
        let lock = RoutesLock::take(folder).unwrap();
        let kept = MapKeeper::open(
            lock,
            &rig(),
            SensorMode::Rgbd,
            RATE_HZ,
            Runner::Lockstep,
            &Config::default(),
            &Host::bare(),
        )
        .unwrap();
        let clock = clock.clone();
        let wall = Arc::new(move || WallTime { unix_s: clock.load(Ordering::Relaxed), offset_s: 3600 });
        let session = Session::new(kept.engine, SessionConfig::default());
        Self::of(session.keeping(kept.keeper.with_clock(wall)), kept.notes)
    }

    fn see<'a>(&mut self, images: impl IntoIterator<Item = &'a FramePacket>) {
        for image in images {
            self.now += 1.0 / RATE_HZ;
            let packet = FramePacket { stamp: Stamp::from_seconds(self.now), ..image.clone() };
            self.session.on_packet(&packet).unwrap();
            self.hear();
        }
    }

    fn hear(&mut self) {
        let said = self.session.events().into_iter().filter_map(|e| match e {
            Event::Said(said) => Some(said.text),
            Event::Sound(_) => None,
        });
        self.said.extend(said);
    }

    fn ask(&mut self, line: &str) -> Result<String, String> {
        let done = self.session.command(&Command::parse(line).unwrap());
        self.hear();
        done.map_err(|why| why.words)
    }

    /// What was said since the last call, line by line.
    fn heard(&mut self) -> String {
        std::mem::take(&mut self.said).join("\n")
    }

    fn words(&self) -> Vec<String> {
        self.session.routes().into_iter().map(|r| r.words).collect()
    }
}

/// Records both routes, with a note on each.
fn record_both(walk: &mut Walk) {
    let all = walk_through();
    walk.see(&all[..1]);
    assert!(walk.ask("note door").unwrap_err().contains("Start recording first"));
    walk.ask("record").unwrap();
    walk.see(&all[1..70]);
    assert_eq!(walk.ask("note door on the left").unwrap(), "Noted: door on the left.");
    walk.see(&all[70..100]);
    // The place is that of the mark, not where the words were found.
    walk.ask("mark").unwrap();
    walk.see(&all[100..FIRST]);
    assert_eq!(walk.ask("note right  water fountain").unwrap(), "Noted: water fountain on the right.");
    assert!(walk.ask("stop").unwrap().starts_with("Recording has ended, 1"));
    walk.ask("record").unwrap();
    walk.see(&all[FIRST..270]);
    walk.ask("n").unwrap();
    walk.see(&all[270..]);
    walk.ask("stop").unwrap();
}

#[test]
fn routes_are_found_named_and_walked_after_a_restart() {
    let folder = folder("days");
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let all = walk_through();
    let mut first = Walk::on_day(&folder, &clock);
    assert_eq!(first.ask("routes").unwrap(), "There is no recorded route.");
    record_both(&mut first);
    assert_eq!(first.ask("rename 2 to the   kitchen").unwrap(), "New name: Route 2, to the kitchen.");
    assert!(first.ask(&format!("rename {}", "x".repeat(61))).is_err());
    // What is on disk is not held in memory as well.
    assert_eq!(first.session.recorded().count(), 0);
    let busy = RoutesLock::take(&folder);
    assert!(matches!(busy, Err(LibraryError::Busy(_))), "two programs kept routes in one folder");
    // One route of the building and then the other, in the session that recorded them.
    for line in ["load 1", "load 2", "load 1"] {
        let loaded = first.ask(line).unwrap();
        assert!(loaded.ends_with("Loaded."), "{loaded}");
    }
    first.session.close().unwrap();
    drop(first);

    clock.fetch_add(DAY_S, Ordering::Relaxed);
    let mut day = Walk::on_day(&folder, &clock);
    assert_eq!(day.notes, Vec::<String>::new());
    let listed = day.ask("o").unwrap();
    assert!(listed.starts_with("2 routes. Route 2, to the kitchen, 1"), "{listed}");
    assert!(listed.contains(" metres, yesterday. Route 1, 1"), "{listed}");
    // The first route from its start, localised in the kept map.
    let loaded = day.ask("1").unwrap();
    assert!(loaded.contains("with 2 notes. Loaded."), "{loaded}");
    day.ask("guide again").unwrap();
    day.see(&all[..FIRST]);
    let heard = day.heard();
    assert!(day.session.has_arrived(), "{heard}");
    for words in ["The route is 1", "Door on your left.", "Water fountain on your right."] {
        assert_eq!(heard.matches(words).count(), 1, "{words}:\n{heard}");
    }
    // Straight on along the second, then back along both with the camera facing back: sides are mirrored.
    day.ask("load 2").unwrap();
    day.ask("guide again").unwrap();
    day.see(&all[FIRST..]);
    let heard = day.heard();
    assert!(day.session.has_arrived(), "{heard}");
    // A note needs no words. On this short route the directions leave no time to tell it.
    assert_eq!(Route::load(&folder.join("route-0002.route")).unwrap().notes[0].text, "landmark");
    day.ask("guide back").unwrap();
    day.see(all[FIRST..].iter().rev());
    assert!(day.session.has_arrived(), "{}", day.heard());
    day.ask("load 1").unwrap();
    day.ask("guide back").unwrap();
    day.see(all[..FIRST].iter().rev());
    let heard = day.heard();
    assert!(day.session.has_arrived(), "{heard}");
    for words in ["Door on your right.", "Water fountain on your left."] {
        assert_eq!(heard.matches(words).count(), 1, "{words}:\n{heard}");
    }
    day.session.close().unwrap();
    drop(day);

    // Another day, from the middle of the first route.
    clock.fetch_add(9 * DAY_S, Ordering::Relaxed);
    let mut day = Walk::on_day(&folder, &clock);
    assert!(day.words()[1].ends_with("10 days ago"), "{:?}", day.words());
    day.ask("load 1").unwrap();
    day.ask("guide again").unwrap();
    day.see(&all[90..FIRST]);
    let heard = day.heard();
    assert!(day.session.has_arrived() && heard.contains("You are on the route, "), "{heard}");
    assert!(heard.contains(" metres to go.") && !heard.contains("Door"), "{heard}");
    // Deleting asks, and any other command withdraws the question.
    assert!(day.ask("yes").is_err());
    let asked = day.ask("delete 2").unwrap();
    assert!(
        asked.starts_with("Shall I delete this route? Route 2, to the kitchen, 1")
            && asked.ends_with("Answer yes or no.")
    );
    assert_eq!(day.session.status().question, Some(asked));
    day.ask("routes").unwrap();
    assert!(day.ask("yes").unwrap_err().contains("no question"));
    day.ask("delete 2").unwrap();
    assert_eq!(day.ask("no").unwrap(), "Nothing was deleted.");
    day.ask("delete 2").unwrap();
    assert_eq!(day.ask("y").unwrap(), "Route 2, to the kitchen is deleted.");
    assert!(day.ask("load 2").unwrap_err().contains("no route 2"));
    assert_eq!(day.words().len(), 1);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn killed_in_the_middle_loses_no_route_and_never_misplaces_one() {
    let (live, killed) = (folder("live"), folder("killed"));
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let all = walk_through();
    let mut walk = Walk::on_day(&live, &clock);
    walk.see(&all[..1]);
    walk.ask("record").unwrap();
    // The map is saved every ten seconds; nothing is closed.
    walk.see(&all[1..]);
    // The save is on a thread of its own.
    let map = |folder: &Path| {
        let entries = std::fs::read_dir(folder).unwrap().flatten();
        entries.map(|e| e.path()).find(|p| p.extension().is_some_and(|e| e == "map"))
    };
    let began = std::time::Instant::now();
    while map(&live).is_none() {
        assert!(began.elapsed().as_secs() < 20, "the map was never saved");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    copy(&live, &killed);
    let before = Route::load(&killed.join("route-0001.route")).unwrap();
    let mut again = Walk::on_day(&killed, &clock);
    let route = Route::load(&killed.join("route-0001.route")).unwrap();
    assert!(before.points.len() > 200);
    assert_eq!(route.points.len(), before.points.len());
    // Points of key frames that were not saved are anchored to saved ones.
    let snapshot = again.session.engine().snapshot();
    let newest = snapshot.key_frames().map(|k| k.id.index()).max().unwrap();
    assert!(before.points.iter().any(|p| p.anchor.seq as usize > newest), "the map held everything");
    assert!(route.points.iter().all(|p| p.anchor.seq as usize <= newest));
    // The saved part of the route is walked, with the camera facing back, from where the map ends.
    again.ask("load 1").unwrap();
    again.ask("guide back").unwrap();
    again.see(all[..100].iter().rev());
    let heard = again.heard();
    assert!(again.session.has_arrived() && heard.contains("You are on the route, "), "{heard}");
    drop(again);

    // Without the map the route is listed, and never anchored to key frames of another.
    copy(&live, &killed);
    std::fs::remove_file(map(&killed).unwrap()).unwrap();
    let mut without = Walk::on_day(&killed, &clock);
    without.see(&all[..20]);
    assert!(without.ask("load 1").unwrap().contains("I cannot guide along it"));
    assert!(without.ask("guide home").is_err());
    drop(without);

    // A map that is damaged is set aside and told; what is whole of it is used.
    copy(&live, &killed);
    let damaged = map(&killed).unwrap();
    let bytes = std::fs::read(&damaged).unwrap();
    std::fs::write(&damaged, &bytes[..bytes.len() / 3]).unwrap();
    let told = Walk::on_day(&killed, &clock);
    assert!(told.notes[0].contains("the map is damaged"), "{:?}", told.notes);
    assert!(damaged.with_extension("map-damaged").exists());
    drop((walk, told));
    for folder in [live, killed] {
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

#[test]
fn routes_of_one_session_do_not_displace_each_other() {
    let folder = folder("plain");
    let engine =
        Engine::new(&rig(), SensorMode::Rgbd, RATE_HZ, Runner::Lockstep, &Config::default(), &Host::bare())
            .unwrap();
    let config = SessionConfig { folder: folder.clone(), ..SessionConfig::default() };
    let mut walk = Walk::of(Session::new(engine, config), Vec::new());
    record_both(&mut walk);
    for number in ["1", "2", "1"] {
        walk.ask(&format!("load {number}")).unwrap();
        let ready = walk.ask("guide back");
        assert!(ready.is_ok(), "route {number}: {ready:?}");
        assert!(walk.ask("load 2").unwrap_err().contains("Stop it first"));
        walk.ask("halt").unwrap();
    }
    // A recording in progress ends, and the loaded route is the one at hand.
    walk.ask("record").unwrap();
    walk.see(walk_through()[260..].iter().rev());
    let loaded = walk.ask("load 1").unwrap();
    assert!(loaded.starts_with("Recording has ended, ") && loaded.contains("Route 1"), "{loaded}");
    assert!(walk.session.status().route.unwrap().file.contains("0001"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn recording_that_nobody_asked_for_leaves_no_short_route() {
    let folder = folder("unasked");
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let lock = RoutesLock::take(&folder).unwrap();
    let kept = MapKeeper::open(
        lock,
        &rig(),
        SensorMode::Rgbd,
        RATE_HZ,
        Runner::Lockstep,
        &Config::default(),
        &Host::bare(),
    )
    .unwrap();
    let config = SessionConfig { auto_record: Some(5), ..SessionConfig::default() };
    let mut walk = Walk::of(Session::new(kept.engine, config).keeping(kept.keeper), Vec::new());
    walk.see(&walk_through()[..10]);
    assert!(walk.session.is_recording());
    // A mistaken number ends no recording.
    assert!(walk.ask("load 1").unwrap_err().contains("no route 1") && walk.session.is_recording());
    walk.session.close().unwrap();
    assert!(!folder.join("route-0001.route").exists());
    // One that was asked for is kept, however short.
    walk.ask("record").unwrap();
    walk.see(&walk_through()[10..15]);
    walk.session.close().unwrap();
    assert!(folder.join("route-0001.route").exists());
    drop((walk, clock));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn another_building_is_no_place_on_the_route() {
    let folder = folder("elsewhere");
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let mut walk = Walk::on_day(&folder, &clock);
    walk.see(&walk_through()[..1]);
    walk.ask("record").unwrap();
    walk.see(&walk_through()[1..60]);
    walk.ask("stop").unwrap();
    walk.session.close().unwrap();
    drop(walk);
    // A map of its own is begun there, in metres like the other; nothing relates their frames.
    let mut there = Walk::on_day(&folder, &clock);
    there.ask("load 1").unwrap();
    there.ask("guide home").unwrap();
    there.heard();
    there.see(&images(11, 150));
    assert!(there.session.engine().snapshot().maps().count() > 1);
    let heard = there.heard();
    assert!(heard.contains("I do not recognise this place yet."), "{heard}");
    for direction in ["Turn left", "Turn right", "Turn around", "Continue", "The route is", "arrived"] {
        assert!(!heard.contains(direction), "{direction}:\n{heard}");
    }
    // A route of that building is kept beside the other.
    there.ask("halt").unwrap();
    there.ask("record").unwrap();
    there.see(&images(11, 200)[150..]);
    there.ask("stop").unwrap();
    assert!(there.session.routes().iter().all(|r| r.why_not.is_none()) && there.words().len() == 2);
    std::fs::remove_dir_all(&folder).unwrap();
}

impl Disk for Small {
    fn create(&self, _: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(self.clone()))
    }

    fn replace(&self, _: &Path, content: &[u8]) -> io::Result<()> {
        let (_, room) = *self.0.lock().unwrap();
        match content.len() > room {
            true => Err(io::Error::new(io::ErrorKind::StorageFull, "no space left on device")),
            false => Ok(()),
        }
    }
}

#[test]
fn full_disk_refuses_a_name_and_leaves_the_route_as_it_was() {
    let folder = folder("full");
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let mut walk = Walk::on_day(&folder, &clock);
    walk.see(&walk_through()[..1]);
    walk.ask("record").unwrap();
    walk.see(&walk_through()[1..30]);
    walk.ask("stop").unwrap();
    let file = folder.join("route-0001.route");
    let before = std::fs::read(&file).unwrap();
    walk.session = walk.session.on_disk(Box::new(Small::default()));
    assert!(walk.ask("rename 1 home").unwrap_err().contains("no space left"));
    assert_eq!(std::fs::read(&file).unwrap(), before);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Two eyes that walk where the depth camera of the other tests does, with another lens.
fn two_eyes() -> SimConfig {
    SimConfig {
        sensor: SimSensor::Stereo,
        camera: Camera::pinhole(400, 300, 300.0, 300.0, 199.5, 149.5),
        ..config(3)
    }
}

#[test]
fn cameras_with_metres_share_one_atlas_and_walk_each_others_routes() {
    let folder = folder("cameras");
    let clock = Arc::new(AtomicI64::new(20_000 * DAY_S));
    let mut walk = Walk::on_day(&folder, &clock);
    walk.see(&walk_through()[..1]);
    walk.ask("record").unwrap();
    walk.see(&walk_through()[1..100]);
    walk.ask("stop").unwrap();
    walk.session.close().unwrap();
    drop(walk);

    // Another camera finds the place, is guided along that route, and leaves one of its own.
    let stereo = two_eyes();
    let pair = LibraryCamera::of(&stereo.rig(), SensorMode::Stereo, &Config::default(), true).unwrap();
    let open = |camera: &LibraryCamera| {
        MapKeeper::open_with(RoutesLock::take(&folder).unwrap(), None, camera, |map| {
            let (rig, config) = (stereo.rig(), Config::default());
            match map {
                Some(file) => Engine::in_map(
                    &rig,
                    SensorMode::Stereo,
                    RATE_HZ,
                    Runner::Lockstep,
                    &config,
                    &Host::bare(),
                    file,
                ),
                None => Ok((
                    Engine::new(&rig, SensorMode::Stereo, RATE_HZ, Runner::Lockstep, &config, &Host::bare())?,
                    Vec::new(),
                )),
            }
        })
        .unwrap()
    };
    let kept = open(&pair);
    assert!(kept.notes.iter().any(|note| note.contains("keep their camera")), "{:?}", kept.notes);
    let session = Session::new(kept.engine, SessionConfig::default());
    let mut there = Walk::of(session.keeping(kept.keeper), kept.notes);
    there.see(&images_of(&stereo, 20));
    there.ask("load 1").unwrap();
    let ready = there.ask("guide again");
    assert!(ready.is_ok(), "{ready:?}");
    assert!(there.session.status().guiding.is_some());
    there.ask("halt").unwrap();
    there.ask("record").unwrap();
    there.see(&images_of(&stereo, 100)[20..]);
    there.ask("stop").unwrap();
    assert_eq!(there.session.engine().snapshot().maps().count(), 1);
    there.session.close().unwrap();
    drop(there);

    // One whose lens is a guess leaves it alone.
    let guess =
        LibraryCamera::of(&two_other_eyes().rig(), SensorMode::Stereo, &Config::default(), false).unwrap();
    assert_eq!(open(&guess).engine.snapshot().key_frame_count(), 0);

    // The first one has both routes, in one atlas.
    let mut again = Walk::on_day(&folder, &clock);
    again.see(&walk_through()[..20]);
    let routes = again.session.routes();
    assert!(routes.len() == 2 && routes.iter().all(|r| r.why_not.is_none()), "{routes:?}");
    let atlases = std::fs::read_dir(&folder)
        .unwrap()
        .flatten()
        .filter(|e| e.path().extension().is_some_and(|x| x == "map"));
    assert_eq!(atlases.count(), 1);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// With a lens that nobody has.
fn two_other_eyes() -> SimConfig {
    SimConfig { camera: Camera::pinhole(400, 300, 330.0, 330.0, 199.5, 149.5), ..two_eyes() }
}
