//! Encoding: from a snapshot to the parts of a file (`layout.rs`). `decode` is the inverse; read the two together.

use super::about::{About, encode_camera, numbers};
use super::container::PartsWriter;
use super::error::StoreError;
use super::layout::{
    ATTACHED, CAMERAS, CHUNK, DESCRIPTORS, FEATURES, MapFile, NO_PICK, ONE_CAMERA, READINGS, RELATIVE_POSES,
    SHOWN,
};
use super::wire::Encoder;
use super::{chunks, readings, relative_poses, scales};
use crate::paged::ReadBackError;
use crate::{InertialState, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_vision::DESCRIPTOR_ID;
use cairn_vision::bow::Vocabulary;
use std::io::{Seek, Write};

/// Rows of existing key frames and landmarks, looked up by binary search: a table by index would grow with
/// all that ever existed.
struct Rows {
    key_frames: Vec<KeyFrameId>,
    landmarks: Vec<LandmarkId>,
}

impl Rows {
    fn new(snapshot: &Snapshot) -> Self {
        // Both are in order of creation.
        let key_frames = snapshot.key_frames().map(|k| k.id).collect();
        Self { key_frames, landmarks: snapshot.landmarks().map(|l| l.id).collect() }
    }

    /// Zero for a removed key frame.
    fn key_frame(&self, id: KeyFrameId) -> u32 {
        self.key_frames.binary_search(&id).map_or(0, |row| row as u32)
    }

    /// Zero for a removed landmark.
    fn landmark(&self, id: LandmarkId) -> u32 {
        self.landmarks.binary_search(&id).map_or(0, |row| row as u32)
    }
}

pub(super) fn write(file: &MapFile, out: &mut (impl Write + Seek)) -> Result<(), StoreError> {
    let snapshot = &file.snapshot;
    if let Some(fault) = snapshot.read_fault() {
        return Err(StoreError::CombineError(fault.to_string()));
    }
    let rows = Rows::new(snapshot);
    let key_frames: Vec<&KeyFrame> = snapshot.key_frames().collect();
    let mut names: Vec<String> =
        ["about", "worlds", "key frames", "motion", "gone", "landmarks", "words", "robots", DESCRIPTORS]
            .map(String::from)
            .into();
    let mixed = snapshot.other_cameras().next().is_some();
    names.extend(mixed.then(|| CAMERAS.to_owned()));
    let scales = scales::encode(snapshot, |id| rows.key_frame(id));
    names.extend(scales.iter().map(|(name, _)| (*name).to_owned()));
    let row = |id| rows.key_frame(id);
    let readings = chunks::encode(READINGS, &key_frames, |chunk| readings::encode(chunk, snapshot, row));
    names.extend(readings.iter().map(|(name, _)| name.clone()));
    let related = chunks::encode(RELATIVE_POSES, &key_frames, |chunk| relative_poses::encode(chunk, row));
    names.extend(related.iter().map(|(name, _)| name.clone()));
    names.push(SHOWN.to_owned());
    names.extend((0..key_frames.len().div_ceil(CHUNK)).map(|i| format!("{FEATURES}{i}")));
    names.extend(file.attached.keys().map(|name| format!("{ATTACHED}{name}")));
    let mut parts = PartsWriter::begin(out, if mixed { super::VERSION } else { ONE_CAMERA }, names)?;
    parts.put(&about(&file.about, snapshot))?;
    parts.put(&maps(snapshot, &rows))?;
    parts.put(&key_frame_columns(&key_frames, &rows))?;
    parts.put(&motion(snapshot, &key_frames, &rows))?;
    parts.put(&gone(snapshot))?;
    parts.put(&landmarks(snapshot))?;
    parts.put(&words(&key_frames)?)?;
    parts.put(&robots(snapshot))?;
    parts.put(&DESCRIPTOR_ID.to_le_bytes())?;
    if mixed {
        parts.put(&cameras(snapshot, &key_frames)?)?;
    }
    for (_, bytes) in &scales {
        parts.put(bytes)?;
    }
    for (_, bytes) in readings.iter().chain(&related) {
        parts.put(bytes)?;
    }
    parts.put(&shown(snapshot, &key_frames, &rows))?;
    for chunk in key_frames.chunks(CHUNK) {
        parts.put(&features(chunk, &rows)?)?;
    }
    for bytes in file.attached.values() {
        parts.put(bytes)?;
    }
    parts.finish()
}

fn about(about: &About, snapshot: &Snapshot) -> Vec<u8> {
    let mut e = Encoder::default();
    about.encode(&mut e);
    e.u32(snapshot.octaves.levels as u32);
    e.f64(snapshot.octaves.factor);
    e.f64(snapshot.right_offset);
    e.u64(snapshot.version);
    for n in [
        snapshot.next_key_frame,
        snapshot.next_landmark,
        snapshot.key_frames.len(),
        snapshot.landmarks.len(),
        snapshot.removed.len(),
        snapshot.maps.len(),
    ] {
        e.u32(n as u32);
    }
    e.0
}

fn maps(snapshot: &Snapshot, rows: &Rows) -> Vec<u8> {
    let mut e = Encoder::default();
    for (map, map_prior) in snapshot.maps() {
        e.u32(rows.key_frame(map.root()));
        e.u8(u8::from(map_prior.is_some()));
        if let Some(map_prior) = map_prior {
            e.u32(map_prior.to.raw());
            e.f64s(&numbers(&map_prior.to_from_root));
            e.f64s(&[map_prior.sigma, map_prior.sigma_rad, map_prior.sigma_log_scale]);
        }
    }
    e.0
}

fn key_frame_columns(key_frames: &[&KeyFrame], rows: &Rows) -> Vec<u8> {
    let mut e = Encoder::default();
    let mut column = |value: &dyn Fn(&KeyFrame) -> u32| {
        e.column_u32(&key_frames.iter().map(|k| value(k)).collect::<Vec<_>>());
    };
    column(&|k| k.id.raw());
    column(&|k| k.parent.map_or(0, |p| rows.key_frame(p) + 1));
    column(&|k| rows.key_frame(k.map.root()));
    column(&|k| k.landmarks.len() as u32);
    column(&|k| k.links.len() as u32);
    column(&|k| k.covisible.len() as u32);
    e.column(key_frames.iter().map(|k| k.stamp.0.to_le_bytes()));
    for i in 0..7 {
        e.column_f64(&key_frames.iter().map(|k| numbers(&k.world_from_camera)[i]).collect::<Vec<_>>());
    }
    e.column_f64(&key_frames.iter().map(|k| k.unit).collect::<Vec<_>>());
    let links = key_frames.iter().flat_map(|k| &k.links);
    e.column_u32(&links.map(|id| rows.key_frame(*id)).collect::<Vec<_>>());
    let covisible = || key_frames.iter().flat_map(|k| &k.covisible);
    e.column_u32(&covisible().map(|(id, _)| rows.key_frame(*id)).collect::<Vec<_>>());
    e.column_u32(&covisible().map(|(_, count)| *count).collect::<Vec<_>>());
    e.0
}

/// Velocities and biases; IMU factors are in parts of their own (`readings.rs`).
fn motion(snapshot: &Snapshot, key_frames: &[&KeyFrame], rows: &Rows) -> Vec<u8> {
    let mut e = Encoder::default();
    e.u32(snapshot.gravity_alignments.len() as u32);
    for (map, times) in snapshot.gravity_alignments.iter() {
        e.u32(rows.key_frame(map.root()));
        e.u32(*times);
    }
    let moving = || key_frames.iter().filter_map(|k| Some((k.id, k.motion.as_ref()?)));
    e.u32(moving().count() as u32);
    e.column_u32(&moving().map(|(id, _)| rows.key_frame(id)).collect::<Vec<_>>());
    for i in 0..9 {
        e.column_f64(&moving().map(|(_, m)| motion_numbers(m)[i]).collect::<Vec<_>>());
    }
    e.0
}

fn motion_numbers(m: &InertialState) -> [f64; 9] {
    let parts = [m.velocity, m.bias.gyro, m.bias.accel];
    std::array::from_fn(|i| parts[i / 3][i % 3])
}

fn gone(snapshot: &Snapshot) -> Vec<u8> {
    let mut e = Encoder::default();
    for (index, (parent, parent_from_it)) in snapshot.removed.iter() {
        e.u32(index as u32 + 1);
        e.u32(parent.raw());
        let rigid = cairn_geometry::Se3::new(parent_from_it.rotation, parent_from_it.translation);
        e.f64s(&numbers(&rigid));
        e.f64(parent_from_it.scale);
    }
    e.0
}

fn landmarks(snapshot: &Snapshot) -> Vec<u8> {
    let mut e = Encoder::default();
    // Ids are rising: their differences are small.
    let mut id_steps = Vec::new();
    steps(snapshot.landmarks().map(|l| l.id.raw()), &mut id_steps);
    e.column_u32(&id_steps);
    for i in 0..3 {
        e.column_f64(&snapshot.landmarks().map(|l| l.position[i]).collect::<Vec<_>>());
    }
    let pick = |l: &crate::Landmark| match usize::from(l.pick) < l.observations.len() {
        true => u32::from(l.pick),
        false => NO_PICK,
    };
    e.column_u32(&snapshot.landmarks().map(pick).collect::<Vec<_>>());
    e.0
}

/// The rows, from 1, of the landmarks that features show.
fn rows_shown(key_frames: &[&KeyFrame], rows: &Rows) -> Vec<u32> {
    let slots = key_frames.iter().flat_map(|k| &k.landmarks);
    slots.map(|l| l.map_or(0, |id| rows.landmark(id) + 1)).collect()
}

fn shown(snapshot: &Snapshot, key_frames: &[&KeyFrame], rows: &Rows) -> Vec<u8> {
    let mut e = Encoder::default();
    e.column_u32(&rows_shown(key_frames, rows));
    snapshot.landmarks().for_each(|l| e.u8(l.octave));
    e.column_f32(&snapshot.landmarks().map(|l| l.angle).collect::<Vec<_>>());
    snapshot.landmarks().for_each(|l| e.0.extend(l.descriptor));
    e.0
}

fn words(key_frames: &[&KeyFrame]) -> Result<Vec<u8>, StoreError> {
    // Words and nodes are rising within a key frame: their differences are small.
    let (mut word_steps, mut weights, mut word_counts) = (Vec::new(), Vec::new(), Vec::new());
    let (mut node_steps, mut features, mut node_counts) = (Vec::new(), Vec::new(), Vec::new());
    for k in key_frames {
        let bag = k.bag.glance().map_err(unreadable(k))?;
        word_counts.push(bag.words().len() as u32);
        node_counts.push(bag.nodes().len() as u32);
        steps(bag.words().iter().map(|(word, _)| word.0), &mut word_steps);
        steps(bag.nodes().iter().map(|(node, _)| *node), &mut node_steps);
        weights.extend(bag.words().iter().map(|(_, weight)| *weight));
        features.extend(bag.nodes().iter().map(|(_, feature)| *feature));
    }
    let mut e = Encoder::default();
    e.u32(Vocabulary::current().facts().checksum);
    e.column_u32(&word_counts);
    e.column_u32(&node_counts);
    e.column_u32(&word_steps);
    e.column_f32(&weights);
    e.column_u32(&node_steps);
    e.column(features.iter().map(|f: &u16| f.to_le_bytes()));
    Ok(e.0)
}

/// The error of a key frame whose features are on the disk and cannot be read.
fn unreadable(k: &KeyFrame) -> impl FnOnce(ReadBackError) -> StoreError {
    let id = k.id;
    move |fault| StoreError::CombineError(format!("{id:?}: {fault}"))
}

/// Stretches of ids, first those of key frames, then those of landmarks.
fn robots(snapshot: &Snapshot) -> Vec<u8> {
    let mut e = Encoder::default();
    for stretches in [&snapshot.names.key_frames, &snapshot.names.landmarks] {
        e.u32(stretches.0.len() as u32);
        for s in &stretches.0 {
            e.u32(s.first as u32);
            e.u32(u32::from(s.robot));
            e.u32(s.seq);
        }
    }
    e.0
}

/// The other cameras, and for each key frame the number of its own, counted from 1; 0 is that of the atlas.
fn cameras(snapshot: &Snapshot, key_frames: &[&KeyFrame]) -> Result<Vec<u8>, StoreError> {
    let count = u8::try_from(snapshot.other_cameras().count())
        .map_err(|_| StoreError::CombineError("more than 255 cameras".into()))?;
    let mut e = Encoder::default();
    e.u8(count);
    for other in snapshot.other_cameras() {
        encode_camera(&mut e, other.sensor, &other.camera);
    }
    for k in key_frames {
        let number = |camera| snapshot.other_cameras().position(|c| c == camera).map_or(0, |n| n + 1);
        e.u8(k.other_camera.as_deref().map_or(0, number) as u8);
    }
    Ok(e.0)
}

/// Differences of rising numbers, the first from 0.
fn steps(values: impl Iterator<Item = u32>, into: &mut Vec<u32>) {
    let mut before = 0;
    into.extend(values.map(|v| v - std::mem::replace(&mut before, v)));
}

fn features(key_frames: &[&KeyFrame], rows: &Rows) -> Result<Vec<u8>, StoreError> {
    let total = key_frames.iter().map(|k| k.landmarks.len()).sum::<usize>();
    let mut e = Encoder(Vec::with_capacity(total * 65 + 1));
    let read = key_frames.iter().map(|k| k.frame.glance().map_err(unreadable(k)));
    let read = read.collect::<Result<Vec<_>, _>>()?;
    let frames = || read.iter();
    // Rectified and raw pixels are the same where there is no lens.
    let raw_is_px = frames()
        .all(|f| f.raw.iter().flatten().map(|v| v.to_bits()).eq(f.px.iter().flatten().map(|v| v.to_bits())));
    e.u8(u8::from(raw_is_px));
    let mut column: Vec<f32> = Vec::with_capacity(total);
    let mut floats = |e: &mut Encoder, of: &dyn Fn(&cairn_vision::Frame, &mut Vec<f32>)| {
        column.clear();
        frames().for_each(|f| of(f, &mut column));
        e.column_f32(&column);
    };
    for axis in 0..2 {
        floats(&mut e, &|f, c| c.extend(f.px.iter().map(|p| p[axis])));
    }
    for axis in 0..2 * usize::from(!raw_is_px) {
        floats(&mut e, &|f, c| c.extend(f.raw.iter().map(|p| p[axis])));
    }
    floats(&mut e, &|f, c| c.extend(&f.angle));
    floats(&mut e, &|f, c| c.extend(&f.right_x));
    floats(&mut e, &|f, c| c.extend(&f.depth));
    e.column_u32(&rows_shown(key_frames, rows));
    frames().for_each(|f| e.0.extend(&f.octave));
    frames().for_each(|f| f.descriptors.iter().for_each(|d| e.0.extend(d)));
    Ok(e.0)
}
