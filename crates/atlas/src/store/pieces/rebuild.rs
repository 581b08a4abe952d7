//! From what a team knows of a map to a map that can be joined. Numbers come from a network: each is checked before it is used.

use super::super::about::{About, decode_camera, pose};
use super::super::decode::{Damage, check_priors, derive_all, observe};
use super::super::error::StoreError;
use super::super::layout::{MapFile, NO_PICK};
use super::super::wire::Decoder;
use super::state::{
    ANGLES, DISPARITY, Feature, KeyFrameState, LOG_DEPTH, LandmarkState, NO_DEPTH, PX, State, position,
    similarity,
};
use super::{measured, related};
use crate::made_by::MadeBy;
use crate::names::{Names, Stretch, Stretches};
use crate::scale::is_sound_sigma;
use crate::{KeyFrame, KeyFrameId, Landmark, LandmarkId, MapId, MapPrior, OtherCamera, PlaceIndex, Snapshot};
use cairn_geometry::Vec3;
use cairn_sensor::Stamp;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{DESCRIPTOR_ID, Descriptor, Frame, Octaves, RectifiedCamera};
use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Largest indices: some code iterates over all.
const MAX_IDS: [u32; 2] = [1 << 24, 1 << 31];

fn wrong(why: impl Into<String>) -> StoreError {
    StoreError::part("pieces", why)
}

/// The map.
pub(super) fn map_of(state: &State) -> Result<MapFile, StoreError> {
    let about = about(state)?;
    let mut snapshot = begun(state)?;
    let others = other_cameras(state, &about.camera)?;
    let rows: BTreeMap<u32, u32> = state.landmarks.keys().copied().zip(1..).collect();
    let (mut key_frames, mut shown) = (Vec::new(), Vec::new());
    for (id, k) in &state.key_frames {
        let id = KeyFrameId::from_raw(*id).filter(|id| id.index() < snapshot.next_key_frame);
        let id = id.ok_or_else(|| wrong("a key frame has a number that was not given"))?;
        key_frames.push(key_frame(id, k, state, &about.camera, &others, snapshot.octaves)?);
        let features = k.shown.iter().filter(|landmark| **landmark != 0);
        shown.extend(features.map(|landmark| rows.get(landmark).copied().unwrap_or(u32::MAX)));
    }
    measured::give(state, &mut key_frames)
        .map_err(|id| wrong(format!("what an IMU measured before {id:?} is invalid")))?;
    related::give(state, &mut key_frames)
        .map_err(|raw| wrong(format!("the pose of number {raw} relative to another key frame is invalid")))?;
    snapshot.other_cameras = Arc::new(others);
    maps(state, &mut snapshot, &key_frames)?;
    let mut landmarks = Vec::with_capacity(state.landmarks.len());
    for (raw, l) in &state.landmarks {
        let id = LandmarkId::from_raw(*raw).filter(|id| id.index() < snapshot.next_landmark);
        let at = place(*raw, l, state, &key_frames, &about.camera);
        let at = at.filter(|at| at.iter().all(|v| v.is_finite()));
        let (id, at) = id.zip(at).ok_or_else(|| wrong(format!("landmark {raw} has no position")))?;
        landmarks.push(Landmark::new(id, at));
    }
    observe(&shown, &mut key_frames, &mut landmarks)?;
    for k in &mut key_frames {
        if state.key_frames.get(&k.id.raw()).is_some_and(|of| of.row.findable) {
            k.bag = Arc::new(Vocabulary::current().bag(&k.frame.descriptors)).into();
        }
    }
    snapshot.places = PlaceIndex::of(key_frames.iter().map(|k| (k.id, k.bag.shared())));
    for k in key_frames {
        snapshot.key_frames.insert(k.id.index(), k);
    }
    snapshot.made_by = MadeBy::of(snapshot.key_frames.iter().map(|(_, k)| k));
    removed(state, &mut snapshot)?;
    derive_all(&snapshot, &mut landmarks, &vec![NO_PICK; state.landmarks.len()], None)?;
    for l in landmarks {
        snapshot.landmarks.insert(l.id.index(), l);
    }
    check_priors(&mut snapshot, &mut Damage::Refuse)?;
    snapshot.recount_covisible();
    snapshot.check().map_err(|breach| wrong(breach.to_string()))?;
    Ok(MapFile { snapshot, about, attached: state.attached.clone() })
}

