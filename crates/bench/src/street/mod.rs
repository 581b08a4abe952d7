//! `street`: a large map. A street of kilometres, closed to a ring, is mapped on generated frames (no images); then the
//! real stages walk on in it: tracking, mapping, place recognition, the loop over all of it, saving and opening.

pub(crate) mod build;
mod drive;
mod memory;
mod table;
pub(crate) mod world;

use crate::MeasureError;
use crate::error;
use crate::memory::resident_mb;
use crate::store::{self, camera};
use build::{SPEED_MPS, build};
use cairn_atlas::Snapshot;
use cairn_atlas::store::{About, MapFile};
use cairn_eval::Percentiles;
use cairn_sensor::Stamp;
use cairn_tracking::{Tracker, TrackerConfig};
use cairn_vision::SensorMode;
use drive::{Found, RATE_HZ, Times, Walk};
use memory::{Bytes, queries_ms, resident_for_each};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
pub use table::table;
use world::Street;

/// New walking in metres, in the large map and alone.
const NEW_M: f64 = 100.0;
/// Key frames of the small map in which the same is walked.
const ALONE_M: f64 = 20.0;
/// Where the large map ends before the end of the ring, metres: that much is new, and a little to spare.
const LEFT_M: f64 = NEW_M + 10.0;

/// The stages over new walking.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Walked {
    /// Milliseconds of tracking.
    pub track_ms: Percentiles,
    /// Milliseconds of mapping for each key frame.
    pub map_ms: Percentiles,
    /// Milliseconds of closing for each key frame.
    pub close_ms: Percentiles,
    /// Frames, of which so many with a pose.
    pub frames: [usize; 2],
    /// Key frames that mapping took.
    pub mapped: usize,
    /// Resident megabytes more at its end.
    pub grown_mb: Option<f64>,
}

/// The loop over all of it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Closed {
    /// Seconds to recognise the place, close the loop and relax the map, and to commit that, each alone.
    pub alone_s: [f64; 2],
    /// The same beside tracking.
    pub beside_s: [f64; 2],
    /// Milliseconds of tracking beside it, and over the same frames before.
    pub track_ms: [Option<Percentiles>; 2],
    /// Frames tracked beside it, of which so many with a pose.
    pub frames: [usize; 2],
    /// Distance of the last key frame from the truth before and after, metres.
    pub off_m: [f64; 2],
    /// Mean distance of all key frames from the truth before and after, metres.
    pub mean_off_m: [f64; 2],
    /// Resident megabytes more at the end of it than before.
    pub grown_mb: Option<f64>,
}

/// All figures.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Figures {
    /// Key frames.
    pub key_frames: usize,
    /// Landmarks.
    pub landmarks: usize,
    /// Observations.
    pub observations: usize,
    /// Features for each key frame.
    pub features: f64,
    /// Bytes for each key frame, resident.
    pub resident: Option<f64>,
    /// Bytes for each key frame by structure.
    pub bytes: Bytes,
    /// Milliseconds to commit a key frame: median of each tenth of the way.
    pub commit_ms: Vec<f64>,
    /// Milliseconds of a place query.
    pub query_ms: Percentiles,
    /// New walking in a small map and in the large one.
    pub new: [Walked; 2],
    /// The loop, where it was found.
    pub closed: Option<Closed>,
    /// Saving and opening.
    pub stored: store::Stored,
    /// Milliseconds of the first pose in a map that was opened; `None` when there was none.
    pub first_pose_ms: Option<f64>,
}

