//! The tracking stage on synthetic maps: one test for each of its steps.

use crate::match_last::{Before, match_last};
use crate::synthetic::{FEATURES, RATE_HZ, View, World, mono, off, pose, sideways, stereo};
use crate::tracker::Now;
use crate::{KeyFrameRequest, State, Tracked, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, MapPrior, Snapshot};
use cairn_geometry::{Se3, Sim3};
use cairn_vision::{Frame, RectifiedCamera};
use std::sync::Arc;

pub(crate) const STEP_S: f64 = 1.0 / RATE_HZ;

pub(crate) fn tracker(camera: RectifiedCamera) -> Tracker {
    Tracker::new(camera, FEATURES, RATE_HZ, TrackerConfig::default())
}

/// A tracker that has just placed the last key frame of a map, half a second after the one before.
pub(crate) fn tracker_at_end(world: &World, atlas: &Atlas, ids: &[KeyFrameId]) -> (Tracker, f64) {
    let mut tracker = tracker(world.camera);
    let last = *ids.last().expect("a key frame");
    tracker.map_created(atlas.latest(), last);
    (tracker, 0.5 * (ids.len() - 1) as f64)
}

/// A frame as it is tracked, while mapping is idle.
pub(crate) fn now<'a>(frame: &'a Arc<Frame>, snapshot: &'a Snapshot) -> Now<'a> {
    Now { frame, snapshot, idle: true }
}

/// The next frame, while mapping is idle.
pub(crate) fn step(tracker: &mut Tracker, snapshot: &Snapshot, view: &View) -> Tracked {
    tracker.step(view.frame.clone(), &[], snapshot, true, true)
}

pub(crate) fn assert_pose(tracked: &Tracked, truth: &Se3, metres: f64) {
    let found = tracked.pose.unwrap_or_else(|| panic!("no pose: {:?}", tracked.state)).world_from_camera;
    let (m, rad) = off(&found, truth);
    assert!(m < metres && rad < metres, "{m} m, {rad} rad off: {:?}", tracked.evidence);
}

#[test]
fn step_tracks_along_an_exact_world_within_a_millimetre() {
    for camera in [stereo(), mono()] {
        let world = World::around(camera, 21);
        let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
        let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
        // Back along the path at 0.8 m/s, a little ahead of it, turning slowly.
        for n in 1..=25 {
            let k = f64::from(n);
            let truth = pose(1.0 - 0.04 * k, 0.005 * k, 0.008 * k);
            let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, from_s + STEP_S * k));
            assert_eq!(tracked.state, State::Tracking, "frame {n}");
            assert_pose(&tracked, &truth, 1e-3);
            assert!(tracked.evidence.inliers > 100 && tracked.scale_supported, "{:?}", tracked.evidence);
            assert!(tracked.evidence.inliers <= tracked.evidence.matched);
            let found = tracked.seen.iter().filter(|(_, found)| *found).count();
            assert_eq!(found, tracked.evidence.inliers, "what was seen is what agrees");
        }
    }
}

#[test]
fn match_last_finds_each_landmark_of_the_last_frame() {
    let world = World::around(stereo(), 22);
    let (atlas, ids) = world.exact_map(&sideways(3, 0.2));
    let k = atlas.latest().key_frame(ids[2]).unwrap();
    let truth = pose(0.43, 0.0, 0.01);
    let view = world.see(&truth, 2.0);
    let before = Before { frame: &k.frame, landmarks: &k.landmarks, world_from_camera: k.world_from_camera };
    let found = match_last(atlas.latest(), &world.camera, &before, &view.frame, &truth, 7.0);
    let truly = world.matches(atlas.latest(), &view);
    assert!(found.landmarks.iter().zip(&truly).all(|(found, truly)| found.is_none() || found == truly));
    let (have, of) = (found.landmarks.iter().flatten().count(), truly.iter().flatten().count());
    assert!(have * 10 > of * 9, "{have} of {of}");
    // With a guess that is far off, nothing is found where it is searched.
    let off = pose(0.43, 0.0, 0.3);
    assert!(match_last(atlas.latest(), &world.camera, &before, &view.frame, &off, 7.0).count() < 10);
}

#[test]
fn by_reference_finds_the_pose_after_a_jump_that_the_motion_model_misses() {
    let world = World::around(stereo(), 23);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let truth = pose(0.5, 0.1, 0.35);
    let view = world.see(&truth, from_s + STEP_S);
    assert!(tracker.by_motion(&now(&view.frame, atlas.latest())).is_none());
    let (found, matches) = tracker.by_reference(&now(&view.frame, atlas.latest())).expect("a pose");
    let (metres, radians) = off(&found, &truth);
    assert!(metres < 1e-3 && radians < 1e-3, "{metres} m, {radians} rad");
    assert!(matches.count() > 30, "{}", matches.count());
    let tracked = step(&mut tracker, atlas.latest(), &view);
    assert_eq!(tracked.state, State::Tracking);
    assert_pose(&tracked, &truth, 1e-3);
}

