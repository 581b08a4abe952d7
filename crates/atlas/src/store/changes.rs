//! Commits as bytes: the journal of a map, from which another process rebuilds it.
//!
//! [`encode_commit`] writes what [`Published`] tells of one commit, [`decode_commit`] reads it back; applied in order to the
//! snapshot they began with, they give the same key frames, landmarks and observations. As in a saved map, IMU factors are
//! left out: whoever goes on with the map has readings of its own. Rows here, not columns: a commit is small, and is read
//! once. Whoever keeps the bytes frames them and checks them for damage.

use super::about::{numbers, pose};
use super::error::StoreError;
use super::relative_poses::{symmetric, upper};
use super::wire::{Decoder, Encoder};
use crate::{
    Change, InertialState, KeyFrame, KeyFrameId, LandmarkId, MapId, MapPrior, Published, Readout,
    RelativePose, Removed,
};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::Bias;
use cairn_sensor::Stamp;
use cairn_vision::bow::{BagOfWords, Vocabulary, WordId};
use cairn_vision::{Frame, Octaves, RectifiedCamera};
use std::sync::Arc;

/// Format version of a commit.
pub const COMMIT_VERSION: u32 = 1;

/// The bytes of a commit.
pub fn encode_commit(commit: &Published) -> Vec<u8> {
    let mut e = Encoder::default();
    e.u64(commit.version);
    e.u32(commit.removed.len() as u32);
    for r in &commit.removed {
        e.u32(r.key_frame.raw());
        e.u32(r.parent.raw());
        similarity(&mut e, &r.parent_from_it);
    }
    let kept = || commit.changes.iter().filter(|c| !matches!(c, Change::ImuFactor(..)));
    e.u32(kept().count() as u32);
    kept().for_each(|change| encode_change(&mut e, change));
    e.0
}

/// The commit of these bytes; `camera` and `octaves` are those of the map ([`super::About::camera`],
/// [`crate::Snapshot::octaves`]).
///
/// # Errors
///
/// [`StoreError::Part`] when the bytes are not those of a commit.
pub fn decode_commit(
    bytes: &[u8],
    camera: &RectifiedCamera,
    octaves: Octaves,
) -> Result<Published, StoreError> {
    let mut d = Decoder::new("commit", bytes);
    let version = d.u64()?;
    let mut removed = Vec::new();
    for _ in 0..d.u32()? {
        let (key_frame, parent) = (key_frame_id(&mut d)?, key_frame_id(&mut d)?);
        removed.push(Removed { key_frame, parent, parent_from_it: read_similarity(&mut d)? });
    }
    let mut changes = Vec::new();
    for _ in 0..d.u32()? {
        changes.push(decode_change(&mut d, camera, octaves)?);
    }
    d.end()?;
    Ok(Published { version, changes, removed })
}

fn encode_change(e: &mut Encoder, change: &Change) {
    match change {
        Change::AddKeyFrame(k) => {
            e.u8(0);
            encode_key_frame(e, k);
        }
        Change::AddLandmark(id, at) => position(e, 1, id.raw(), at),
        Change::MoveKeyFrame(id, at) => {
            e.u8(2);
            e.u32(id.raw());
            e.f64s(&numbers(at));
        }
        Change::Scale(id, factor) => {
            e.u8(3);
            e.u32(id.raw());
            e.f64(*factor);
        }
        Change::InertialState(id, velocity, bias) => {
            position(e, 4, id.raw(), velocity);
            e.f64s(bias.gyro.as_slice());
            e.f64s(bias.accel.as_slice());
        }
        // Left out by encode_commit.
        Change::ImuFactor(..) => {}
        Change::ImuOffset(seconds) => {
            e.u8(5);
            e.f64(*seconds);
        }
        Change::Readout(readout) => {
            e.u8(18);
            e.f64s(&[readout.seconds, readout.sigma_s]);
        }
        Change::LeverArm(arm) => {
            e.u8(21);
            e.f64s(arm.as_slice());
        }
        Change::AlignGravity(map, by) => {
            e.u8(6);
            e.u32(map.root().raw());
            similarity(e, by);
        }
        Change::Rescale(map, factor) => {
            e.u8(7);
            e.u32(map.root().raw());
            e.f64(*factor);
        }
        Change::ScaleSigma(map, sigma_log) => {
            e.u8(19);
            e.u32(map.root().raw());
            e.f64(*sigma_log);
        }
        Change::MoveLandmark(id, to) => position(e, 8, id.raw(), to),
        Change::Observe(l, k, feature) => {
            pair(e, 9, l.raw(), k.raw());
            e.u32(u32::from(*feature));
        }
        Change::Forget(l, k) => pair(e, 10, l.raw(), k.raw()),
        Change::Fuse(a, b) => pair(e, 11, a.raw(), b.raw()),
        Change::Calibrate(px) => {
            e.u8(12);
            e.f64(*px);
        }
        Change::RemoveLandmark(id) => {
            e.u8(13);
            e.u32(id.raw());
        }
        Change::Link(a, b) => pair(e, 14, a.raw(), b.raw()),
        Change::RelativePoses(id, all) => {
            pair(e, 20, id.raw(), all.len() as u32);
            for z in all {
                e.u32(z.from.raw());
                e.f64s(&numbers(&z.from_from_here));
                e.f64s(&upper(&z.information));
            }
        }
        Change::MapPrior(map, prior) => {
            pair(e, 15, map.root().raw(), prior.to.raw());
            e.f64s(&numbers(&prior.to_from_root));
            e.f64s(&[prior.sigma, prior.sigma_rad, prior.sigma_log_scale]);
        }
        Change::Merge { from, into, into_from, parent } => {
            pair(e, 16, from.root().raw(), into.root().raw());
            similarity(e, into_from);
            e.u32(parent.raw());
        }
        Change::RemoveKeyFrame(id) => {
            e.u8(17);
            e.u32(id.raw());
        }
    }
}

