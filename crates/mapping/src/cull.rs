//! Culling: recent landmarks that are not found again, and redundant key frames.

use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;

/// Age in seconds up to which culling keeps the IMU factors between key frames short.
const SHORT_FACTORS_S: f64 = 20.0;
/// Key frames that share this many landmarks have one unit of length, whatever lies between them.
const LINK: u32 = 50;
/// Longest IMU factor in seconds, before gravity and scale are known, and after.
const MAX_FACTOR_UNALIGNED_S: f64 = 0.5;
const MAX_FACTOR_S: f64 = 1.0;

/// A tentative landmark: how often it was expected and found since it was created.
#[derive(Clone, Copy, Debug)]
struct RecentLandmark {
    created: KeyFrameId,
    expected: u32,
    found: u32,
}

/// The tentative landmarks: the first key frames after their creation decide whether they stay.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecentLandmarks {
    tentative: BTreeMap<LandmarkId, RecentLandmark>,
}

impl RecentLandmarks {
    pub fn admit(&mut self, landmarks: &[LandmarkId], created: KeyFrameId) {
        for id in landmarks {
            self.tentative.insert(*id, RecentLandmark { created, expected: 1, found: 1 });
        }
    }

    /// Takes the landmarks that tracking expected in a frame, and whether each was found.
    pub fn note(&mut self, seen: &[(LandmarkId, bool)]) {
        for (id, found) in seen {
            if let Some(y) = self.tentative.get_mut(id) {
                y.expected += 1;
                y.found += *found as u32;
            }
        }
    }

    /// Culls recent landmarks when key frame `now` arrives (Mur-Artal et al. 2015, section VI-B): one is
    /// removed unless it was found in at least a quarter of the frames that should see it and is observed by
    /// enough key frames.
    pub fn cull(&mut self, snapshot: &Snapshot, now: KeyFrameId, depth: bool) -> Vec<Change> {
        let mut removed = Vec::new();
        self.tentative.retain(|id, y| {
            let Some(l) = snapshot.landmark(*id) else { return false };
            let age = now.index() - y.created.index().min(now.index());
            let views = l.observations.len();
            let needed = if depth { 2 } else { 3 };
            if (y.found as f64) < 0.25 * y.expected as f64 || (age >= 2 && views < needed) {
                removed.push(Change::RemoveLandmark(*id));
                return false;
            }
            age < 3
        });
        removed
    }
}

/// The most redundant key frame around `centre`: at least `share` of its landmarks are observed by three others at
/// the same or a finer level. At most one per call, so that the redundancy of the others is then evaluated without
/// it.
pub(crate) fn redundant(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    centre: KeyFrameId,
    share: f64,
) -> Option<Change> {
    let here = snapshot.key_frame(centre)?;
    let candidates = here.covisible.iter().map(|(id, _)| *id).filter(|id| *id != centre);
    candidates
        .filter_map(|id| snapshot.key_frame(id))
        .filter(|k| k.parent.is_some() && !keeps_factors_short(snapshot, k, here))
        .filter(|k| !carries_scale(snapshot, camera, k))
        .map(|k| (redundancy(snapshot, camera, k), k.id))
        .filter(|(r, _)| *r > share)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, id)| Change::RemoveKeyFrame(id))
}

/// Whether a recent key frame is needed to keep IMU factors short: without it the factor across the gap would
/// be too long.
fn keeps_factors_short(snapshot: &Snapshot, k: &KeyFrame, newest: &KeyFrame) -> bool {
    let imu = |k: &KeyFrame| k.motion.as_ref().and_then(|m| m.imu_factor.clone());
    if newest.stamp - k.stamp > SHORT_FACTORS_S {
        return false;
    }
    let Some(before) = imu(k) else { return false };
    let later = snapshot.key_frames_from(k.id).filter_map(imu);
    let after = later.into_iter().find(|f| f.since == k.id);
    let longest = if snapshot.is_gravity_aligned(k.map) { MAX_FACTOR_S } else { MAX_FACTOR_UNALIGNED_S };
    after.is_some_and(|after| before.sum.seconds() + after.sum.seconds() > longest)
}

/// Whether the unit of length of a map that has no metres is handed on over a key frame: what comes after it shares few landmarks with what
/// came before it, and more with it. Three later key frames may see all of its landmarks, and it is redundant for them;
/// but without it, only directions are left of the parallax in which the near ones were seen on both sides, and what
/// comes after may grow or shrink freely.
fn carries_scale(snapshot: &Snapshot, camera: &RectifiedCamera, k: &KeyFrame) -> bool {
    if snapshot.is_metric_in(k.map, camera) {
        return false;
    }
    let Some(next) = snapshot.key_frames_from(k.id).find(|next| next.id != k.id && next.map == k.map) else {
        return false;
    };
    let shared = |with: &dyn Fn(KeyFrameId) -> bool| {
        next.covisible.iter().filter(|(id, _)| with(*id)).map(|(_, shared)| *shared).max().unwrap_or(0)
    };
    let without = shared(&|id| id < k.id);
    without < LINK && shared(&|id| id == k.id) > without
}

/// Share of a key frame's landmarks that three others observe as well.
fn redundancy(snapshot: &Snapshot, camera: &RectifiedCamera, k: &KeyFrame) -> f64 {
    let (mut all, mut redundant) = (0usize, 0usize);
    let (camera, octaves) = (k.camera(camera), snapshot.octaves());
    for (i, id) in k.landmarks.iter().enumerate() {
        let Some(l) = id.and_then(|id| snapshot.landmark(id)) else { continue };
        if camera.has_depth() && !(k.frame.has_depth(i) && (k.frame.depth[i] as f64) < camera.close_depth) {
            continue;
        }
        all += 1;
        let level = k.frame.octave[i];
        let as_fine = |other: &KeyFrame, feature: u16| {
            let theirs = other.frame.octave[usize::from(feature)];
            match other.other_camera == k.other_camera {
                true => theirs <= level + 1,
                // What a level resolves of a point goes with the focal length.
                false => {
                    octaves.scale(theirs) / other.focal_ratio() <= octaves.scale(level + 1) / k.focal_ratio()
                }
            }
        };
        let others = l.observations.iter().filter(|o| {
            o.key_frame != k.id
                && snapshot.key_frame(o.key_frame).is_some_and(|other| as_fine(other, o.feature))
        });
        redundant += (others.take(3).count() == 3) as usize;
    }
    if all == 0 { 0.0 } else { redundant as f64 / all as f64 }
}
