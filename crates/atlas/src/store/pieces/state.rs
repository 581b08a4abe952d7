//! What a team knows of a robot's map, in whole numbers: the same at the robot and at those that have all its pieces.
//!
//! In: a map and what was sent before. Out: what is to be known, which differs from before only where that matters: features
//! and descriptors that were sent stay, and so do poses and landmarks that moved by less than a threshold.

use super::super::about::{encode_camera, numbers, pose};
use super::super::error::StoreError;
use super::super::layout::MapFile;
use super::super::wire::Encoder;
use super::motion::{ImuHead, Motion, Readings};
use super::pose::Pose;
use super::relative::Relative;
use crate::apply::distance;
use crate::{KeyFrame, KeyFrameId, Landmark, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_vision::{DESCRIPTOR_ID, Descriptor, Frame, RectifiedCamera};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f32::consts::TAU;

/// Steps of a pixel, and of a pixel of disparity: rounding is off by 1/32 and 1/128 of a pixel at most, where a feature is found
/// to about one.
pub(super) const PX: f64 = 16.0;
pub(super) const DISPARITY: f64 = 64.0;
/// Steps of a turn.
pub(super) const ANGLES: f32 = 256.0;
/// Steps of the natural logarithm of a depth.
pub(super) const LOG_DEPTH: f64 = 2_048.0;
/// A pose that moved less than this, in units of length and radians, is not sent again.
const MOVED: [f64; 2] = [5e-4, 1e-4];
/// Nor is a landmark that moved less than this in its first key frame: 1/4 pixel across, 1/2 % along; without one, as a pose.
const SEEN_ASIDE: i32 = 4;
const SEEN_FURTHER: i32 = 10;
/// Nor is a descriptor that differs in at most so many of 256 bits: two of one landmark differ in about thirty.
const ALIKE_BITS: u32 = 48;
/// In the level of a feature: there is a disparity, but it tells no depth.
pub(super) const NO_DEPTH: u8 = 0x80;

/// How the map was made; what is not told for each key frame or landmark.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Head {
    pub about: Vec<u8>,
    pub descriptors: u32,
    pub octaves: (u32, f64),
    pub right_offset: f64,
    pub other_cameras: Vec<Vec<u8>>,
    /// First index, robot and number there.
    pub names: [Vec<(u32, u16, u32)>; 2],
    pub maps: Vec<MapHead>,
    pub imu: Option<ImuHead>,
}

/// A map by its root: its prior, how often it was aligned with gravity, and the standard deviation of the logarithm of its scale,
/// where it was stated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MapHead {
    pub root: u32,
    pub prior: Option<Prior>,
    pub aligned: u32,
    pub scale_sigma: Option<f64>,
}

/// A prior of a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Prior {
    pub to: u32,
    pub to_from_root: [f64; 7],
    pub sigmas: [f64; 3],
}

