//! The tracking stage on synthetic maps: one test for each of its steps.

use crate::decide::{Situation, wants_key_frame};
use crate::match_last::{Before, Matches, match_last};
use crate::synthetic::{FEATURES, RATE_HZ, View, World, mono, off, pose, sideways, stereo};
use crate::{KeyFrameRequest, State, Tracked, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, MapPrior, Snapshot};
use cairn_geometry::{Se3, Sim3};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
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

/// The next frame, while mapping is idle.
pub(crate) fn step(tracker: &mut Tracker, snapshot: &Snapshot, view: &View) -> Tracked {
    tracker.step(view.frame.clone(), &[], snapshot, true, true)
}

fn assert_pose(tracked: &Tracked, truth: &Se3, metres: f64) {
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
    assert!(tracker.by_motion(&view.frame, atlas.latest(), None).is_none());
    let (found, matches) = tracker.by_reference(&view.frame, atlas.latest()).expect("a pose");
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
    assert!(tracker.reaches(atlas.latest(), ids[0], &pose(2.0, 0.0, 0.0), soon));
    assert!(!tracker.reaches(atlas.latest(), ids[0], &pose(20.0, 0.0, 0.0), soon));
    let late = cairn_sensor::Stamp::from_seconds(from_s + 20.0);
    assert!(tracker.reaches(atlas.latest(), ids[0], &pose(20.0, 0.0, 0.0), late));
}

/// A situation in front of the last key frame of a map, in which no key frame is due.
fn with_situation(change: impl FnOnce(&mut Situation)) -> bool {
    with_situation_of(stereo(), change)
}

/// The same of a camera.
fn with_situation_of(camera: RectifiedCamera, change: impl FnOnce(&mut Situation)) -> bool {
    let world = World::around(camera, 27);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.1));
    let snapshot = atlas.latest();
    let view = world.see(&pose(0.3, 0.0, 0.0), 2.0);
    let matches = Matches { landmarks: world.matches(snapshot, &view), extra: Vec::new() };
    let inliers = matches.count();
    let mut situation = Situation {
        snapshot,
        camera: &world.camera,
        frame: &view.frame,
        matches: &matches,
        inliers,
        need: 25,
        reference: ids[3],
        rotated_rad: 0.0,
        since: 5,
        since_s: None,
        stationary: false,
        idle: true,
    };
    change(&mut situation);
    wants_key_frame(&situation, RATE_HZ, 1)
}

#[test]
fn wants_key_frame_when_the_view_has_changed_and_mapping_can_take_it() {
    assert!(!with_situation(|_| ()), "nothing has changed");
    assert!(with_situation(|s| s.inliers /= 2), "half of what the reference shows is gone");
    assert!(!with_situation(|s| (s.inliers, s.idle) = (s.inliers / 2, false)), "mapping is busy");
    assert!(with_situation(|s| (s.inliers, s.idle, s.since) = (s.inliers / 2, false, 20)), "overdue");
    assert!(with_situation(|s| (s.inliers, s.idle) = (s.inliers / 8, false)), "too weak to wait");
    assert!(!with_situation(|s| (s.inliers, s.since) = (s.inliers / 2, 0)), "the last one was just now");
    assert!(!with_situation(|s| s.inliers = 5), "too few to hold a key frame");
}

#[test]
fn wants_key_frame_of_one_camera_before_the_view_is_gone_though_mapping_is_busy() {
    let wants = |left: f64| {
        with_situation_of(mono(), |s| (s.inliers, s.idle) = ((left * s.inliers as f64) as usize, false))
    };
    assert!(!wants(0.8), "mapping is busy");
    assert!(wants(0.4), "too weak to wait");
}

#[test]
fn step_counts_frames_that_did_not_come() {
    let mut tracker = tracker(mono());
    let mut periods = |at: f64| tracker.periods_since_last(Stamp::from_seconds(10.0 + STEP_S * at));
    assert_eq!([0.0, 1.0, 2.1, 6.0, 6.1].map(&mut periods), [1, 1, 1, 4, 1]);
}

#[test]
fn wants_key_frame_after_a_rotation_and_without_a_reference() {
    assert!(with_situation(|s| s.rotated_rad = 0.4), "a fifth of the field of view");
    assert!(!with_situation(|s| s.rotated_rad = 0.1));
    assert!(with_situation(|s| s.reference = s.snapshot.next_key_frame_id()));
}

