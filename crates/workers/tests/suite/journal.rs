//! The journal of a map: what is recovered after the writer was killed at any byte, and following it while it is written.
#![cfg(unix)]

use cairn_atlas::store::{About, COMMIT_VERSION, MapFile};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot, Subscription};
use cairn_dense::PackedDepth;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_sensor::{DepthImage, Stamp};
use cairn_vision::{Frame, RectifiedCamera, SensorMode};
use cairn_workers::JournalError;
use cairn_workers::depth_log::{DepthTail, DepthWriter, MOST_VOID};
use cairn_workers::journal::{JournalWriter, Tail, recover};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("journal-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn camera() -> RectifiedCamera {
    RectifiedCamera {
        fx: 450.0,
        fy: 450.0,
        cx: 320.0,
        cy: 240.0,
        baseline_fx: 45.0,
        bounds: [0.0, 0.0, 640.0, 480.0],
        close_depth: 4.0,
        body_from_camera: Se3::identity(),
    }
}

fn file(snapshot: &Snapshot) -> MapFile {
    let about = About { program: "test".into(), sensor: SensorMode::Stereo, camera: camera() };
    MapFile { snapshot: snapshot.clone(), about, attached: BTreeMap::new() }
}

/// A map that grows by a key frame with eight landmarks a commit, and moves what is there.
struct Growing {
    atlas: Atlas,
    stream: Subscription,
    random: Random,
}

impl Growing {
    fn new() -> Self {
        let mut atlas = Atlas::new(Snapshot::new());
        let stream = atlas.subscribe();
        Self { atlas, stream, random: Random::new(5) }
    }

    fn commit(&mut self, journal: &mut JournalWriter) {
        let (random, map) = (&mut self.random, self.atlas.latest().clone());
        let id = map.next_key_frame_id();
        let mut frame = Frame::default();
        frame.stamp = Stamp(id.index() as i64);
        for i in 0..8 {
            let px = [random.uniform_f32(0.0, 640.0), random.uniform_f32(0.0, 480.0)];
            frame.px.push(px);
            frame.raw.push(px);
            frame.octave.push(i);
            frame.angle.push(0.5);
            frame.descriptors.push([i * 17; 32]);
            frame.right_x.push(f32::NAN);
            frame.depth.push(f32::NAN);
        }
        frame.index(&camera());
        let at = Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(id.index() as f64, 0.0, 0.1));
        let parent = map.key_frames().last().map(|k| k.id);
        let mut changes = vec![Change::AddKeyFrame(Box::new(KeyFrame::new(id, Arc::new(frame), at, parent)))];
        for i in 0..8 {
            let l = LandmarkId::from_index(map.next_landmark_id().index() + i).unwrap();
            changes.push(Change::AddLandmark(l, Vec3::new(random.uniform(-1.0, 1.0), 0.0, 4.0)));
            changes.push(Change::Observe(l, id, i as u16));
        }
        if let Some(k) = map.key_frames().last() {
            changes.push(Change::MoveKeyFrame(k.id, k.world_from_camera * at));
        }
        self.atlas.commit(changes);
        self.stream.changes.try_iter().for_each(|c| journal.append(&c).unwrap());
    }
}

fn poses(map: &Snapshot) -> Vec<Se3> {
    map.key_frames().map(|k| k.world_from_camera).collect()
}

fn same(a: &Snapshot, b: &Snapshot) {
    assert_eq!((a.version(), a.landmark_count(), poses(a)), (b.version(), b.landmark_count(), poses(b)));
    assert_eq!(a.check(), Ok(()));
    let points = |s: &Snapshot| s.landmarks().map(|l| (l.id, l.position)).collect::<Vec<_>>();
    assert_eq!(points(a), points(b));
}

fn log_of(folder: &Path) -> PathBuf {
    let logs = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    logs.filter(|p| p.extension().is_some_and(|e| e == "log")).max().unwrap()
}

