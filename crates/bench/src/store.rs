//! `store`: saving and opening a large synthetic map: a walk along a corridor with plausible features.

use crate::MeasureError;
use crate::error;
use cairn_atlas::store::{About, MapFile, Table};
use cairn_atlas::{Change, ChangeSet, KeyFrame, LandmarkId, Snapshot};
use cairn_eval::process::cpu_s;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Descriptor, Frame, RectifiedCamera, SensorMode};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Costs of saving and opening.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Stored {
    /// Key frames of the map.
    pub key_frames: usize,
    /// Landmarks of the map.
    pub landmarks: usize,
    /// Observations of the landmarks.
    pub observations: usize,
    /// Size of the file, megabytes of 10^6 bytes.
    pub file_mb: f64,
    /// Seconds to save, including fsync, for each repetition.
    pub save_s: Vec<f64>,
    /// Seconds to open with the file in the system's cache, for each repetition.
    pub load_s: Vec<f64>,
    /// CPU seconds to save and to open, on average: independent of other load on the machine.
    pub processor_s: Option<[f64; 2]>,
    /// Stored and unpacked bytes by kind of part.
    pub parts: BTreeMap<String, [u64; 2]>,
}

/// A stereo camera of 752 x 480 with a baseline of 0.11 m.
pub fn camera() -> RectifiedCamera {
    RectifiedCamera {
        fx: 435.0,
        fy: 435.0,
        cx: 367.0,
        cy: 252.0,
        baseline_fx: 47.9,
        bounds: [0.0, 0.0, 752.0, 480.0],
        close_depth: 4.4,
        body_from_camera: Se3::identity(),
    }
}

/// A descriptor of random bits.
fn descriptor(random: &mut Random) -> Descriptor {
    let words: [u64; 4] = std::array::from_fn(|_| random.bits());
    std::array::from_fn(|i| words[i / 8].to_le_bytes()[i % 8])
}

/// A landmark that is still visible.
struct InView {
    id: LandmarkId,
    position: Vec3,
    descriptor: Descriptor,
    octave: u8,
}

/// A map of `key_frames` key frames with `features` features each, along a bending corridor: landmarks between 1 and 15
/// m ahead, observed with half a pixel of noise and some flipped descriptor bits until they leave the view or are
/// missed, five times on average; nine of ten features observe a landmark.
pub fn corridor(key_frames: usize, features: usize) -> Snapshot {
    let (camera, mut rng) = (camera(), Random::new(1));
    let mut map = Snapshot::new();
    let mut in_view: Vec<InView> = Vec::new();
    let mut world_from_camera = Se3::identity();
    for i in 0..key_frames {
        let turn = So3::exp(&Vec3::new(0.0, 0.05 * (i as f64 * 0.05).sin(), 0.0));
        world_from_camera = world_from_camera * Se3::new(turn, Vec3::new(0.0, 0.0, 0.25));
        let (mut frame, mut changes) = (Frame::default(), Vec::new());
        frame.stamp = Stamp(i as i64 * 250_000_000);
        let id = map.next_key_frame_id();
        in_view.retain(|l| {
            let Some([u, v, _]) = camera.project(&(world_from_camera.inverse() * l.position)) else {
                return false;
            };
            let visible = camera.contains(u, v) && rng.unit() > 0.12 && frame.len() * 10 < features * 9;
            if visible {
                let mut descriptor = l.descriptor;
                (0..8).for_each(|_| {
                    let bit = rng.below(256);
                    descriptor[bit / 8] ^= 1 << (bit % 8);
                });
                let depth = (world_from_camera.inverse() * l.position).z;
                changes.push(Change::Observe(l.id, id, frame.len() as u16));
                add(&mut frame, &mut rng, &camera, [u, v], depth, l.octave, descriptor);
            }
            visible
        });
        let mut next = map.next_landmark_id().index();
        while frame.len() < features {
            let pixel = [752.0 * rng.unit(), 480.0 * rng.unit()];
            let (depth, octave, descriptor) =
                (1.0 + 14.0 * rng.unit().powi(2), (8.0 * rng.unit().powi(2)) as u8, descriptor(&mut rng));
            if frame.len() * 10 < features * 9
                && let Some(landmark) = LandmarkId::from_index(next)
            {
                next += 1;
                let px = [pixel[0] as f32, pixel[1] as f32];
                let position = world_from_camera * camera.unproject(px, depth);
                changes.push(Change::AddLandmark(landmark, position));
                changes.push(Change::Observe(landmark, id, frame.len() as u16));
                in_view.push(InView { id: landmark, position, descriptor, octave });
            }
            add(&mut frame, &mut rng, &camera, pixel, depth, octave, descriptor);
        }
        frame.index(&camera);
        let parent = map.newest_key_frame().map(|k| k.id);
        let bag = Vocabulary::embedded().bag(&frame.descriptors);
        let key_frame = KeyFrame::new(id, Arc::new(frame), world_from_camera, parent).with_bag(Arc::new(bag));
        changes.insert(0, Change::AddKeyFrame(Box::new(key_frame)));
        map = map.apply(&ChangeSet { base: map.version(), changes }).0;
    }
    map
}