#[test]
fn wants_key_frame_to_keep_imu_factors_short() {
    assert!(with_situation(|s| s.since_s = Some(0.3)));
    assert!(!with_situation(|s| s.since_s = Some(0.2)));
    assert!(!with_situation(|s| (s.since_s, s.idle) = (Some(0.3), false)));
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
fn begin_map(atlas: &mut Atlas, world: &World, view: &View, at: &Se3, prior: MapPrior) -> KeyFrameId {
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
fn a_turn_without_matches_to_the_map_is_tracked_by_rotation_only() {
    let world = World::around(mono(), 35);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut states = Vec::new();
    // A turn of 115 degrees on the spot: the map covers only the first half of it.
    for n in 1..=50 {
        let truth = pose(0.6, 0.0, 0.04 * f64::from(n));
        let view = world.see(&truth, from_s + STEP_S * f64::from(n));
        // Mapping takes no key frames: only tracking carries the orientation forward.
        let tracked = tracker.step(view.frame, &[], atlas.latest(), true, false);
        let found = tracked.pose.unwrap_or_else(|| panic!("frame {n}: {:?}", tracked.state));
        let (metres, radians) = off(&found.world_from_camera, &truth);
        assert!(metres < 0.02 && radians < 0.005, "frame {n}: {metres} m, {radians} rad");
        if let State::RotationOnly { since_s, sigma } = tracked.state {
            assert!(since_s > 0.0 && sigma > 0.0 && !tracked.scale_supported);
        }
        states.push(tracked.state);
    }
    assert_eq!(states[0], State::Tracking);
    assert!(matches!(states[49], State::RotationOnly { .. }), "{:?}", states[49]);
}

#[test]
fn rotation_only_is_not_for_a_camera_that_has_moved() {
    let (world, near) = (World::around(mono(), 36), World::around(mono(), 36));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let turned = near.see(&pose(0.6, 0.0, 0.04), from_s + STEP_S);
    assert!(tracker.track_rotation(&turned.frame, atlas.latest()).is_some());
    let (mut tracker, _) = tracker_at_end(&world, &atlas, &ids);
    let moved = near.see(&pose(0.6, 2.0, 0.0), from_s + STEP_S);
    assert!(tracker.track_rotation(&moved.frame, atlas.latest()).is_none());
}

#[test]
fn scale_without_parallax_is_reported_lost_and_a_new_map_is_requested_on_the_way_on() {
    let world = World::around(mono(), 37);
    // All key frames within 2 cm: no landmark has parallax.
    let (atlas, ids) = world.exact_map(&sideways(4, 0.005));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut lost_at = None;
    let mut requested = None;
    for n in 1..40 {
        let k = f64::from(n);
        let truth = pose(0.015 + 0.03 * k, 0.0, 0.0);
        let view = world.see(&truth, from_s + STEP_S * k);
        let tracked = step(&mut tracker, atlas.latest(), &view);
        if !tracked.scale_supported {
            lost_at.get_or_insert(n);
        }
        if let Some(KeyFrameRequest::Pair { relocation_prior, first, .. }) = tracked.request {
            requested = Some((n, relocation_prior.expect("a prior in the earlier map"), first));
            break;
        }
    }
    assert_eq!(lost_at, Some(3), "three frames running");
    let (n, prior, first) = requested.expect("a map with a scale of its own");
    assert!(n > 3);
    assert!(ids.contains(&prior.anchored.reference));
    // The prior is where the first frame of the pair was tracked.
    let frames = (first.stamp - cairn_sensor::Stamp::from_seconds(from_s)) / STEP_S;
    let truth = pose(0.015 + 0.03 * frames.round(), 0.0, 0.0);
    assert!(off(&prior.anchored.world_from_camera, &truth).0 < 5e-3);
    assert!(prior.sigma > 0.0 && prior.sigma_log_scale > 0.0, "{prior:?}");
    // What comes after the four key frames rests on assumed depths.
    assert_eq!(prior.assumed_since, Some(atlas.latest().next_key_frame_id()));
}

#[test]
fn a_map_whose_unit_was_guessed_is_rescaled_by_the_pace() {
    let world = World::around(mono(), 38);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.1));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut at_s = from_s;
    // The walker moves at 0.6 units a second.
    for n in 1..=20 {
        at_s = from_s + STEP_S * f64::from(n);
        step(&mut tracker, atlas.latest(), &world.see(&pose(0.3 - 0.03 * f64::from(n), 0.0, 0.0), at_s));
    }
    // The next map has half the unit of length: the same walk is at 1.2 units a second.
    let path = sideways(6, 0.2);
    let views = world.walk(&path, at_s - 2.5 + STEP_S, 0.5);
    let double = |_| Sim3 { scale: 2.0, ..Sim3::identity() };
    let younger = world.map(&mut atlas, &views, &path, None, double);
    let prior = MapPrior {
        to: ids[3],
        to_from_root: Se3::identity(),
        sigma: 1.0,
        sigma_rad: 0.1,
        sigma_log_scale: 0.5,
    };
    atlas.commit(vec![Change::MapPrior(MapId(younger[0]), prior)]);
    tracker.map_created(atlas.latest(), *younger.last().unwrap());
    at_s += STEP_S;
    let mut due = Vec::new();
    for n in 1..=70 {
        // To and fro along the path, from its end on.
        let x = 0.5 * (f64::from(n % 33) / 16.5 - 1.0).abs();
        at_s += STEP_S;
        let tracked = step(&mut tracker, atlas.latest(), &world.see(&pose(2.0 * x, 0.0, 0.0), at_s));
        if let Some(KeyFrameRequest::Next { rescale, .. }) = tracked.request {
            due.extend(rescale);
        }
        due.extend(tracker.due_rescale(atlas.latest(), younger[5]));
    }
    // After 0.25, 0.5, 1 and 3 s of walking; the first correction is never applied here, so all give the same factor.
    assert_eq!(due.len(), 4, "{due:?}");
    let expected = 0.6 / (2.0 * 2.0 * 0.5 / 16.5 / STEP_S);
    assert!(due.iter().all(|d| (d.0 / expected - 1.0).abs() < 0.1), "{due:?}, expected {expected}");
    assert!(due.windows(2).all(|d| d[0].1 > d[1].1), "the later the surer: {due:?}");
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
    tracker.refresh_last(atlas.latest());
    let last = tracker.last.as_ref().expect("tracked").anchored.world_from_camera;
    assert!(off(&last, &(shift * pose(0.62, 0.0, 0.0))).0 < 1e-3, "{last:?}");
    let truth = pose(0.64, 0.0, 0.0);
    let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, from_s + 2.0 * STEP_S));
    assert_eq!(tracked.state, State::Tracking);
    assert_pose(&tracked, &(shift * truth), 1e-3);
}

