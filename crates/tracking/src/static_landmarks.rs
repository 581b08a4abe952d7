//! What stands still leads: landmarks that have kept their place for a while decide the pose where newer points ask for
//! another one.
//!
//! Points that a key frame brings from its own depth have been seen once. Of what they are nothing is known yet: they may be
//! on someone who walks ahead. All points on him agree with each other, and where he is near and the walls are far or
//! plain, they weigh more than the walls, and the pose goes along with him. A landmark that key frames over a while saw
//! at one place has proven that it stands still: the proven hold the pose, and what moves does not fit it for so long.

use crate::match_last::Matches;
use crate::tracker::Tracker;
use cairn_adjust::{Located, locate, pinhole, pixel, weight};
use cairn_atlas::{Landmark, Observation, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_solve::{PointMatch, PoseOnly, PosePrior, chow_test};
use cairn_vision::Frame;

/// Seconds between the first and the last look of key frames at a landmark that has proven to stand still: a third of a
/// metre for someone who strolls.
const PROOF_S: f64 = 0.5;
/// The groups disagree: the 99.9 % quantile of chi-square with six degrees of freedom, for errors of twice the size that
/// pixels have, since landmarks are not exact either.
const DISAGREE: f64 = 4.0 * 22.46;

impl Tracker {
    /// The pose by the proven landmarks alone, where the others disagree with them and they agree among themselves; else
    /// as it was located with all. The others then count where they fit that pose.
    pub(crate) fn gated(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &Matches,
        located: Located,
    ) -> Located {
        let mut out = vec![false; frame.len()];
        located.outliers.iter().for_each(|i| out[*i] = true);
        let (mut young, mut confirmed) =
            (Vec::with_capacity(located.inliers), Vec::with_capacity(located.inliers));
        for (i, id) in matches.landmarks.iter().enumerate().filter(|(i, _)| !out[*i]) {
            let Some(landmark) = id.and_then(|id| snapshot.landmark(id)) else { continue };
            let group = if is_standing_still(snapshot, landmark) { &mut confirmed } else { &mut young };
            group.push(point_match(snapshot, frame, i, landmark.position));
        }
        let extra = matches.extra.iter().filter(|(i, _)| !out[*i]);
        young.extend(extra.map(|(i, point)| point_match(snapshot, frame, *i, *point)));
        let least = self.need(frame);
        if confirmed.len() < least || young.len() < least {
            return located;
        }
        let apart = chow_test(&pinhole(&self.camera), &located.world_from_camera, &confirmed, &young);
        if apart.is_none_or(|apart| apart < DISAGREE) {
            return located;
        }
        self.by_proven(snapshot, frame, guess, prior, matches).unwrap_or(located)
    }

    /// The pose by the proven landmarks alone, with the other matches that fit it; `None` where most of the proven do not
    /// agree with each other.
    fn by_proven(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &Matches,
    ) -> Option<Located> {
        let mut confirmed = vec![None; matches.landmarks.len()];
        let mut young = Vec::new();
        for (i, id) in matches.landmarks.iter().enumerate() {
            let Some(landmark) = id.and_then(|id| snapshot.landmark(id)) else { continue };
            if is_standing_still(snapshot, landmark) {
                confirmed[i] = Some(landmark.id);
            } else {
                young.push((i, landmark.position));
            }
        }
        young.extend(&matches.extra);
        let mut gated = locate(snapshot, &self.camera, frame, guess, &confirmed, &[], prior);
        if gated.inliers < self.need(frame) || 2 * gated.inliers < confirmed.iter().flatten().count() {
            return None;
        }
        let points: Vec<PointMatch> =
            young.iter().map(|(i, point)| point_match(snapshot, frame, *i, *point)).collect();
        let mut fits = vec![false; points.len()];
        gated.inliers +=
            PoseOnly::judge(&pinhole(&self.camera), &gated.world_from_camera, &points, &mut fits);
        gated.outliers.extend(young.iter().zip(&fits).filter(|(_, fits)| !**fits).map(|((i, _), _)| *i));
        Some(gated)
    }
}

/// Whether key frames over a while saw a landmark at one place.
fn is_standing_still(snapshot: &Snapshot, landmark: &Landmark) -> bool {
    let when = |look: &Observation| snapshot.key_frame(look.key_frame).map(|k| k.frame.stamp);
    let [first, .., last] = landmark.observations.as_slice() else { return false };
    when(last).zip(when(first)).is_some_and(|(last, first)| last - first >= PROOF_S)
}

fn point_match(snapshot: &Snapshot, frame: &Frame, feature: usize, point: Vec3) -> PointMatch {
    let weight = weight(frame, feature, &snapshot.octaves());
    PointMatch { point, pixel: pixel(snapshot, frame, feature), weight }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrackerConfig;
    use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, LandmarkId};
    use cairn_geometry::Manifold;
    use cairn_sensor::Stamp;
    use cairn_vision::{Octaves, RectifiedCamera};
    use std::sync::Arc;

    const WALLS: usize = 60;
    const POINTS: usize = 200;

    fn camera() -> RectifiedCamera {
        RectifiedCamera {
            fx: 420.0,
            fy: 420.0,
            cx: 320.0,
            cy: 240.0,
            baseline_fx: 50.0,
            bounds: [0.0, 0.0, 640.0, 480.0],
            close_depth: 5.0,
            body_from_camera: Se3::identity(),
        }
    }

    /// The first are walls far ahead, the others are on someone near.
    fn points() -> Vec<Vec3> {
        let point = |i: usize| {
            let (a, far) = (i as f64, i < WALLS);
            let (x, y) = ((a * 0.7).sin(), (a * 1.3).cos());
            if far {
                Vec3::new(x * 2.5, y * 1.5, 6.0 + 2.0 * (a * 0.37).sin())
            } else {
                Vec3::new(x * 0.5, y * 0.7, 2.0 + 0.1 * (a * 0.37).sin())
            }
        };
        (0..POINTS).map(point).collect()
    }

    /// A frame from the origin whose feature `i` shows point `i`, with errors of a third of a pixel in place and in disparity.
    fn frame(seconds: f64, points: &[Vec3]) -> Frame {
        let mut frame = Frame::default();
        frame.stamp = Stamp::from_seconds(seconds);
        for (i, p) in points.iter().enumerate() {
            let off = |k: f64| 0.33 * (i as f64 * k + seconds).sin();
            let [u, v, right] = camera().project(p).expect("a point ahead");
            let px = [(u + off(7.1)) as f32, (v + off(9.3)) as f32];
            frame.raw.push(px);
            frame.px.push(px);
            frame.octave.push(0);
            frame.angle.push(0.0);
            frame.descriptors.push([0; 32]);
            frame.right_x.push((right + off(7.1) + off(4.7)) as f32);
            frame.depth.push(p.z as f32);
        }
        frame.index(&camera());
        frame
    }

    /// Key frames at these times see the walls, the last also who is near; then he has gone on by a step.
    fn located(times: &[f64]) -> (Located, Located) {
        let mut points = points();
        let mut atlas = Atlas::new(Snapshot::with_octaves(Octaves { levels: 8, factor: 1.2 }));
        for (k, seconds) in times.iter().enumerate() {
            let id = KeyFrameId::from_index(k).expect("an id");
            let parent = k.checked_sub(1).and_then(KeyFrameId::from_index);
            let frame = Arc::new(frame(*seconds, &points));
            let mut changes =
                vec![Change::AddKeyFrame(Box::new(KeyFrame::new(id, frame, Se3::identity(), parent)))];
            for (i, point) in points.iter().enumerate() {
                let (landmark, wall) = (LandmarkId::from_index(i).expect("an id"), i < WALLS);
                let born = if wall { 0 } else { times.len() - 1 };
                if k == born {
                    changes.push(Change::AddLandmark(landmark, *point));
                }
                if k >= born {
                    changes.push(Change::Observe(landmark, id, i as u16));
                }
            }
            atlas.commit(changes);
        }
        let snapshot = atlas.latest();
        points[WALLS..].iter_mut().for_each(|p| *p += Vec3::new(0.01, 0.0, 0.05));
        let now = frame(times.last().copied().unwrap_or(0.0) + 0.07, &points);
        let matches =
            Matches { landmarks: (0..POINTS).map(LandmarkId::from_index).collect(), extra: Vec::new() };
        let guess = Se3::identity();
        let all = locate(snapshot, &camera(), &now, &guess, &matches.landmarks, &[], None);
        let tracker = Tracker::new(camera(), 1000, 15.0, TrackerConfig::default());
        let gated = tracker.gated(snapshot, &now, &guess, None, &matches, all.clone());
        (all, gated)
    }

    fn off(located: &Located) -> f64 {
        Se3::identity().local(&located.world_from_camera).fixed_rows::<3>(0).norm()
    }

    #[test]
    fn walls_that_are_known_lead_against_someone_who_walks() {
        let (all, gated) = located(&[0.0, 0.4, 0.8]);
        assert!(off(&all) > 0.02, "who walks takes the pose along: {}", off(&all));
        assert!(off(&gated) < 0.01, "{}", off(&gated));
        assert!(gated.outliers.iter().filter(|i| **i >= WALLS).count() > (POINTS - WALLS) / 2);
        assert!(gated.outliers.iter().filter(|i| **i < WALLS).count() < WALLS / 10);
    }

    #[test]
    fn nothing_leads_before_it_is_proven() {
        let (all, gated) = located(&[0.0, 0.1, 0.2]);
        assert_eq!(all.world_from_camera, gated.world_from_camera);
        assert_eq!(all.outliers, gated.outliers);
    }
}