fn decode_change(d: &mut Decoder, camera: &RectifiedCamera, octaves: Octaves) -> Result<Change, StoreError> {
    Ok(match d.u8()? {
        0 => Change::AddKeyFrame(Box::new(decode_key_frame(d, camera, octaves)?)),
        1 => Change::AddLandmark(landmark_id(d)?, vector(d)?),
        2 => Change::MoveKeyFrame(key_frame_id(d)?, read_pose(d)?),
        3 => Change::Scale(key_frame_id(d)?, d.f64()?),
        4 => {
            let (id, velocity) = (key_frame_id(d)?, vector(d)?);
            Change::InertialState(id, velocity, Bias { gyro: vector(d)?, accel: vector(d)? })
        }
        5 => Change::ImuOffset(d.f64()?),
        6 => Change::AlignGravity(MapId(key_frame_id(d)?), read_similarity(d)?),
        7 => Change::Rescale(MapId(key_frame_id(d)?), d.f64()?),
        8 => Change::MoveLandmark(landmark_id(d)?, vector(d)?),
        9 => {
            let (l, k, feature) = (landmark_id(d)?, key_frame_id(d)?, d.u32()?);
            let feature = u16::try_from(feature).map_err(|_| d.wrong(format!("feature {feature}")))?;
            Change::Observe(l, k, feature)
        }
        10 => Change::Forget(landmark_id(d)?, key_frame_id(d)?),
        11 => Change::Fuse(landmark_id(d)?, landmark_id(d)?),
        12 => Change::Calibrate(d.f64()?),
        13 => Change::RemoveLandmark(landmark_id(d)?),
        14 => Change::Link(key_frame_id(d)?, key_frame_id(d)?),
        15 => {
            let (map, to, to_from_root) = (MapId(key_frame_id(d)?), key_frame_id(d)?, read_pose(d)?);
            let [sigma, sigma_rad, sigma_log_scale] = d.f64s()?;
            Change::MapPrior(map, MapPrior { to, to_from_root, sigma, sigma_rad, sigma_log_scale })
        }
        16 => Change::Merge {
            from: MapId(key_frame_id(d)?),
            into: MapId(key_frame_id(d)?),
            into_from: read_similarity(d)?,
            parent: key_frame_id(d)?,
        },
        17 => Change::RemoveKeyFrame(key_frame_id(d)?),
        18 => Change::Readout(Readout { seconds: d.f64()?, sigma_s: d.f64()? }),
        19 => Change::ScaleSigma(MapId(key_frame_id(d)?), d.f64()?),
        20 => {
            let (id, n) = (key_frame_id(d)?, d.u32()?);
            let mut all = Vec::new();
            for _ in 0..n {
                let (from, from_from_here) = (key_frame_id(d)?, read_pose(d)?);
                all.push(RelativePose { from, from_from_here, information: symmetric(&d.f64s()?) });
            }
            Change::RelativePoses(id, all)
        }
        21 => Change::LeverArm(vector(d)?),
        other => return Err(d.wrong(format!("a change of kind {other} is unknown"))),
    })
}

fn encode_key_frame(e: &mut Encoder, k: &KeyFrame) {
    e.u32(k.id.raw());
    e.u32(k.parent.map_or(0, |p| p.raw()));
    e.f64s(&numbers(&k.world_from_camera));
    e.f64(k.unit);
    e.u8(u8::from(k.motion.is_some()));
    if let Some(m) = &k.motion {
        [m.velocity, m.bias.gyro, m.bias.accel].iter().for_each(|v| e.f64s(v.as_slice()));
    }
    e.u32(k.bag.words().len() as u32);
    for (word, weight) in k.bag.words() {
        e.u32(word.0);
        e.u32(weight.to_bits());
    }
    e.u32(k.bag.nodes().len() as u32);
    for (node, feature) in k.bag.nodes() {
        e.u32(*node);
        e.u32(u32::from(*feature));
    }
    let f = &k.frame;
    e.u64(f.stamp.0 as u64);
    e.u32(f.len() as u32);
    let floats = f.px.iter().chain(&f.raw).flatten().chain(&f.angle).chain(&f.right_x).chain(&f.depth);
    floats.for_each(|v| e.u32(v.to_bits()));
    e.0.extend(&f.octave);
    f.descriptors.iter().for_each(|d| e.0.extend(d));
}