fn about(state: &State) -> Result<About, StoreError> {
    let found = state.head.descriptors;
    if found != DESCRIPTOR_ID {
        return Err(StoreError::Descriptors { found, known: DESCRIPTOR_ID });
    }
    let mut d = Decoder::new("pieces", &state.head.about);
    let about = About::decode(&mut d)?;
    d.end()?;
    Ok(about)
}

/// A snapshot with what is not told for each key frame or landmark.
fn begun(state: &State) -> Result<Snapshot, StoreError> {
    let (levels, factor) = state.head.octaves;
    let octaves = Octaves { levels: levels as usize, factor };
    if !((1..=64).contains(&levels) && factor > 1.0 && factor <= 4.0) {
        return Err(wrong(format!("the pyramid is invalid: {octaves:?}")));
    }
    let within = state.next.iter().zip(MAX_IDS).all(|(next, most)| *next <= most);
    if !(within && state.head.right_offset.is_finite()) {
        return Err(wrong("there are too many ids, or the disparity offset is not finite"));
    }
    let mut snapshot = Snapshot::with_octaves(octaves);
    snapshot.right_offset = state.head.right_offset;
    snapshot.version = state.version;
    if let Some(imu) = &state.head.imu {
        let mount = pose(imu.imu_from_camera);
        snapshot.imu_from_camera =
            Some(mount.ok_or_else(|| wrong("the pose of the camera on the IMU is invalid"))?);
    }
    [snapshot.next_key_frame, snapshot.next_landmark] = state.next.map(|next| next as usize);
    let stretch =
        |(first, robot, seq): &(u32, u16, u32)| Stretch { first: *first as usize, robot: *robot, seq: *seq };
    let [key_frames, landmarks] =
        state.head.names.each_ref().map(|names| Stretches(names.iter().map(stretch).collect()));
    if !(key_frames.is_valid(snapshot.next_key_frame) && landmarks.is_valid(snapshot.next_landmark)) {
        return Err(wrong("two ids would have one name, or one has none"));
    }
    snapshot.names = Arc::new(Names { key_frames, landmarks });
    Ok(snapshot)
}

fn other_cameras(state: &State, camera: &RectifiedCamera) -> Result<Vec<Arc<OtherCamera>>, StoreError> {
    let read = |bytes: &Vec<u8>| {
        let mut d = Decoder::new("pieces", bytes);
        let (sensor, other) = decode_camera(&mut d)?;
        d.end()?;
        let focal_ratio = other.fx / camera.fx;
        let sound = focal_ratio.is_finite() && focal_ratio > 0.0;
        let of = OtherCamera { sensor, camera: other, focal_ratio, imu_from_camera: None };
        sound.then(|| Arc::new(of)).ok_or_else(|| wrong("a focal length is beyond all measure"))
    };
    state.head.other_cameras.iter().map(read).collect()
}

fn key_frame(
    id: KeyFrameId,
    of: &KeyFrameState,
    state: &State,
    camera: &RectifiedCamera,
    others: &[Arc<OtherCamera>],
    octaves: Octaves,
) -> Result<KeyFrame, StoreError> {
    let bad = |what: &str| wrong(format!("{id:?} {what}"));
    let other = match usize::from(of.row.camera).checked_sub(1) {
        Some(n) => Some(others.get(n).ok_or_else(|| bad("has an unknown camera"))?.clone()),
        None => None,
    };
    let camera = other.as_ref().map_or(camera, |other| &other.camera);
    let mut frame = Frame::default();
    frame.stamp = Stamp(of.row.stamp);
    for (f, landmark) in of.features.iter().zip(&of.shown).filter(|(_, landmark)| **landmark != 0) {
        let l = state.landmarks.get(landmark).ok_or_else(|| bad("shows a landmark that does not exist"))?;
        if usize::from(f.octave & !NO_DEPTH) >= octaves.levels {
            return Err(bad("has a feature outside the pyramid"));
        }
        feature(&mut frame, f, &l.descriptor, camera);
    }
    frame.index(camera);
    let at = of.pose.pose().ok_or_else(|| bad("has an invalid pose"))?;
    let mut k = KeyFrame::new(id, Arc::new(frame), at, KeyFrameId::from_raw(of.row.parent));
    k.map = MapId(KeyFrameId::from_raw(of.row.map).ok_or_else(|| bad("is in no map"))?);
    k.unit = of.row.unit;
    let links = of.row.links.iter().map(|raw| KeyFrameId::from_raw(*raw)).collect::<Option<Vec<_>>>();
    k.links = links.filter(|l| l.is_sorted_by(|a, b| a < b)).ok_or_else(|| bad("has invalid loops"))?;
    k.other_camera = other;
    Ok(k)
}

