//! Matching a frame with the previous one, around the position that the motion model predicts for each point.

use cairn_adjust::depth;
use cairn_atlas::{LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{Frame, RectifiedCamera, Target, consistent_rotation, search};

/// Largest Hamming distance in bits between two descriptors of one point.
pub(crate) const LOOSE: u32 = 100;
/// The same where the predicted position is less certain.
pub(crate) const TIGHT: u32 = 50;

/// The matches of a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Matches {
    /// The landmark that each feature shows.
    pub landmarks: Vec<Option<LandmarkId>>,
    /// Features that show a point of the last frame that is not (yet) a landmark, with its position in the
    /// world frame.
    pub extra: Vec<(usize, Vec3)>,
}

impl Matches {
    pub fn none(frame: &Frame) -> Self {
        Self { landmarks: vec![None; frame.len()], extra: Vec::new() }
    }

    pub fn count(&self) -> usize {
        self.landmarks.iter().flatten().count() + self.extra.len()
    }

    pub fn drop_outliers(&mut self, outliers: &[usize]) {
        for i in outliers {
            self.landmarks[*i] = None;
        }
        self.extra.retain(|(i, _)| !outliers.contains(i));
    }
}

/// The previous frame: its features, the landmarks they show, and its pose.
pub(crate) struct Before<'a> {
    pub frame: &'a Frame,
    pub landmarks: &'a [Option<LandmarkId>],
    pub world_from_camera: Se3,
}

/// Projects the points of the previous frame with `guess` and searches within `radius` pixels (times the scale of the
/// level). Its close features without a landmark are used as plain points.
pub(crate) fn match_last(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    before: &Before,
    frame: &Frame,
    guess: &Se3,
    radius: f64,
) -> Matches {
    let octaves = snapshot.octaves();
    let Before { frame: last, landmarks: last_landmarks, world_from_camera: world_from_last } = before;
    let camera_from_world = guess.inverse();
    let forward = (world_from_last.inverse() * guess.translation).z;
    let baseline = camera.baseline_fx / camera.fx;
    let top = (octaves.levels - 1) as u8;
    // Owner of each feature: item index and distance; the smaller distance wins.
    let mut owner: Vec<Option<(u32, u32)>> = vec![None; frame.len()];
    let mut candidates: Vec<(usize, Option<LandmarkId>, Vec3)> = Vec::new();
    // The landmarks lie scattered in memory: read together, the processor fetches several at a time.
    let known: Vec<Option<(LandmarkId, Vec3)>> = (last_landmarks.iter())
        .map(|id| id.and_then(|id| snapshot.landmark(id)).map(|l| (l.id, l.position)))
        .collect();
    for i in 0..last.len() {
        let close = || {
            (last.has_depth(i) && (last.depth[i] as f64) < camera.close_depth).then(|| {
                (None, *world_from_last * camera.unproject(last.px[i], depth(snapshot, camera, last, i)))
            })
        };
        let Some((id, point)) = known[i].map(|(id, point)| (Some(id), point)).or_else(close) else {
            continue;
        };
        let Some([u, v, right]) = camera.project(&(camera_from_world * point)) else { continue };
        if !camera.contains(u, v) {
            continue;
        }
        let level = last.octave[i];
        let range = if baseline > 0.0 && forward > baseline {
            [level, top]
        } else if baseline > 0.0 && -forward > baseline {
            [0, level]
        } else {
            [level.saturating_sub(1), (level + 1).min(top)]
        };
        let target = Target {
            pixel: [u as f32, v as f32],
            right_x: if baseline > 0.0 { right as f32 } else { f32::NAN },
            radius: (radius * octaves.scale(level)) as f32,
            octaves: range,
            descriptor: &last.descriptors[i],
        };
        let item = candidates.len() as u32;
        if let Some(found) = search(frame, &target, |_| true)
            && found.distance <= LOOSE
        {
            candidates.push((i, id, point));
            let slot = &mut owner[found.feature];
            // A landmark takes precedence over a plain point; else the smaller distance wins.
            let wins = slot.is_none_or(|(other, distance)| {
                let rank = |landmark: Option<LandmarkId>| landmark.is_none();
                (rank(id), found.distance) < (rank(candidates[other as usize].1), distance)
            });
            if wins {
                *slot = Some((item, found.distance));
            }
        }
    }
    let angle_changes = owner.iter().enumerate().filter_map(|(feature, slot)| {
        let (item, _) = (*slot)?;
        let i = candidates[item as usize].0;
        Some(((feature, item), last.angle[i] - frame.angle[feature]))
    });
    let mut matches = Matches::none(frame);
    for (feature, item) in consistent_rotation(angle_changes.collect()) {
        let (_, id, point) = candidates[item as usize];
        match id {
            Some(id) => matches.landmarks[feature] = Some(id),
            None => matches.extra.push((feature, point)),
        }
    }
    one_feature_each(&mut matches.landmarks);
    matches
}

/// A landmark matched by several features keeps only the first.
fn one_feature_each(landmarks: &mut [Option<LandmarkId>]) {
    let mut seen: Vec<LandmarkId> = landmarks.iter().flatten().copied().collect();
    seen.sort_unstable();
    if seen.windows(2).all(|w| w[0] != w[1]) {
        return;
    }
    let mut taken = std::collections::BTreeSet::new();
    for slot in landmarks.iter_mut() {
        if slot.is_some_and(|id| !taken.insert(id)) {
            *slot = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(n: usize) -> Option<LandmarkId> {
        LandmarkId::from_index(n)
    }

    #[test]
    fn drop_outliers_takes_landmarks_and_plain_points() {
        let extra = vec![(3, Vec3::x()), (4, Vec3::y())];
        let mut matches = Matches { landmarks: vec![id(7), id(8), None, None, None], extra };
        matches.drop_outliers(&[1, 3]);
        assert_eq!(matches.landmarks, [id(7), None, None, None, None]);
        assert_eq!(matches.extra, [(4, Vec3::y())]);
        assert_eq!(matches.count(), 2);
    }

    #[test]
    fn one_feature_each_leaves_the_first_of_a_landmark() {
        let mut landmarks = [id(3), None, id(5), id(3), id(5), id(4)];
        one_feature_each(&mut landmarks);
        assert_eq!(landmarks, [id(3), None, id(5), None, None, id(4)]);
    }
}