fn decode_key_frame(
    d: &mut Decoder,
    camera: &RectifiedCamera,
    octaves: Octaves,
) -> Result<KeyFrame, StoreError> {
    let id = key_frame_id(d)?;
    let parent = KeyFrameId::from_raw(d.u32()?);
    let (world_from_camera, unit) = (read_pose(d)?, d.f64()?);
    let motion = match d.u8()? {
        0 => None,
        _ => {
            let (velocity, gyro, accel) = (vector(d)?, vector(d)?, vector(d)?);
            Some(InertialState { velocity, bias: Bias { gyro, accel }, still_sigma: None, imu_factor: None })
        }
    };
    let bag = decode_bag(d)?;
    let frame = decode_frame(d, camera, octaves)?;
    if bag.nodes().iter().any(|(_, feature)| usize::from(*feature) >= frame.len()) {
        return Err(d.wrong(format!("the words of {id:?} name a feature that it does not have")));
    }
    let k = KeyFrame::new(id, Arc::new(frame), world_from_camera, parent).with_bag(Arc::new(bag));
    Ok(KeyFrame { unit, motion, ..k })
}

fn decode_bag(d: &mut Decoder) -> Result<BagOfWords, StoreError> {
    let known = Vocabulary::current().facts().nodes;
    let (mut words, mut nodes) = (Vec::new(), Vec::new());
    for _ in 0..d.u32()? {
        words.push((WordId(d.u32()?), f32::from_bits(d.u32()?)));
    }
    for _ in 0..d.u32()? {
        let (node, feature) = (d.u32()?, d.u32()?);
        nodes.push((node, u16::try_from(feature).map_err(|_| d.wrong(format!("feature {feature}")))?));
    }
    if words.iter().map(|(word, _)| word.0).chain(nodes.iter().map(|(node, _)| *node)).any(|n| n >= known) {
        return Err(d.wrong("a word is not in the vocabulary"));
    }
    BagOfWords::from_parts(words, nodes).map_err(|why| d.wrong(why.to_string()))
}

fn decode_frame(d: &mut Decoder, camera: &RectifiedCamera, octaves: Octaves) -> Result<Frame, StoreError> {
    let stamp = Stamp(d.u64()? as i64);
    let n = usize::from(u16::try_from(d.u32()?).map_err(|_| d.wrong("more than 65,535 features"))?);
    let mut floats = |n: usize| -> Result<Vec<f32>, StoreError> {
        let (words, _) = d.bytes(4 * n)?.as_chunks::<4>();
        Ok(words.iter().map(|w| f32::from_le_bytes(*w)).collect())
    };
    let pairs = |v: Vec<f32>| v.as_chunks::<2>().0.to_vec();
    let mut frame = Frame::default();
    frame.stamp = stamp;
    (frame.px, frame.raw) = (pairs(floats(2 * n)?), pairs(floats(2 * n)?));
    (frame.angle, frame.right_x, frame.depth) = (floats(n)?, floats(n)?, floats(n)?);
    frame.octave = d.bytes(n)?.to_vec();
    frame.descriptors = d.bytes(32 * n)?.as_chunks::<32>().0.to_vec();
    let finite = frame.px.iter().chain(&frame.raw).flatten().chain(&frame.angle).all(|v| v.is_finite());
    if !finite || frame.octave.iter().any(|o| usize::from(*o) >= octaves.levels) {
        return Err(d.wrong("a feature is invalid"));
    }
    frame.index(camera);
    Ok(frame)
}

fn pair(e: &mut Encoder, kind: u8, a: u32, b: u32) {
    e.u8(kind);
    e.u32(a);
    e.u32(b);
}

fn position(e: &mut Encoder, kind: u8, id: u32, at: &Vec3) {
    e.u8(kind);
    e.u32(id);
    e.f64s(at.as_slice());
}

fn similarity(e: &mut Encoder, s: &Sim3) {
    e.f64s(&numbers(&Se3::new(s.rotation, s.translation)));
    e.f64(s.scale);
}

fn read_similarity(d: &mut Decoder) -> Result<Sim3, StoreError> {
    let (rigid, scale) = (read_pose(d)?, d.f64()?);
    Ok(Sim3::new(rigid.rotation, rigid.translation, scale))
}

fn read_pose(d: &mut Decoder) -> Result<Se3, StoreError> {
    pose(d.f64s()?).ok_or_else(|| d.wrong("a pose is invalid"))
}

fn vector(d: &mut Decoder) -> Result<Vec3, StoreError> {
    let [x, y, z] = d.f64s()?;
    Ok(Vec3::new(x, y, z))
}

fn key_frame_id(d: &mut Decoder) -> Result<KeyFrameId, StoreError> {
    KeyFrameId::from_raw(d.u32()?).ok_or_else(|| d.wrong("a key frame has no id"))
}

fn landmark_id(d: &mut Decoder) -> Result<LandmarkId, StoreError> {
    LandmarkId::from_raw(d.u32()?).ok_or_else(|| d.wrong("a landmark has no id"))
}
