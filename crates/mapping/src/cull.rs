//! What does not earn its place goes: young points that are not found again, key frames that add nothing.

use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;

/// Key frames of the last so many seconds hold the links between them short.
const LINKED_S: f64 = 20.0;
/// Seconds of a link at most, before gravity and scale are known, and after.
const LONGEST_LINK_UNLEVEL_S: f64 = 0.5;
const LONGEST_LINK_S: f64 = 1.0;

/// A young landmark on probation.
#[derive(Clone, Copy, Debug)]
struct RecentLandmark {
    born: KeyFrameId,
    expected: u32,
    found: u32,
}

/// Landmarks on probation: the first key frames after their birth decide.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecentLandmarks {
    young: BTreeMap<LandmarkId, RecentLandmark>,
}

impl RecentLandmarks {
    pub fn admit(&mut self, landmarks: &[LandmarkId], born: KeyFrameId) {
        for id in landmarks {
            self.young.insert(*id, RecentLandmark { born, expected: 1, found: 1 });
        }
    }

    /// What tracking expected in a frame, and whether it was found.
    pub fn note(&mut self, seen: &[(LandmarkId, bool)]) {
        for (id, found) in seen {
            if let Some(y) = self.young.get_mut(id) {
                y.expected += 1;
                y.found += *found as u32;
            }
        }
    }

    /// Judges all on probation at the arrival of key frame `now`; those that fail are to be removed
    /// (Mur-Artal et al. 2015, section VI-B: found in at least a quarter of the frames that should see it, and seen
    /// from enough key frames).
    pub fn judge(&mut self, snapshot: &Snapshot, now: KeyFrameId, depth: bool) -> Vec<Change> {
        let mut removed = Vec::new();
        self.young.retain(|id, y| {
            let Some(l) = snapshot.landmark(*id) else { return false };
            let age = now.index() - y.born.index().min(now.index());
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

/// Key frames around `centre` of whose landmarks at least `share` are seen by three others at the same or a finer
/// level. At most one a call, the most redundant, so that none hides behind another.
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
        .filter(|k| k.parent.is_some() && !links(snapshot, k, here))
        .map(|k| (redundancy(snapshot, camera, k), k.id))
        .filter(|(r, _)| *r > share)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, id)| Change::RemoveKeyFrame(id))
}

/// Whether a key frame of late is needed to feel from one to the next: without it the link over it were too long.
fn links(snapshot: &Snapshot, k: &KeyFrame, newest: &KeyFrame) -> bool {
    let imu = |k: &KeyFrame| k.motion.as_ref().and_then(|m| m.imu_factor.clone());
    if newest.frame.stamp - k.frame.stamp > LINKED_S {
        return false;
    }
    let Some(before) = imu(k) else { return false };
    let later = snapshot.key_frames().skip_while(|next| next.id <= k.id).filter_map(imu);
    let after = later.into_iter().find(|f| f.since == k.id);
    let longest = if snapshot.is_gravity_aligned(k.map) { LONGEST_LINK_S } else { LONGEST_LINK_UNLEVEL_S };
    after.is_some_and(|after| before.sum.seconds() + after.sum.seconds() > longest)
}

/// Share of a key frame's landmarks that three others see as well.
fn redundancy(snapshot: &Snapshot, camera: &RectifiedCamera, k: &KeyFrame) -> f64 {
    let (mut all, mut spare) = (0usize, 0usize);
    for (i, id) in k.landmarks.iter().enumerate() {
        let Some(l) = id.and_then(|id| snapshot.landmark(id)) else { continue };
        if camera.has_depth() && !(k.frame.has_depth(i) && (k.frame.depth[i] as f64) < camera.close_depth) {
            continue;
        }
        all += 1;
        let level = k.frame.octave[i];
        let others = l.observations.iter().filter(|o| {
            o.key_frame != k.id
                && snapshot
                    .key_frame(o.key_frame)
                    .is_some_and(|other| other.frame.octave[o.feature as usize] <= level + 1)
        });
        spare += (others.take(3).count() == 3) as usize;
    }
    if all == 0 { 0.0 } else { spare as f64 / all as f64 }
}