fn feature(frame: &mut Frame, f: &Feature, descriptor: &Descriptor, camera: &RectifiedCamera) {
    let px = [camera.cx + f64::from(f.at[0]) / PX, camera.cy + f64::from(f.at[1]) / PX].map(|v| v as f32);
    let disparity = match f.disparity {
        0 => f64::NAN,
        d => f64::from(d - i32::from(d > 0)) / DISPARITY,
    };
    let has_depth = disparity > 0.0 && f.octave & NO_DEPTH == 0;
    let angle = f32::from(f.angle) / ANGLES * TAU;
    frame.px.push(px);
    frame.raw.push(px);
    frame.octave.push(f.octave & !NO_DEPTH);
    frame.angle.push(if angle > PI { angle - TAU } else { angle });
    frame.descriptors.push(*descriptor);
    frame.right_x.push((f64::from(px[0]) - disparity) as f32);
    frame.depth.push(if has_depth { (camera.baseline_fx / disparity) as f32 } else { f32::NAN });
}

/// Where a landmark is.
fn place(
    raw: u32,
    l: &LandmarkState,
    state: &State,
    key_frames: &[KeyFrame],
    camera: &RectifiedCamera,
) -> Option<Vec3> {
    let Some(anchor) = KeyFrameId::from_raw(l.anchor) else { return Some(position(&l.at)) };
    let k = &key_frames[key_frames.binary_search_by_key(&anchor, |k| k.id).ok()?];
    let feature = state.key_frames.get(&l.anchor)?.feature_of(raw)?;
    let camera = k.camera(camera);
    let depth = (f64::from(l.at[2]) / LOG_DEPTH).exp();
    let [x, y]: [f64; 2] = std::array::from_fn(|i| (f64::from(feature.at[i]) + f64::from(l.at[i])) / PX);
    Some(k.world_from_camera * Vec3::new(x / camera.fx * depth, y / camera.fy * depth, depth))
}

fn maps(state: &State, snapshot: &mut Snapshot, key_frames: &[KeyFrame]) -> Result<(), StoreError> {
    let (mut maps, mut aligned, mut sigmas) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    for map in &state.head.maps {
        let root = KeyFrameId::from_raw(map.root).map(MapId).ok_or_else(|| wrong("a map has no root"))?;
        let prior = match &map.prior {
            None => None,
            Some(p) => {
                let [sigma, sigma_rad, sigma_log_scale] = p.sigmas;
                let to = KeyFrameId::from_raw(p.to).zip(pose(p.to_from_root));
                let to = to.filter(|_| p.sigmas.iter().all(|s| s.is_finite()));
                let (to, to_from_root) = to.ok_or_else(|| wrong("a prior is invalid"))?;
                Some(MapPrior { to, to_from_root, sigma, sigma_rad, sigma_log_scale })
            }
        };
        if maps.insert(root, prior).is_some() {
            return Err(wrong("a map is listed twice"));
        }
        if map.aligned > 0 {
            aligned.insert(root, map.aligned);
        }
        if let Some(sigma_log) = map.scale_sigma {
            let sound = is_sound_sigma(sigma_log).then_some(sigma_log);
            sigmas.insert(root, sound.ok_or_else(|| wrong("a scale has no standard deviation"))?);
        }
    }
    if let Some(k) = key_frames.iter().find(|k| !maps.contains_key(&k.map)) {
        return Err(wrong(format!("{:?} is in an unknown map", k.id)));
    }
    snapshot.maps = Arc::new(maps);
    snapshot.gravity_alignments = Arc::new(aligned);
    snapshot.scale_sigmas = Arc::new(sigmas);
    Ok(())
}

/// Parents of removed key frames: older ones, that are there or were removed as well.
fn removed(state: &State, snapshot: &mut Snapshot) -> Result<(), StoreError> {
    for (raw, (parent, it)) in &state.removed {
        let id = KeyFrameId::from_raw(*raw).filter(|id| id.index() < snapshot.next_key_frame);
        let parent = KeyFrameId::from_raw(*parent).filter(|parent| parent.raw() < *raw);
        let known =
            |p: &KeyFrameId| snapshot.key_frame(*p).is_some() || snapshot.removed.get(p.index()).is_some();
        match (id, parent.filter(known), similarity(it)) {
            (Some(id), Some(parent), Some(it)) if snapshot.key_frame(id).is_none() => {
                snapshot.removed.insert(id.index(), (parent, it));
            }
            _ => return Err(wrong(format!("number {raw} cannot be a removed key frame"))),
        }
    }
    Ok(())
}