#[test]
fn relocalises_in_a_loaded_map_and_nowhere_else() {
    let (world, other) = (World::around(stereo(), 24), World::around(stereo(), 25));
    let (atlas, _) = world.exact_map(&sideways(6, 0.2));
    let mut tracker = tracker(world.camera);
    let nowhere = step(&mut tracker, atlas.latest(), &other.see(&pose(0.4, 0.0, 0.0), 100.0));
    assert!(matches!(nowhere.state, State::Lost { inliers: 0, need: 25 }), "{:?}", nowhere.state);
    assert!(nowhere.pose.is_none());
    for n in 0..5 {
        let truth = pose(0.5 + 0.02 * f64::from(n), 0.2, -0.15);
        let seconds = 100.0 + STEP_S * f64::from(n + 1);
        let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, seconds));
        assert_eq!(tracked.state, State::Tracking, "frame {n}");
        assert_pose(&tracked, &truth, 2e-3);
    }
}

#[test]
fn a_place_too_far_to_have_been_reached_is_not_relocalised() {
    let world = World::around(stereo(), 26);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let soon = cairn_sensor::Stamp::from_seconds(from_s + 0.5);
    let reaches = |x: f64, stamp| {
        let last = tracker.last.as_ref();
        tracker.unit.reaches(atlas.latest(), last, ids[0], &pose(x, 0.0, 0.0), stamp)
    };
    assert!(reaches(2.0, soon) && !reaches(20.0, soon));
    let late = cairn_sensor::Stamp::from_seconds(from_s + 20.0);
    assert!(reaches(20.0, late));
}

