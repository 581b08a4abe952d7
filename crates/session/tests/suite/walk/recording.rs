//! Routes are recorded, also on a disk that fills up, and lead back.

use crate::small::Small;
use crate::walk::scripted::{Walk, engine, folder, out};
use cairn_guide::Route;
use cairn_session::{Disk, Medium, Session, SessionConfig};
use std::io;
use std::path::{Path, PathBuf};

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
    // Said to those who ask.
    assert_eq!(walk.ask("guide home").unwrap(), "Guidance begins.");
    assert!(walk.ask("status").unwrap().contains("from this direction"));
    for line in ["guide backwards", "guide back"] {
        walk.ask(line).unwrap();
        assert!(walk.ask("status").unwrap().ends_with("I should recognise this whole route."));
    }
    walk.ask("guide back").unwrap();
    let told = walk.now;
    let half = out().len() / 2;
    walk.see(out()[half..].iter().rev());
    let here = walk.ask("status").unwrap();
    for words in ["Guiding, ", " metres to go.", "You are on the path."] {
        assert!(here.contains(words), "{words}: {here}");
    }
    walk.see(out()[..half].iter().rev());
    assert!(walk.session.has_arrived(), "{}", walk.transcript());
    let transcript = walk.transcript();
    // What to do is said first, and at once.
    let first = walk.said.iter().find(|(t, words)| *t >= told && words.contains("The route is 1"));
    let (at, words) = first.unwrap_or_else(|| panic!("{transcript}"));
    assert!(at - told < 2.0 && !words.starts_with("The route"), "{transcript}");
    for words in ["Recording.", "Stop. You have arrived"] {
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
    assert!(other.ask("guide home").unwrap_err().contains("with another camera or on another map"));
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

/// A disk on which nothing can be replaced.
struct Full(Small);

impl Disk for Full {
    fn create(&self, _: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(self.0.clone()))
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
    let mut walk = Walk::new(Session::new(engine(), config).on_disk(Box::new(Full(disk.clone()))));
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
    assert!(walk.ask("stop").unwrap_err().contains("its file is not whole"));
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