#[test]
fn one_camera_that_turns_on_the_spot_triangulates_nothing_and_stays_where_it_is() {
    let world = World::around(mono(), 61);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut at_s = from_s;
    // Standing, then turning by 25 degrees in 0.9 s.
    for n in 1..=24 {
        at_s += STEP_S;
        let truth = pose(1.0, 0.0, 0.025 * f64::from((n - 6).max(0)));
        let tracked = step(&mut tracker, atlas.latest(), &world.see(&truth, at_s));
        assert_eq!(tracked.state, State::Tracking, "frame {n}");
        assert_pose(&tracked, &truth, 5e-3);
        // It has turned by 0.1 radians after four frames, and is tested each tenth of a second.
        if n <= 9 || n > 13 {
            assert_eq!(tracker.parallax.is_turning(), n > 13, "frame {n}");
        }
        if let Some(KeyFrameRequest::Next { orientation_only, .. }) = tracked.request {
            assert_eq!(orientation_only, tracker.parallax.is_turning(), "frame {n}");
        }
    }
    let turned_s = at_s;
    assert!(tracker.turned_until.is_some_and(|t| (t.seconds() - turned_s).abs() < 1e-6));
    // It walks on: parallax is seen, and of the time since the turn only that is walking.
    for n in 1..=12 {
        at_s += STEP_S;
        let truth = pose(1.0 - 0.05 * f64::from(n), 0.0, 0.45);
        step(&mut tracker, atlas.latest(), &world.see(&truth, at_s));
    }
    assert!(!tracker.parallax.is_turning());
    let at = cairn_sensor::Stamp::from_seconds;
    let turned = tracker.turned_until.expect("it turned").seconds();
    assert!(turned - turned_s < 0.2, "{turned} {turned_s}");
    (0..20).for_each(|_| tracker.pace.push(1.0));
    let pace = tracker.typical_speed().expect("it walked");
    let assumed = tracker.assumed_speed(at(turned - 1.0), at(turned + 1.0)).expect("a pace");
    assert!((assumed - 0.5 * pace).abs() < 1e-9, "{assumed} of {pace}");
}

#[test]
fn a_camera_with_depth_looks_for_no_parallax() {
    let world = World::around(stereo(), 62);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    for n in 1..=20 {
        let view = world.see(&pose(0.6, 0.0, 0.03 * f64::from(n)), from_s + STEP_S * f64::from(n));
        step(&mut tracker, atlas.latest(), &view);
        assert!(!tracker.parallax.is_turning());
    }
}
