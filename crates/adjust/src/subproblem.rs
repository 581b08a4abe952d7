//! A part of a map copied out for an adjustment: key frames that move, fixed key frames, and what they observe.

use crate::factor::Frames;
use crate::weight;
use cairn_atlas::{Change, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::Vec3;
use cairn_solve::Observation;
use std::collections::BTreeMap;

/// What is copied.
#[derive(Clone, Debug)]
pub(crate) struct Subproblem {
    /// The version it was copied from.
    pub base: u64,
    pub frames: Frames,
    /// Landmarks observed by those that move.
    pub landmarks: Vec<LandmarkId>,
    /// Their positions in the world, metres.
    pub points: Vec<Vec3>,
    /// Grouped by landmark; poses and points are indices into `key_frames` and `points`. Right x as measured.
    pub observations: Vec<Observation>,
    /// By how many pixels each moves for each second of readout; empty without a rolling shutter.
    pub slopes: Vec<[f32; 2]>,
}

impl Subproblem {
    /// The landmarks that `moving` observe, and of the other key frames the `anchors` that observe most of them.
    pub fn of(
        snapshot: &Snapshot,
        (map, centre): (MapId, Option<KeyFrameId>),
        moving: &[KeyFrameId],
        anchors: usize,
    ) -> Self {
        let shown = moving
            .iter()
            .filter_map(|id| snapshot.key_frame(*id))
            .flat_map(|k| k.landmarks.iter().flatten().copied());
        let mut seen: Vec<LandmarkId> = shown.collect();
        seen.sort_unstable();
        seen.dedup();
        let held = snapshot.votes(&seen).into_iter().filter(|(id, _)| !moving.contains(id)).take(anchors);
        let key_frames: Vec<KeyFrameId> = moving.iter().copied().chain(held.map(|(id, _)| id)).collect();
        let slots: BTreeMap<KeyFrameId, u32> =
            key_frames.iter().enumerate().map(|(slot, id)| (*id, slot as u32)).collect();
        let readout_s = snapshot.readout().seconds;
        let is_rolling = |id: &KeyFrameId| snapshot.key_frame(*id).is_some_and(|k| k.frame.rolling.is_some());
        let is_rolling = key_frames.iter().any(is_rolling);
        let mut points = Vec::with_capacity(seen.len());
        // At most; memory that is not used is not touched.
        let most = seen.iter().filter_map(|id| snapshot.landmark(*id)).map(|l| l.observations.len()).sum();
        let mut observations = Vec::with_capacity(most);
        let mut slopes = Vec::new();
        let mut landmarks = Vec::with_capacity(seen.len());
        for l in seen.iter().filter_map(|id| snapshot.landmark(*id)) {
            let first = observations.len();
            for o in &l.observations {
                let (Some(slot), Some(k)) = (slots.get(&o.key_frame), snapshot.key_frame(o.key_frame)) else {
                    continue;
                };
                // Features that could not be read back from the disk say nothing.
                if k.frame.px[o.feature as usize][0].is_nan() {
                    continue;
                }
                if is_rolling {
                    let rolling = k.frame.rolling.as_ref();
                    slopes.push(rolling.map_or([0.0; 2], |r| r.slopes[o.feature as usize]));
                }
                observations.push(Observation {
                    pose: *slot,
                    point: points.len() as u32,
                    pixel: k.frame.pixel_with(o.feature as usize, readout_s),
                    weight: weight(&k.frame, o.feature as usize, &snapshot.octaves()),
                });
            }
            // A single observation without depth does not determine a point.
            let views = &observations[first..];
            if views.len() < 2 && views.iter().all(|o| o.pixel[2].is_nan()) {
                observations.truncate(first);
                slopes.truncate(first);
                continue;
            }
            landmarks.push(l.id);
            points.push(l.position);
        }
        let frames = Frames::of(snapshot, map, centre, key_frames, moving.len());
        Self { base: snapshot.version(), frames, landmarks, points, observations, slopes }
    }

    /// Changes that remove the observations left out by a weight of zero.
    pub fn forgotten<'a>(&'a self, observations: &'a [Observation]) -> impl Iterator<Item = Change> + 'a {
        observations.iter().filter(|o| o.weight == 0.0).map(|o| {
            Change::Forget(self.landmarks[o.point as usize], self.frames.key_frames[o.pose as usize])
        })
    }
}