/// Measures a street of this length, in a folder for its map.
///
/// # Errors
/// When the map cannot be saved or read back, or a stage gives nothing to measure.
pub fn run(folder: &Path, length_m: usize, features: usize, times: usize) -> Result<Figures, MeasureError> {
    if length_m < 400 || features < 100 {
        return Err("a street has at least 400 m, and frames at least 100 features".into());
    }
    let length = length_m as f64;
    let mut street = Street::new(length_m, features);
    eprintln!("new walking alone");
    let small = build(&mut street, length - LEFT_M - ALONE_M, length - LEFT_M, 1);
    let alone = walk_new(&mut street, &mut Walk::new(small, features))?;
    let mut street = Street::new(length_m, features);
    let before = resident_mb();
    let large = build(&mut street, 0.0, length - LEFT_M, 1);
    let map = large.atlas.latest().clone();
    let commit_ms = large.commit_s.chunks(large.commit_s.len().div_ceil(10)).map(median_ms).collect();
    let resident = resident_for_each(before, map.key_frame_count());
    let bytes = Bytes::of(&map);
    let query_ms = percentiles(&queries_ms(&map, 200))?;
    let (key_frames, landmarks) = (map.key_frame_count(), map.landmark_count());
    let observations: usize = map.landmarks().map(|l| l.observations.len()).sum();
    let of_frames: usize = map.key_frames().map(|k| k.landmarks.len()).sum();
    drop(map);
    eprintln!("new walking in the large map");
    let mut walk = Walk::new(large, features);
    let large = walk_new(&mut street, &mut walk)?;
    eprintln!("the loop");
    let found = walk.go(&mut street, LEFT_M - NEW_M + 60.0, &mut Times::default());
    let (snapshot, closed) = match found {
        Some(found) => close(walk, found, &mut street)?,
        None => (walk.atlas.latest().as_ref().clone(), None),
    };
    eprintln!("saving and opening");
    let (stored, first_pose_ms) = save_and_open(snapshot, folder, times, &mut street, features)?;
    Ok(Figures {
        key_frames,
        landmarks,
        observations,
        features: of_frames as f64 / key_frames.max(1) as f64,
        resident,
        bytes,
        commit_ms,
        query_ms,
        new: [alone, large],
        closed,
        stored,
        first_pose_ms,
    })
}

fn walk_new(street: &mut Street, walk: &mut Walk) -> Result<Walked, MeasureError> {
    let (before, mut times) = (resident_mb(), Times::default());
    if let Some(found) = walk.go(street, NEW_M, &mut times) {
        return Err(format!("a loop was closed where there is none: {:?}", found.accepted).into());
    }
    let ms = |seconds: &[f64]| percentiles(&seconds.iter().map(|s| s * 1e3).collect::<Vec<_>>());
    Ok(Walked {
        track_ms: ms(&times.track_s)?,
        map_ms: ms(&times.map_s)?,
        close_ms: ms(&times.close_s)?,
        frames: [times.track_s.len(), times.tracked],
        mapped: times.map_s.len(),
        grown_mb: resident_mb().zip(before).map(|(now, before)| now - before),
    })
}

/// Commits the loop on a thread of its own while tracking goes on.
fn close(walk: Walk, found: Found, street: &mut Street) -> Result<(Snapshot, Option<Closed>), MeasureError> {
    let (base, id) = (walk.atlas.latest().clone(), found.key_frame);
    // Alone: what was measured when it was found, and its commit on a copy.
    let mut copy = cairn_atlas::Atlas::new(base.as_ref().clone());
    let start = Instant::now();
    copy.commit_since(&base, found.closed.changes);
    let alone_s = [found.seconds, start.elapsed().as_secs_f64()];
    drop(copy);
    let before = resident_mb();
    let (mut closer, mut tracker, from_m) = (walk.closer(), walk.tracker, walk.along_m);
    let mut atlas = walk.atlas;
    let reader = atlas.reader();
    let start_snapshot = base.clone();
    let mut ahead = Vec::new();
    for n in 1..=40 {
        let along = from_m + 0.02 * f64::from(n);
        ahead.push(street.see(along, from_m / SPEED_MPS + f64::from(n) / RATE_HZ, 3).frame);
    }
    let track = |tracker: &mut Tracker, n: usize, map: &Snapshot| {
        // To and fro over the same frames, in time's order.
        let lap = n % (2 * ahead.len() - 2);
        let mut frame = (*ahead[if lap < ahead.len() { lap } else { 2 * ahead.len() - 2 - lap }]).clone();
        frame.stamp = Stamp::from_seconds(from_m / SPEED_MPS + (n + 1) as f64 / RATE_HZ);
        let frame = std::sync::Arc::new(frame);
        let start = Instant::now();
        let tracked = tracker.step(frame, &[], map, false, true);
        (start.elapsed().as_secs_f64() * 1e3, tracked.pose.is_some())
    };
    let pause = Duration::from_millis(30);
    let (mut quiet, mut beside, mut tracked) = (Vec::new(), Vec::new(), 0);
    for n in 0..100 {
        quiet.push(track(&mut tracker, n, &start_snapshot).0);
        std::thread::sleep(pause);
    }
    let job = std::thread::spawn(move || {
        let start = Instant::now();
        let closed = closer.step(&start_snapshot, id);
        let closing = start.elapsed().as_secs_f64();
        let start = Instant::now();
        atlas.commit_since(&start_snapshot, closed.changes);
        (atlas, [closing, start.elapsed().as_secs_f64()])
    });
    while !job.is_finished() {
        let (ms, with_pose) = track(&mut tracker, 100 + beside.len(), &reader.latest());
        beside.push(ms);
        tracked += usize::from(with_pose);
        std::thread::sleep(pause);
    }
    let frames = [beside.len(), tracked];
    let (atlas, beside_s) = job.join().map_err(|_| "closing failed")?;
    let grown_mb = resident_mb().zip(before).map(|(now, before)| now - before);
    let after = atlas.latest().clone();
    let (off_before, off_after) = (errors(street, &base), errors(street, &after));
    let closed = Closed {
        alone_s,
        beside_s,
        track_ms: [Percentiles::of(&beside), Percentiles::of(&quiet)],
        frames,
        off_m: [off_before[0], off_after[0]],
        mean_off_m: [off_before[1], off_after[1]],
        grown_mb,
    };
    Ok((after.as_ref().clone(), Some(closed)))
}