/// A key frame without its features; ids are numbers from 1, and 0 is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    pub stamp: i64,
    pub parent: u32,
    pub map: u32,
    pub unit: f64,
    /// Counted from 1; 0 is that of the atlas.
    pub camera: u8,
    /// Whether it has words.
    pub findable: bool,
    pub links: Vec<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Feature {
    /// Its index in the frame of the robot.
    pub index: u16,
    pub octave: u8,
    pub angle: u8,
    /// From the principal point.
    pub at: [i32; 2],
    /// One more than the disparity where that is not below zero; 0 without.
    pub disparity: i32,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeyFrameState {
    pub row: Row,
    pub pose: Pose,
    /// In the order in which they were sent.
    pub features: Vec<Feature>,
    /// The landmark that each shows.
    pub shown: Vec<u32>,
    pub motion: Option<Motion>,
    pub readings: Option<Readings>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LandmarkState {
    /// The key frame in which it is told where it is seen; 0 where three floats tell its position.
    pub anchor: u32,
    /// Steps from the pixel of the feature that shows it there, and the logarithm of its depth; or the bits of its position.
    pub at: [i32; 3],
    pub descriptor: Descriptor,
}

/// What a team knows of a robot's map.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct State {
    pub version: u64,
    /// How many ids were given to key frames and landmarks.
    pub next: [u32; 2],
    pub head: Head,
    pub key_frames: BTreeMap<u32, KeyFrameState>,
    /// Parents of removed key frames, and their poses there.
    pub removed: BTreeMap<u32, (u32, [f32; 8])>,
    pub landmarks: BTreeMap<u32, LandmarkState>,
    /// Poses of key frames relative to earlier ones, by both.
    pub relative: BTreeMap<[u32; 2], Relative>,
    pub attached: BTreeMap<String, Vec<u8>>,
}

impl State {
    /// What is to be known of a map, where this is known before.
    pub fn of(file: &MapFile, before: &Self) -> Result<Self, StoreError> {
        let (s, camera) = (&file.snapshot, &file.about.camera);
        let mut state = Self {
            version: s.version,
            next: [s.next_key_frame as u32, s.next_landmark as u32],
            head: head(file),
            attached: file.attached.clone(),
            ..Self::default()
        };
        for k in s.key_frames() {
            let known = before.key_frames.get(&k.id.raw());
            state.key_frames.insert(k.id.raw(), key_frame(s, k, camera, known)?);
        }
        state.measure(s, before);
        state.relate(s, before);
        for (index, (parent, it)) in s.removed.iter() {
            let rigid = numbers(&Se3::new(it.rotation, it.translation));
            let all: [f32; 8] = std::array::from_fn(|i| rigid.get(i).map_or(it.scale, |v| *v) as f32);
            state.removed.insert(index as u32 + 1, (parent.raw(), all));
        }
        for l in s.landmarks() {
            let known = before.landmarks.get(&l.id.raw());
            let now = state.landmark(s, l, camera, known);
            state.landmarks.insert(l.id.raw(), now);
        }
        Ok(state)
    }

    fn landmark(
        &self,
        s: &Snapshot,
        l: &Landmark,
        camera: &RectifiedCamera,
        known: Option<&LandmarkState>,
    ) -> LandmarkState {
        let seen = |id: KeyFrameId| Some((id, self.seen_from(s, l, id, camera)?));
        let anchor = known.and_then(|known| KeyFrameId::from_raw(known.anchor));
        let now = anchor
            .filter(|id| l.feature_in(*id).is_some())
            .and_then(seen)
            .or_else(|| l.observations.iter().find_map(|o| seen(o.key_frame)));
        let descriptor = known
            .map(|known| known.descriptor)
            .filter(|d| distance(d, &l.descriptor) <= ALIKE_BITS)
            .unwrap_or(l.descriptor);
        let (anchor, at) = match now {
            Some((id, at)) => (id.raw(), at),
            None => (0, std::array::from_fn(|i| (l.position[i] as f32).to_bits().cast_signed())),
        };
        let near = |before: &[i32; 3]| {
            if anchor == 0 {
                return (position(before) - l.position).norm() <= MOVED[0];
            }
            let off: [i32; 3] = std::array::from_fn(|i| (before[i].saturating_sub(at[i])).saturating_abs());
            off[0] <= SEEN_ASIDE && off[1] <= SEEN_ASIDE && off[2] <= SEEN_FURTHER
        };
        match known {
            Some(known) if known.anchor == anchor && near(&known.at) => {
                LandmarkState { descriptor, ..*known }
            }
            _ => LandmarkState { anchor, at, descriptor },
        }
    }

    /// Where a landmark is in a key frame that shows it; `None` where that tells no position.
    fn seen_from(
        &self,
        s: &Snapshot,
        l: &Landmark,
        id: KeyFrameId,
        camera: &RectifiedCamera,
    ) -> Option<[i32; 3]> {
        let feature = self.key_frames.get(&id.raw())?.feature_of(l.id.raw())?;
        let k = s.key_frame(id)?;
        let camera = k.camera(camera);
        let p = k.world_from_camera.inverse() * l.position;
        let [u, v, _] = camera.project(&p)?;
        let off = [u - camera.cx, v - camera.cy].map(|off| off * PX);
        // Far outside of the image a pixel is not what tells where it is.
        let aside: [f64; 2] = std::array::from_fn(|i| off[i] - f64::from(feature.at[i]));
        let sound = aside.iter().all(|a| a.abs() < 1e6);
        sound.then(|| {
            [aside[0].round() as i32, aside[1].round() as i32, (p.z.ln() * LOG_DEPTH).round() as i32]
        })
    }
}

impl KeyFrameState {
    /// Without features, and without anything of an IMU.
    pub fn new(row: Row, pose: Pose) -> Self {
        Self { row, pose, features: Vec::new(), shown: Vec::new(), motion: None, readings: None }
    }

    /// The feature that shows a landmark.
    pub fn feature_of(&self, landmark: u32) -> Option<&Feature> {
        self.features.get(self.shown.iter().position(|shown| *shown == landmark)?)
    }
}

impl Feature {
    fn of(frame: &Frame, i: usize, camera: &RectifiedCamera) -> Self {
        let [x, y] = frame.px[i].map(f64::from);
        let disparity = f64::from(frame.px[i][0]) - f64::from(frame.right_x[i]);
        let steps = (disparity * DISPARITY).round() as i32;
        let none = if disparity.is_finite() && !frame.has_depth(i) { NO_DEPTH } else { 0 };
        Self {
            index: i as u16,
            octave: frame.octave[i] | none,
            angle: (frame.angle[i].rem_euclid(TAU) / TAU * ANGLES).round() as u32 as u8,
            at: [((x - camera.cx) * PX).round() as i32, ((y - camera.cy) * PX).round() as i32],
            disparity: if disparity.is_finite() { steps.saturating_add(i32::from(steps >= 0)) } else { 0 },
        }
    }
}

fn key_frame(
    s: &Snapshot,
    k: &KeyFrame,
    camera: &RectifiedCamera,
    known: Option<&KeyFrameState>,
) -> Result<KeyFrameState, StoreError> {
    let unreadable = |fault| StoreError::CombineError(format!("{:?}: {fault}", k.id));
    let frame = k.frame.glance().map_err(unreadable)?;
    let bag = k.bag.glance().map_err(unreadable)?;
    let camera = k.camera(camera);
    let number = |camera| s.other_cameras().position(|c| c == camera).map_or(0, |n| n + 1);
    let row = Row {
        stamp: k.stamp.0,
        parent: k.parent.map_or(0, KeyFrameId::raw),
        map: k.map.root().raw(),
        unit: k.unit,
        camera: k.other_camera.as_deref().map_or(0, number) as u8,
        findable: !bag.is_empty(),
        links: k.links.iter().map(|id| id.raw()).collect(),
    };
    let same =
        |f: &Feature| usize::from(f.index) < frame.len() && Feature::of(&frame, f.index.into(), camera) == *f;
    let known = known.filter(|known| known.row.stamp == row.stamp && known.features.iter().all(same));
    let mut features = known.map_or_else(Vec::new, |known| known.features.clone());
    let mut sent = vec![false; frame.len()];
    features.iter().for_each(|f| sent[usize::from(f.index)] = true);
    let new = k.landmarks.iter().enumerate().filter(|(i, l)| l.is_some() && !sent[*i]);
    features.extend(new.map(|(i, _)| Feature::of(&frame, i, camera)));
    let shown = features.iter().map(|f| k.landmarks[usize::from(f.index)].map_or(0, |l| l.raw())).collect();
    let now = Pose::of(&k.world_from_camera);
    let near = |before: &Pose| {
        before.pose().is_some_and(|before| {
            let off = before.inverse() * k.world_from_camera;
            off.translation.norm() <= MOVED[0] && off.rotation.angle() <= MOVED[1]
        })
    };
    let pose = known.map(|known| known.pose).filter(near).unwrap_or(now);
    Ok(KeyFrameState { features, shown, ..KeyFrameState::new(row, pose) })
}

fn head(file: &MapFile) -> Head {
    let s = &file.snapshot;
    let mut about = Encoder::default();
    file.about.encode(&mut about);
    let other = |c: &crate::OtherCamera| {
        let mut e = Encoder::default();
        encode_camera(&mut e, c.sensor, &c.camera);
        e.0
    };
    let map = |(map, prior): (crate::MapId, Option<&crate::MapPrior>)| {
        let prior = prior.map(|prior| Prior {
            to: prior.to.raw(),
            to_from_root: numbers(&prior.to_from_root),
            sigmas: [prior.sigma, prior.sigma_rad, prior.sigma_log_scale],
        });
        let aligned = s.gravity_alignments.get(&map).copied().unwrap_or(0);
        MapHead { root: map.root().raw(), prior, aligned, scale_sigma: s.stated_scale_sigma(map) }
    };
    let names = [&s.names.key_frames, &s.names.landmarks];
    Head {
        about: about.0,
        descriptors: DESCRIPTOR_ID,
        octaves: (s.octaves.levels as u32, s.octaves.factor),
        right_offset: s.right_offset,
        other_cameras: s.other_cameras().map(other).collect(),
        names: names.map(|names| names.0.iter().map(|s| (s.first as u32, s.robot, s.seq)).collect()),
        maps: s.maps().map(map).collect(),
        imu: ImuHead::of(s),
    }
}

/// A pose with a scale, from its numbers.
pub(super) fn similarity(all: &[f32; 8]) -> Option<Sim3> {
    let v = all.map(f64::from);
    let norm = v[..4].iter().map(|v| v * v).sum::<f64>().sqrt();
    let rigid = pose([v[0] / norm, v[1] / norm, v[2] / norm, v[3] / norm, v[4], v[5], v[6]])?;
    let it = Sim3::new(rigid.rotation, rigid.translation, v[7]);
    (it.is_finite() && v[7] > 0.0).then_some(it)
}

/// The position of a landmark that tells it in floats.
pub(super) fn position(at: &[i32; 3]) -> Vec3 {
    Vec3::from(at.map(|bits| f64::from(f32::from_bits(bits.cast_unsigned()))))
}
