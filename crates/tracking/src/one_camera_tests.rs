//! One camera without depth: rotation, parallax, and the scale that is lost and guessed.

use crate::match_last::Matches;
use crate::rotation::{Between, Conclusion, rotation_between};
use crate::scale::ScaleSupport;
use crate::state::anchored_at;
use crate::synthetic::{World, mono, off, pose, sideways, stereo};
use crate::tests::{STEP_S, assert_pose, now, step, tracker_at_end};
use crate::{KeyFrameRequest, State, Tracker};
use cairn_atlas::{Change, MapId, MapPrior, Snapshot};
use cairn_geometry::{Se3, Sim3, So3};
use cairn_vision::Frame;

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
fn rotation_is_seen_past_a_nearly_blank_wall_by_the_few_features_that_it_has() {
    let few = |step: usize| {
        let mut world = World::around(mono(), 64);
        world.keep(&(0..world.points.len()).step_by(step).collect::<Vec<_>>());
        world
    };
    let between = |world: &World, second: Se3| {
        let (first, second) = (world.see(&pose(0.0, 0.0, 0.0), 0.0), world.see(&second, 0.05));
        let features = first.points.len().min(second.points.len());
        (
            features,
            rotation_between(
                &world.camera,
                &first.frame,
                &second.frame,
                &So3::identity(),
                Conclusion::Turned,
            ),
        )
    };
    let turned = pose(0.0, 0.0, 0.03);
    let (features, found) = between(&few(12), turned);
    let Between::Rotation { rotation, inliers, .. } = found else { panic!("{features} features") };
    assert!((rotation.inverse() * turned.rotation).angle() < 2e-3);
    assert!(inliers < 30 && features < 30, "{inliers} of {features}");
    assert!(matches!(between(&few(12), pose(0.6, 0.0, 0.03)).1, Between::Parallax), "it has moved");
    let (features, found) = between(&few(40), turned);
    assert!(matches!(found, Between::TooFew), "{features} features");
}

#[test]
fn rotation_only_is_not_for_a_camera_that_has_moved() {
    let (world, near) = (World::around(mono(), 36), World::around(mono(), 36));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let turned = near.see(&pose(0.6, 0.0, 0.04), from_s + STEP_S);
    assert!(tracker.track_rotation(&now(&turned.frame, atlas.latest())).is_some());
    let (mut tracker, _) = tracker_at_end(&world, &atlas, &ids);
    let moved = near.see(&pose(0.6, 2.0, 0.0), from_s + STEP_S);
    assert!(tracker.track_rotation(&now(&moved.frame, atlas.latest())).is_none());
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
        due.extend(tracker.unit.due_rescale(atlas.latest(), younger[5]));
    }
    // After 0.25, 0.5, 1 and 3 s of walking; the first correction is never applied here, so all give the same factor.
    assert_eq!(due.len(), 4, "{due:?}");
    let expected = 0.6 / (2.0 * 2.0 * 0.5 / 16.5 / STEP_S);
    assert!(due.iter().all(|d| (d.0 / expected - 1.0).abs() < 0.1), "{due:?}, expected {expected}");
    assert!(due.windows(2).all(|d| d[0].1 > d[1].1), "the later the surer: {due:?}");
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
            assert_eq!(tracker.unit.parallax.is_turning(), n > 13, "frame {n}");
        }
        if let Some(KeyFrameRequest::Next { orientation_only, .. }) = tracked.request {
            assert_eq!(orientation_only, tracker.unit.parallax.is_turning(), "frame {n}");
        }
    }
    let turned_s = at_s;
    assert!(tracker.unit.turned_until.is_some_and(|t| (t.seconds() - turned_s).abs() < 1e-6));
    // It walks on: parallax is seen, and of the time since the turn only that is walking.
    for n in 1..=12 {
        at_s += STEP_S;
        let truth = pose(1.0 - 0.05 * f64::from(n), 0.0, 0.45);
        step(&mut tracker, atlas.latest(), &world.see(&truth, at_s));
    }
    assert!(!tracker.unit.parallax.is_turning());
    let at = cairn_sensor::Stamp::from_seconds;
    let turned = tracker.unit.turned_until.expect("it turned").seconds();
    assert!(turned - turned_s < 0.2, "{turned} {turned_s}");
    (0..20).for_each(|_| tracker.unit.pace.push(1.0));
    let pace = tracker.unit.typical_speed().expect("it walked");
    let assumed = tracker.unit.assumed_speed(at(turned - 1.0), at(turned + 1.0)).expect("a pace");
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
        assert!(!tracker.unit.parallax.is_turning());
    }
}

/// What regains scale in a frame, as a step does it.
fn regain(tracker: &mut Tracker, frame: &Frame, snapshot: &Snapshot, guess: &Se3) -> Option<(Se3, Matches)> {
    tracker.unit.regain(frame, snapshot, tracker.last.as_ref(), guess)
}

/// The tracker of somebody who has turned on the spot since the last of six key frames, and sees their view again.
#[test]
fn scale_is_regained_where_the_view_from_before_the_turn_comes_back() {
    let world = World::around(mono(), 63);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let (snapshot, truth) = (atlas.latest(), pose(0.98, 0.01, 0.0));
    let lost = |since| {
        let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
        tracker.unit.support = ScaleSupport::lost_since(since);
        let at = cairn_sensor::Stamp::from_seconds(from_s);
        tracker.unit.keep_unsupported(at, anchored_at(snapshot, ids[5], truth).unwrap());
        (tracker, from_s)
    };
    let (mut tracker, from_s) = lost(snapshot.next_key_frame_id());
    let view = |n: u32| world.see(&truth, from_s + STEP_S * f64::from(n));
    // Carried through the turn by rotation alone: off by a degree and a half, and by some centimetres.
    let carried = pose(1.02, 0.0, 0.026);
    let (found, matches) = regain(&mut tracker, &view(1).frame, snapshot, &carried).expect("the view");
    let (metres, radians) = off(&found, &truth);
    assert!(metres < 2e-3 && radians < 1e-3, "{metres} m, {radians} rad");
    let truly = world.matches(snapshot, &view(1));
    let wrong =
        matches.landmarks.iter().zip(&truly).filter(|(found, truly)| found.is_some() && found != truly);
    assert_eq!(wrong.count(), 0);
    assert!(matches.count() * 10 > truly.iter().flatten().count() * 8, "{}", matches.count());
    assert!(regain(&mut tracker, &view(2).frame, snapshot, &carried).is_none(), "not with every frame");
    // With the frame's other stages, scale is supported from then on.
    let (mut tracker, _) = lost(snapshot.next_key_frame_id());
    let tracked = step(&mut tracker, snapshot, &view(1));
    assert_pose(&tracked, &truth, 5e-3);
    assert!(tracked.scale_supported);

    // What turned farther than can have gone unnoticed is another room, and what has come since has no scale to give.
    let (mut tracker, _) = lost(snapshot.next_key_frame_id());
    let turned = pose(0.98, 0.01, 0.4);
    assert!(regain(&mut tracker, &view(1).frame, snapshot, &turned).is_none());
    let far = pose(9.0, 0.01, 0.0);
    let (mut tracker, _) = lost(snapshot.next_key_frame_id());
    assert!(regain(&mut tracker, &view(1).frame, snapshot, &far).is_none());
    let (mut tracker, _) = lost(ids[0]);
    assert!(regain(&mut tracker, &view(1).frame, snapshot, &carried).is_none());
    let (mut supported, _) = tracker_at_end(&world, &atlas, &ids);
    assert!(regain(&mut supported, &view(1).frame, snapshot, &carried).is_none(), "nothing to regain");
}