/// Adds a feature at a pixel with up to half a pixel of noise.
fn add(
    frame: &mut Frame,
    rng: &mut Random,
    camera: &RectifiedCamera,
    at: [f64; 2],
    depth: f64,
    octave: u8,
    descriptor: Descriptor,
) {
    let px = at.map(|v| (v + rng.unit() - 0.5) as f32);
    // Radial distortion of the raw pixel.
    let off = [px[0] - camera.cx as f32, px[1] - camera.cy as f32];
    let r2 = (off[0] * off[0] + off[1] * off[1]) / (camera.fx * camera.fx) as f32;
    frame.raw.push([px[0] - 0.28 * r2 * off[0], px[1] - 0.28 * r2 * off[1]]);
    frame.px.push(px);
    frame.octave.push(octave);
    frame.angle.push((std::f64::consts::TAU * (rng.unit() - 0.5)) as f32);
    frame.descriptors.push(descriptor);
    let measured = rng.unit() < 0.6;
    frame.depth.push(if measured { depth as f32 } else { f32::NAN });
    frame.right_x.push(if measured { px[0] - (camera.baseline_fx / depth) as f32 } else { f32::NAN });
}

/// Saves and opens such a map `times` times in a folder, and checks that it is read back.
///
/// # Errors
/// When the folder or the file cannot be written or read, or a different map is read.
pub fn run(folder: &Path, key_frames: usize, features: usize, times: usize) -> Result<Stored, MeasureError> {
    let map = corridor(key_frames, features);
    let about = About { program: "cairn bench".into(), sensor: SensorMode::Stereo, camera: camera() };
    let file = MapFile { snapshot: map, about, attached: BTreeMap::new() };
    std::fs::create_dir_all(folder).map_err(error::file(folder))?;
    let path = folder.join(format!("cairn-bench-store-{}.map", std::process::id()));
    let measured = measure(&file, &path, times);
    let _ = std::fs::remove_file(&path);
    measured
}

/// Saves and opens a map `times` times.
///
/// # Errors
/// As [`run`].
pub fn measure(file: &MapFile, path: &Path, times: usize) -> Result<Stored, MeasureError> {
    let map = &file.snapshot;
    let mut stored = Stored {
        key_frames: map.key_frame_count(),
        landmarks: map.landmark_count(),
        observations: map.landmarks().map(|l| l.observations.len()).sum(),
        file_mb: 0.0,
        save_s: Vec::new(),
        load_s: Vec::new(),
        processor_s: None,
        parts: BTreeMap::new(),
    };
    let mut processor = Some([0.0; 2]);
    let since = |before: Option<f64>| Some(cpu_s()? - before?);
    for _ in 0..times.max(1) {
        let before = cpu_s();
        let start = Instant::now();
        let bytes = file.save(path)?;
        stored.save_s.push(start.elapsed().as_secs_f64());
        stored.file_mb = bytes as f64 / 1e6;
        let saved = since(before);
        let before = cpu_s();
        let start = Instant::now();
        let again = MapFile::load(path)?;
        stored.load_s.push(start.elapsed().as_secs_f64());
        let opened = since(before);
        processor = processor.and_then(|[a, b]| Some([a + saved?, b + opened?]));
        if again.snapshot.key_frame_count() != stored.key_frames
            || again.snapshot.landmark_count() != stored.landmarks
        {
            return Err("a different map was read back".into());
        }
    }
    stored.processor_s = processor.map(|sums| sums.map(|s| s / times.max(1) as f64));
    let bytes = std::fs::read(path)?;
    for part in Table::read(&bytes)?.parts {
        let kind = part.name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end().to_owned();
        let [stored, plain] = stored.parts.entry(kind).or_default();
        *stored += part.stored_bytes;
        *plain += part.plain_bytes;
    }
    Ok(stored)
}

/// The figures as text.
pub fn table(s: &Stored) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "map       {} key frames, {} landmarks, {} observations",
        s.key_frames, s.landmarks, s.observations
    );
    let _ = writeln!(text, "file      {:.1} MB", s.file_mb);
    for (kind, [stored, plain]) in &s.parts {
        let _ = writeln!(
            text,
            "  {kind:<12}{:>9.3} MB, {:>9.3} MB unpacked",
            *stored as f64 / 1e6,
            *plain as f64 / 1e6
        );
    }
    for (name, seconds) in [("save", &s.save_s), ("open", &s.load_s)] {
        let least = seconds.iter().copied().fold(f64::INFINITY, f64::min);
        let most = seconds.iter().copied().fold(0.0, f64::max);
        let _ =
            writeln!(text, "{name:<10}min {least:.3} s, max {most:.3} s, of {} repetitions", seconds.len());
    }
    if let Some([save, open]) = s.processor_s {
        let _ = writeln!(text, "CPU       {save:.3} s to save, {open:.3} s to open, on average");
    }
    text
}