#[test]
fn writer_killed_at_any_byte_leaves_the_map_of_a_moment_ago() {
    let folder = Folder::new("killed");
    assert!(recover(&folder.0).unwrap().is_none(), "nothing is written yet");
    let mut growing = Growing::new();
    let mut journal = JournalWriter::begin(&folder.0, &file(growing.atlas.latest())).unwrap();
    let (mut maps, mut lengths) = (vec![growing.atlas.latest().clone()], vec![]);
    for _ in 0..6 {
        lengths.push(std::fs::metadata(log_of(&folder.0)).unwrap().len());
        growing.commit(&mut journal);
        maps.push(growing.atlas.latest().clone());
    }
    drop(journal);
    let log = log_of(&folder.0);
    let whole = std::fs::read(&log).unwrap();
    for cut in (0..whole.len()).rev().step_by(7) {
        std::fs::write(&log, &whole[..cut]).unwrap();
        let recovered = recover(&folder.0).unwrap().unwrap();
        let commits = lengths[1..].iter().filter(|l| **l <= cut as u64).count();
        assert_eq!(recovered.commits, commits, "cut at {cut}");
        same(&recovered.file.snapshot, &maps[commits]);
    }
    // A damaged byte ends it likewise, and the next process goes on from there.
    let mut damaged = whole.clone();
    damaged[lengths[4] as usize + 30] ^= 1;
    std::fs::write(&log, &damaged).unwrap();
    let recovered = recover(&folder.0).unwrap().unwrap();
    same(&recovered.file.snapshot, &maps[4]);
    let mut growing = Growing { atlas: Atlas::new(recovered.file.snapshot.clone()), ..Growing::new() };
    growing.stream = growing.atlas.subscribe();
    let mut journal = JournalWriter::resume(&folder.0, &recovered).unwrap();
    (0..3).for_each(|_| growing.commit(&mut journal));
    same(&recover(&folder.0).unwrap().unwrap().file.snapshot, growing.atlas.latest());
}

#[test]
fn followers_see_every_commit_also_over_a_new_base() {
    let folder = Folder::new("followed");
    let mut growing = Growing::new();
    let mut journal = JournalWriter::begin(&folder.0, &file(growing.atlas.latest())).unwrap();
    let mut close = Tail::open(&folder.0).unwrap().unwrap();
    let mut far = Tail::open(&folder.0).unwrap().unwrap();
    for n in 0..30 {
        growing.commit(&mut journal);
        if n % 10 == 9 {
            journal.rebase(file(growing.atlas.latest())).unwrap();
        }
        close.follow().unwrap();
        same(close.map(), growing.atlas.latest());
    }
    growing.commit(&mut journal);
    // The logs that this one had not read are gone by now: it begins again with the newest base.
    journal.rebase(file(growing.atlas.latest())).unwrap();
    journal.rebase(file(growing.atlas.latest())).unwrap();
    far.follow().unwrap();
    same(far.map(), growing.atlas.latest());
    same(&recover(&folder.0).unwrap().unwrap().file.snapshot, growing.atlas.latest());
}