/// Distance of the newest key frame, and mean distance of all, from where they were taken, metres.
fn errors(street: &Street, map: &Snapshot) -> [f64; 2] {
    let each = map.key_frames().map(|k| {
        // The walker's speed is constant: the stamp tells where he was.
        let truth = street.pose((k.stamp - Stamp(0)) * SPEED_MPS).translation;
        (k.world_from_camera.translation - truth).norm()
    });
    let all: Vec<f64> = each.collect();
    [all.last().copied().unwrap_or(0.0), all.iter().sum::<f64>() / all.len().max(1) as f64]
}

fn save_and_open(
    snapshot: Snapshot,
    folder: &Path,
    times: usize,
    street: &mut Street,
    features: usize,
) -> Result<(store::Stored, Option<f64>), MeasureError> {
    let about = About { program: "cairn bench".into(), sensor: SensorMode::Stereo, camera: camera() };
    let file = MapFile { snapshot, about, attached: BTreeMap::new() };
    std::fs::create_dir_all(folder).map_err(error::file(folder))?;
    let path = folder.join(format!("cairn-bench-street-{}.map", std::process::id()));
    let measured = store::measure(&file, &path, times).and_then(|stored| {
        let opened = MapFile::load(&path)?;
        Ok((stored, first_pose_ms(&opened.snapshot, street, features)))
    });
    let _ = std::fs::remove_file(&path);
    measured
}

/// Milliseconds until a frame of the middle of the street has its pose in a map that was opened.
fn first_pose_ms(map: &Snapshot, street: &mut Street, features: usize) -> Option<f64> {
    let mut tracker = Tracker::new(camera(), features, RATE_HZ, TrackerConfig::default());
    let mut ms = 0.0;
    for n in 0..5 {
        let along_m = map.key_frame_count() as f64 * build::STEP_M / 2.0 + 0.1 * f64::from(n);
        let view = street.see(along_m, 1e5 + f64::from(n) / RATE_HZ, 4);
        let start = Instant::now();
        let tracked = tracker.step(view.frame, &[], map, true, true);
        ms += start.elapsed().as_secs_f64() * 1e3;
        if tracked.pose.is_some() {
            return Some(ms);
        }
    }
    None
}

fn percentiles(ms: &[f64]) -> Result<Percentiles, MeasureError> {
    Percentiles::of(ms).ok_or("nothing to measure".into())
}

fn median_ms(seconds: &[f64]) -> f64 {
    Percentiles::of(seconds).map_or(0.0, |p| p.p50 * 1e3)
}
