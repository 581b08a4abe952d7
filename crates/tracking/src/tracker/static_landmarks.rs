//! Static-landmark gating: landmarks that have kept their position for a while (confirmed) decide the pose
//! where newer (tentative) points disagree with them.
//!
//! Points that a key frame adds from its own depth have been seen once, and may lie on a person walking ahead. All
//! points on that person agree with each other. Where the person is near and the walls are far or have little
//! texture, they outweigh the walls and drag the pose along. A landmark that key frames observed at one position over
//! some time is known to be static: the confirmed landmarks determine the pose, and points on moving objects do not
//! fit it for that long.
use crate::match_last::Matches;
use crate::setup::Setup;
use cairn_adjust::{Located, locate, pinhole, pixel, weight};
use cairn_atlas::{Landmark, Observation, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_solve::{PointMatch, PoseOnly, PosePrior, chow_test};
use cairn_vision::Frame;

/// Seconds between the first and the last key frame observation of a confirmed static landmark: a third of a
/// metre for someone who strolls.
const CONFIRMED_S: f64 = 0.5;
/// Threshold of the Chow test: the 99.9 % quantile of chi-square with six degrees of freedom, for errors of
/// twice the pixel noise, since landmarks are not exact either.
const CHOW_THRESHOLD: f64 = 4.0 * 22.46;

/// The pose from the confirmed landmarks alone, where the tentative ones disagree with them and the
/// confirmed ones agree among themselves; else the pose `located` from all. Tentative matches then count
/// as inliers where they fit the gated pose.
pub(super) fn gated(
    setup: &Setup,
    snapshot: &Snapshot,
    frame: &Frame,
    guess: &Se3,
    prior: Option<&PosePrior>,
    matches: &Matches,
    located: Located,
) -> Located {
    let mut out = vec![false; frame.len()];
    located.outliers.iter().for_each(|i| out[*i] = true);
    let (mut tentative, mut confirmed) =
        (Vec::with_capacity(located.inliers), Vec::with_capacity(located.inliers));
    for (i, id) in matches.landmarks.iter().enumerate().filter(|(i, _)| !out[*i]) {
        let Some(landmark) = id.and_then(|id| snapshot.landmark(id)) else { continue };
        let group = if is_confirmed(snapshot, landmark) { &mut confirmed } else { &mut tentative };
        group.push(point_match(snapshot, frame, i, landmark.position));
    }
    let extra = matches.extra.iter().filter(|(i, _)| !out[*i]);
    tentative.extend(extra.map(|(i, point)| point_match(snapshot, frame, *i, *point)));
    let least = setup.need(frame);
    if confirmed.len() < least || tentative.len() < least {
        return located;
    }
    let statistic = chow_test(&pinhole(&setup.camera), &located.world_from_camera, &confirmed, &tentative);
    if statistic.is_none_or(|statistic| statistic < CHOW_THRESHOLD) {
        return located;
    }
    locate_by_confirmed(setup, snapshot, frame, guess, prior, matches).unwrap_or(located)
}

/// The pose from the confirmed landmarks alone, with the other matches that fit it; `None` where most of
/// the confirmed landmarks do not agree with each other.
fn locate_by_confirmed(
    setup: &Setup,
    snapshot: &Snapshot,
    frame: &Frame,
    guess: &Se3,
    prior: Option<&PosePrior>,
    matches: &Matches,
) -> Option<Located> {
    let mut confirmed = vec![None; matches.landmarks.len()];
    let mut tentative = Vec::new();
    for (i, id) in matches.landmarks.iter().enumerate() {
        let Some(landmark) = id.and_then(|id| snapshot.landmark(id)) else { continue };
        if is_confirmed(snapshot, landmark) {
            confirmed[i] = Some(landmark.id);
        } else {
            tentative.push((i, landmark.position));
        }
    }
    tentative.extend(&matches.extra);
    let mut gated = locate(snapshot, &setup.camera, frame, guess, &confirmed, &[], prior);
    if gated.inliers < setup.need(frame) || 2 * gated.inliers < confirmed.iter().flatten().count() {
        return None;
    }
    let points: Vec<PointMatch> =
        tentative.iter().map(|(i, point)| point_match(snapshot, frame, *i, *point)).collect();
    let mut fits = vec![false; points.len()];
    gated.inliers += PoseOnly::judge(&pinhole(&setup.camera), &gated.world_from_camera, &points, &mut fits);
    gated.outliers.extend(tentative.iter().zip(&fits).filter(|(_, fits)| !**fits).map(|((i, _), _)| *i));
    Some(gated)
}

/// Whether key frames observed a landmark at one position for at least [`CONFIRMED_S`].
fn is_confirmed(snapshot: &Snapshot, landmark: &Landmark) -> bool {
    let Some([first, last]) = observed(snapshot, landmark) else { return false };
    last - first >= CONFIRMED_S
}

/// Whether it is, and was known at an instant already.
pub(super) fn is_confirmed_before(snapshot: &Snapshot, landmark: &Landmark, instant: Stamp) -> bool {
    observed(snapshot, landmark).is_some_and(|[first, _]| first <= instant)
        && is_confirmed(snapshot, landmark)
}

/// When key frames observed a landmark first and last.
fn observed(snapshot: &Snapshot, landmark: &Landmark) -> Option<[Stamp; 2]> {
    let when = |observation: &Observation| snapshot.key_frame(observation.key_frame).map(|k| k.stamp);
    let [first, .., last] = landmark.observations.as_slice() else { return None };
    Some([when(first)?, when(last)?])
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

    /// The first points are on walls far ahead, the others on a person nearby.
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

    /// A frame from the origin whose feature `i` shows point `i`, with errors of a third of a pixel in
    /// position and disparity.
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

    /// Key frames at these times see the walls, the last one also the person, who has then moved on by a
    /// step.
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
                let first_seen = if wall { 0 } else { times.len() - 1 };
                if k == first_seen {
                    changes.push(Change::AddLandmark(landmark, *point));
                }
                if k >= first_seen {
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
        let setup =
            Setup { camera: camera(), features: 1000, rate_hz: 15.0, config: TrackerConfig::default() };
        let gated = gated(&setup, snapshot, &now, &guess, None, &matches, all.clone());
        (all, gated)
    }

    fn off(located: &Located) -> f64 {
        Se3::identity().local(&located.world_from_camera).fixed_rows::<3>(0).norm()
    }

    #[test]
    fn confirmed_walls_outweigh_a_walking_person() {
        let (all, gated) = located(&[0.0, 0.4, 0.8]);
        assert!(off(&all) > 0.02, "without gating the person drags the pose along: {}", off(&all));
        assert!(off(&gated) < 0.01, "{}", off(&gated));
        assert!(gated.outliers.iter().filter(|i| **i >= WALLS).count() > (POINTS - WALLS) / 2);
        assert!(gated.outliers.iter().filter(|i| **i < WALLS).count() < WALLS / 10);
    }

    #[test]
    fn gating_needs_confirmed_landmarks() {
        let (all, gated) = located(&[0.0, 0.1, 0.2]);
        assert_eq!(all.world_from_camera, gated.world_from_camera);
        assert_eq!(all.outliers, gated.outliers);
    }
}