#[test]
fn log_of_many_small_commits_gets_a_successor_that_followers_find() {
    let folder = Folder::new("many");
    let mut growing = Growing::new();
    let mut journal = JournalWriter::begin(&folder.0, &file(growing.atlas.latest())).unwrap();
    let mut tail = Tail::open(&folder.0).unwrap().unwrap();
    let mut rebased = 0;
    for n in 0..600 {
        growing.commit(&mut journal);
        if journal.is_long() {
            let first = log_of(&folder.0);
            journal.rebase(file(growing.atlas.latest())).unwrap();
            rebased += 1;
            // Also when the new base is complete before the follower looks.
            while !journal.is_complete() {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            assert!(first.exists(), "the log that a follower may still read is kept");
            growing.commit(&mut journal);
        }
        if n % 7 == 0 {
            tail.follow().unwrap();
            same(tail.map(), growing.atlas.latest());
        }
    }
    assert!((1..=3).contains(&rebased), "{rebased} bases");
    let recovered = recover(&folder.0).unwrap().unwrap();
    same(&recovered.file.snapshot, growing.atlas.latest());
    assert!(recovered.commits <= 400, "{} commits are read back", recovered.commits);
}

#[test]
fn follower_waits_for_a_commit_that_is_being_written() {
    let folder = Folder::new("half");
    let mut growing = Growing::new();
    let mut journal = JournalWriter::begin(&folder.0, &file(growing.atlas.latest())).unwrap();
    growing.commit(&mut journal);
    let (first, log) = (growing.atlas.latest().clone(), log_of(&folder.0));
    let half = std::fs::metadata(&log).unwrap().len();
    growing.commit(&mut journal);
    let whole = std::fs::read(&log).unwrap();
    std::fs::write(&log, &whole[..half as usize + 40]).unwrap();
    let mut tail = Tail::open(&folder.0).unwrap().unwrap();
    tail.follow().unwrap();
    same(tail.map(), &first);
    std::fs::write(&log, &whole).unwrap();
    tail.follow().unwrap();
    same(tail.map(), growing.atlas.latest());
}

#[test]
fn journal_of_another_release_is_told() {
    let folder = Folder::new("release");
    let journal = JournalWriter::begin(&folder.0, &file(&Snapshot::new())).unwrap();
    drop(journal);
    let log = log_of(&folder.0);
    let mut bytes = std::fs::read(&log).unwrap();
    bytes[8] = 77;
    std::fs::write(&log, &bytes).unwrap();
    let why = recover(&folder.0).err().unwrap();
    assert!(matches!(why, JournalError::Version { found: 77, .. }));
    assert!(
        why.to_string().ends_with(&format!("it has format 77, this program has format {COMMIT_VERSION}"))
    );
}

#[test]
fn depth_of_key_frames_outlives_its_writer_killed_at_any_byte() {
    let folder = Folder::new("depth");
    let id = |i| KeyFrameId::from_index(i).unwrap();
    let image = |v: u16| PackedDepth::pack(&DepthImage::from_vec(16, 4, vec![v; 64]).unwrap());
    let mut growing = Growing::new();
    let mut journal = JournalWriter::begin(&folder.0, &file(growing.atlas.latest())).unwrap();
    let mut depth = DepthWriter::open(&folder.0, growing.atlas.latest()).unwrap();
    let log = folder.0.join("depth.log");
    let (mut follower, mut lengths) = (DepthTail::new(&folder.0), Vec::new());
    for i in 0..4 {
        lengths.push(std::fs::metadata(&log).unwrap().len());
        depth.append(id(i), Stamp(i as i64), &image(i as u16 + 1), None).unwrap();
        growing.commit(&mut journal);
        let read = follower.follow().unwrap();
        assert_eq!((read.len(), read[0].id, read[0].stamp), (1, id(i), Stamp(i as i64)));
        assert_eq!(read[0].packed, *image(i as u16 + 1).as_bytes());
    }
    // One whose key frame is not committed any more.
    let uncommitted = std::fs::metadata(&log).unwrap().len();
    depth.append(id(4), Stamp(40), &image(9), None).unwrap();
    drop(depth);
    let whole = std::fs::read(&log).unwrap();
    for cut in 0..whole.len() {
        std::fs::write(&log, &whole[..cut]).unwrap();
        let mut depth = DepthWriter::open(&folder.0, growing.atlas.latest()).unwrap();
        depth.append(id(5), Stamp(50), &image(5), None).unwrap();
        let read = DepthTail::new(&folder.0).follow().unwrap();
        let kept = lengths[1..].iter().chain([&uncommitted]).filter(|l| **l <= cut as u64).count();
        let ids: Vec<usize> = read.iter().map(|d| d.id.index()).collect();
        let expected: Vec<usize> = (0..kept).chain([5]).collect();
        assert_eq!(ids, expected, "cut at {cut}");
    }
    // A number without a commit may come again: what was said of it is void for the next writer, once.
    std::fs::write(&log, &whole).unwrap();
    for _ in 0..2 {
        DepthWriter::open(&folder.0, growing.atlas.latest()).unwrap();
        let read = DepthTail::new(&folder.0).follow().unwrap();
        let last: Vec<(usize, bool)> = read.iter().map(|d| (d.id.index(), d.packed.is_empty())).collect();
        assert_eq!(last, [(0, false), (1, false), (2, false), (3, false), (4, false), (4, true)]);
    }
    std::fs::write(&log, b"another program's file").unwrap();
    assert!(matches!(DepthTail::new(&folder.0).follow(), Err(JournalError::Version { .. })));
}

/// An hour in one house: key frames come and go, and what was said of those that are superfluous is written no more.
#[test]
fn depth_that_is_superfluous_does_not_fill_the_disk() {
    let folder = Folder::new("spare");
    let id = |i| KeyFrameId::from_index(i).unwrap();
    let noise = |seed: usize| {
        let pixel = |i: usize| (((i * 7919 + seed * 104_729) * 2_654_435_761) >> 7) as u16;
        PackedDepth::pack(&DepthImage::from_vec(640, 480, (0..640 * 480).map(pixel).collect()).unwrap())
    };
    let images = [noise(1), noise(2)];
    let growing = Growing::new();
    let mut depth = DepthWriter::open(&folder.0, growing.atlas.latest()).unwrap();
    let log = folder.0.join("depth.log");
    let (mut follower, mut late, mut known) =
        (DepthTail::new(&folder.0), DepthTail::new(&folder.0), BTreeMap::new());
    let take = |known: &mut BTreeMap<usize, Stamp>, tail: &mut DepthTail| {
        let mut voids = 0;
        for d in tail.follow().unwrap() {
            match d.is_void() {
                true => voids += usize::from(known.remove(&d.id.index()) == Some(d.stamp)),
                false => assert!(known.insert(d.id.index(), d.stamp).is_none(), "{:?} is told twice", d.id),
            }
        }
        voids
    };
    let (mut most, mut late_known, mut shrunk) = (0, BTreeMap::new(), 0);
    let (mut longest, mut beside) = (Duration::ZERO, Duration::ZERO);
    for i in 0..120 {
        depth.append(id(i), Stamp(i as i64), &images[i % 2], None).unwrap();
        if i >= 8 {
            // One of each eight stays.
            let spare = i - 8;
            if spare % 8 != 0 {
                let began = Instant::now();
                depth.drop_spare(id(spare)).unwrap();
                longest = longest.max(began.elapsed());
                depth.drop_spare(id(spare)).unwrap();
            }
        }
        // What comes while the file is written again is there too; but so fast no key frames come.
        let began = Instant::now();
        while i % 2 == 1 && !depth.settle() {
            std::thread::sleep(Duration::from_millis(1));
        }
        beside = beside.max(began.elapsed());
        take(&mut known, &mut follower);
        if i == 20 {
            take(&mut late_known, &mut late);
        }
        let length = std::fs::metadata(&log).unwrap().len();
        shrunk += usize::from(length < most / 2);
        most = most.max(length);
        assert_eq!(
            known.keys().copied().collect::<Vec<_>>(),
            depth.key_frames().map(|k| k.index()).collect::<Vec<_>>()
        );
    }
    let one = images.iter().map(|p| p.as_bytes().len() as u64).max().unwrap();
    let counts = depth.key_frames().count() as u64;
    println!(
        "{counts} images of {one} bytes count, the file had at most {most} bytes; longest call {longest:?}, {beside:?} beside it"
    );
    assert!(shrunk > 0 && most < 2 * (counts + 1) * one + MOST_VOID, "{most} bytes for {counts} of {one}");
    // One that has not looked for several generations is told what is void by now, and so is one that begins; the next writer goes on.
    assert!(take(&mut late_known, &mut late) > 0);
    let mut anew = BTreeMap::new();
    take(&mut anew, &mut DepthTail::new(&folder.0));
    assert_eq!((&late_known, &anew), (&known, &known));
    // The numbers that the map does not know are void for the next writer, and for who reads it.
    drop(depth);
    let depth = DepthWriter::open(&folder.0, growing.atlas.latest()).unwrap();
    assert_eq!(depth.key_frames().count(), 0);
    let told = follower.follow().unwrap();
    assert!(told.len() == known.len() && told.iter().all(|d| d.is_void() && !d.is_spare()), "{told:?}");
}