#[test]
fn step_requests_a_key_frame_with_right_matches_as_the_view_changes() {
    let world = World::around(stereo(), 28);
    let (atlas, ids) = world.exact_map(&sideways(3, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut requested = None;
    for n in 1..40 {
        let k = f64::from(n);
        let view = world.see(&pose(0.4, 0.0, 0.02 * k), from_s + STEP_S * k);
        if let Some(request) = step(&mut tracker, atlas.latest(), &view).request {
            requested = Some((n, view, request));
            break;
        }
    }
    let (n, view, request) = requested.expect("a request within 45 degrees");
    assert!(n > 3, "not at once");
    let KeyFrameRequest::Next { frame, landmarks, anchored, orientation_only, rescale, .. } = request else {
        panic!("the map goes on")
    };
    assert!(Arc::ptr_eq(&frame, &view.frame) && !orientation_only && rescale.is_none());
    let truly = world.matches(atlas.latest(), &view);
    assert!(landmarks.iter().zip(&truly).all(|(found, truly)| found.is_none() || found == truly));
    let resolved = atlas.latest().resolve(anchored.reference, &anchored.reference_from_camera).unwrap();
    assert!(off(&resolved, &pose(0.4, 0.0, 0.02 * f64::from(n))).0 < 1e-3);
}

#[test]
fn start_requests_a_first_key_frame_with_depth() {
    let world = World::around(stereo(), 29);
    let mut tracker = tracker(world.camera);
    let empty = Snapshot::new();
    let mut nothing = World::around(stereo(), 29);
    nothing.points.clear();
    let blank = step(&mut tracker, &empty, &nothing.see(&Se3::identity(), 0.0));
    assert!(matches!(blank.state, State::Starting { have: 0, need: 50 }), "{:?}", blank.state);
    assert!(blank.request.is_none());
    let view = world.see(&Se3::identity(), STEP_S);
    match step(&mut tracker, &empty, &view).request {
        Some(KeyFrameRequest::First { frame, relocation_prior: None, .. }) => {
            assert!(Arc::ptr_eq(&frame, &view.frame))
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn start_requests_a_pair_once_a_single_camera_has_moved() {
    let world = World::around(mono(), 30);
    let mut tracker = tracker(world.camera);
    let mut requested = None;
    for n in 0..20 {
        let truth = pose(0.05 * f64::from(n), 0.0, 0.0);
        let view = world.see(&truth, STEP_S * f64::from(n));
        if let Some(request) = step(&mut tracker, &Snapshot::new(), &view).request {
            requested = Some((truth, request));
            break;
        }
    }
    let (truth, request) = requested.expect("a pair within a metre");
    let KeyFrameRequest::Pair { first_from_second, points, .. } = request else { panic!("{request:?}") };
    let metres = truth.translation.norm();
    assert!(metres > 0.0 && points.len() >= 25);
    assert!((first_from_second.translation - truth.translation / metres).norm() < 1e-2);
    assert!(off(&first_from_second, &truth).1 < 1e-3);
}

/// Adds a root key frame with everything a view shows, in a frame of its own, as mapping does for an initial request.
pub(crate) fn begin_map(
    atlas: &mut Atlas,
    world: &World,
    view: &View,
    at: &Se3,
    prior: MapPrior,
) -> KeyFrameId {
    let exact = |_| Sim3::identity();
    let ids = world.map(atlas, std::slice::from_ref(view), std::slice::from_ref(at), None, exact);
    atlas.commit(vec![Change::MapPrior(MapId(ids[0]), prior)]);
    ids[0]
}

#[test]
fn a_new_map_begins_half_a_second_after_loss_and_the_earlier_one_is_kept() {
    let (world, other) = (World::around(stereo(), 31), World::around(stereo(), 32));
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let before = atlas.latest().clone();
    let mut begun = None;
    for n in 1..20 {
        let (truth, seconds) = (pose(0.02 * f64::from(n), 0.0, 0.0), from_s + STEP_S * f64::from(n));
        let view = other.see(&truth, seconds);
        let tracked = step(&mut tracker, &before, &view);
        assert!(matches!(tracked.state, State::Lost { .. }) && tracked.pose.is_none());
        if let Some(request) = tracked.request {
            begun = Some((seconds - from_s, truth, view, request));
            break;
        }
    }
    let (after_s, truth, view, request) = begun.expect("a new map");
    assert!((0.49..0.56).contains(&after_s), "{after_s}");
    let KeyFrameRequest::First { frame, relocation_prior: Some(prior), .. } = request else {
        panic!("{request:?}")
    };
    assert!(Arc::ptr_eq(&frame, &view.frame));
    // The new map begins at the last known pose, with the uncertainty of a walker's motion in that time.
    assert!(ids.contains(&prior.anchored.reference));
    assert!(off(&prior.anchored.world_from_camera, &pose(0.6, 0.0, 0.0)).0 < 1e-9);
    assert!((prior.sigma - 1.5 * after_s).abs() < 1e-6 && prior.sigma_log_scale == 0.0, "{prior:?}");
    let map_prior = MapPrior {
        to: prior.anchored.reference,
        to_from_root: prior.anchored.reference_from_camera,
        sigma: prior.sigma,
        sigma_rad: prior.sigma_rad,
        sigma_log_scale: prior.sigma_log_scale,
    };
    let root = begin_map(&mut atlas, &other, &view, &truth, map_prior);
    tracker.map_created(atlas.latest(), root);
    let seconds = from_s + after_s;
    let next = pose(truth.translation.x + 0.02, 0.0, 0.0);
    let tracked = step(&mut tracker, atlas.latest(), &other.see(&next, seconds + STEP_S));
    assert_eq!(tracked.state, State::Tracking);
    assert_pose(&tracked, &next, 1e-3);
    // Back in the earlier map, the place is recognised.
    for n in 0..3 {
        let back = pose(0.3, 0.1, 0.0);
        let tracked =
            step(&mut tracker, atlas.latest(), &world.see(&back, seconds + 1.0 + STEP_S * f64::from(n)));
        assert_eq!(tracked.state, State::Tracking, "frame {n}");
        assert!(ids.contains(&tracked.pose.unwrap().reference));
        assert_pose(&tracked, &back, 2e-3);
    }
}

#[test]
fn no_new_map_begins_where_mapping_takes_no_key_frames() {
    let (world, other) = (World::around(stereo(), 33), World::around(stereo(), 34));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    for n in 1..20 {
        let view = other.see(&pose(0.0, 0.0, 0.0), from_s + STEP_S * f64::from(n));
        let tracked = tracker.step(view.frame, &[], atlas.latest(), true, false);
        assert!(tracked.request.is_none() && tracked.pose.is_none(), "frame {n}");
    }
}

#[test]
fn the_last_pose_follows_a_correction_of_the_map() {
    let world = World::around(stereo(), 39);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    step(&mut tracker, atlas.latest(), &world.see(&pose(0.62, 0.0, 0.0), from_s + STEP_S));
    // The whole map moves by half a metre and a quarter turn, as after a merge.
    let shift = pose(0.5, 0.3, 1.5);
    let snapshot = atlas.latest().clone();
    let moved = |k: &KeyFrame| Change::MoveKeyFrame(k.id, shift * k.world_from_camera);
    let mut changes: Vec<Change> = snapshot.key_frames().map(moved).collect();
    changes.extend(snapshot.landmarks().map(|l| Change::MoveLandmark(l.id, shift * l.position)));
    atlas.commit(changes);
    tracker.refresh(atlas.latest());
    let last = tracker.last.as_ref().expect("tracked").anchored.world_from_camera;
    assert!(off(&last, &(shift * pose(0.62, 0.0, 0.0))).0 < 1e-3, "{last:?}");
    let truth = pose(0.64, 0.0, 0.0);
    let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, from_s + 2.0 * STEP_S));
    assert_eq!(tracked.state, State::Tracking);
    assert_pose(&tracked, &(shift * truth), 1e-3);
}
