//! What single functions of a step decide, on synthetic maps; each test names its function.

use crate::match_last::Matches;
use crate::scale::PaceComparison;
use crate::synthetic::{FEATURES, RATE_HZ, View, World, mono, off, pose, sideways, stereo};
use crate::tests::{STEP_S, now, step, tracker, tracker_at_end};
use crate::{Tracker, TrackerConfig};
use cairn_atlas::{Change, LandmarkId, MapId};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::Stamp;
use std::sync::Arc;

/// As many landmarks as matches.
fn matches(count: usize) -> Matches {
    Matches { landmarks: (0..count).map(LandmarkId::from_index).collect(), extra: Vec::new() }
}

#[test]
fn refresh_takes_speeds_along_into_a_new_unit_of_length() {
    let world = World::around(mono(), 101);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    for n in 1..=14 {
        let k = f64::from(n);
        let view = world.see(&pose(0.6 - 0.03 * k, 0.0, 0.004 * k), from_s + STEP_S * k);
        step(&mut tracker, atlas.latest(), &view);
    }
    let (velocity, speed) = (
        *tracker.priors.velocity.known().expect("it moves"),
        tracker.unit.typical_speed().expect("it walks"),
    );
    assert!((speed - 0.6).abs() < 0.02, "{speed}");
    atlas.commit(vec![Change::Rescale(MapId(ids[0]), 2.5)]);
    for _ in 0..2 {
        // The second time nothing has changed.
        tracker.refresh(atlas.latest());
        let now = tracker.priors.velocity.known().expect("it moves");
        assert!((now.fixed_rows::<3>(0) - 2.5 * velocity.fixed_rows::<3>(0)).norm() < 1e-9, "{now}");
        assert_eq!(now.fixed_rows::<3>(3), velocity.fixed_rows::<3>(3));
        assert!((tracker.unit.typical_speed().expect("it walks") - 2.5 * speed).abs() < 1e-9);
    }
}

#[test]
fn typical_speed_is_that_of_the_map_before_while_it_is_early() {
    let mut tracker = tracker(mono());
    assert_eq!(tracker.unit.typical_speed(), None);
    (0..30).for_each(|_| tracker.unit.pace.push(0.5));
    assert_eq!(tracker.unit.typical_speed(), Some(0.5));
    for (done, expected) in [(0, 1.2), (2, 1.2), (3, 0.5)] {
        let map = MapId(cairn_atlas::KeyFrameId::FIRST);
        tracker.unit.comparison = Some(PaceComparison { map, pace: 1.2, done });
        assert_eq!(tracker.unit.typical_speed(), Some(expected), "after {done} comparisons");
    }
}

#[test]
fn position_prior_holds_a_camera_where_it_turns_on_the_spot_and_no_other() {
    let world = World::around(mono(), 102);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let guess = pose(1.3, 0.2, 0.6);
    for n in 1..=24 {
        let turn = 0.025 * f64::from((n - 6).max(0));
        let view = world.see(&pose(1.0, 0.0, turn), from_s + STEP_S * f64::from(n));
        step(&mut tracker, atlas.latest(), &view);
        if n == 6 {
            assert!(tracker.unit.parallax.position_prior(atlas.latest(), &guess).is_none(), "it stands");
        }
    }
    let prior = tracker.unit.parallax.position_prior(atlas.latest(), &guess).expect("it turns");
    let (held, rotation) = (prior.world_from_camera.translation, prior.world_from_camera.rotation);
    assert!((held - Vec3::x()).norm() < 5e-3, "{held:?}");
    assert_eq!(rotation, guess.rotation, "it says nothing of the orientation");
    // A hundredth of the depth of what is in view, 3 to 7 m.
    let sigma = prior.information[(0, 0)].sqrt().recip();
    assert!((0.03..0.07).contains(&sigma), "{sigma}");
    assert_eq!(prior.information[(1, 1)], prior.information[(0, 0)]);
    assert_eq!(prior.information.fixed_view::<3, 3>(3, 3).norm(), 0.0);
}

/// What a camera sees whose rows are exposed one after the other while it moves with a velocity and turns, in its own frame.
fn seen_by_rows(world: &World, middle: &Se3, moving: (Vec3, Vec3), readout_s: f64, seconds: f64) -> View {
    let mut view = world.see(middle, seconds);
    let camera = world.camera;
    let frame = Arc::make_mut(&mut view.frame);
    for (i, point) in view.points.iter().enumerate() {
        let mut at = frame.px[i].map(f64::from);
        for _ in 0..5 {
            let t = readout_s * ((at[1] + 0.5) / 480.0 - 0.5);
            let world_from_camera = *middle * Se3::new(So3::exp(&(t * moving.1)), t * moving.0);
            let [u, v, _] =
                camera.project(&(world_from_camera.inverse() * world.points[*point])).expect("in view");
            at = [u, v];
        }
        frame.px[i] = at.map(|a| a as f32);
        frame.raw[i] = frame.px[i];
    }
    frame.index(&camera);
    view
}

#[test]
fn at_middle_row_corrects_each_frame_by_the_motion_of_those_before() {
    let world = World::around(mono(), 103);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let mut errors = Vec::new();
    for readout_s in [0.02, 0.0] {
        let config = TrackerConfig { readout_s, ..TrackerConfig::default() };
        let mut tracker = Tracker::new(world.camera, FEATURES, RATE_HZ, config);
        tracker.map_created(atlas.latest(), ids[5]);
        let mut worst = 0.0f64;
        for n in 1..=30 {
            let k = f64::from(n);
            let moving = (Vec3::new(-0.6, 0.0, 0.0), Vec3::y() * 0.3);
            let heading = 0.3 * STEP_S * k;
            let at = pose(1.0 - 0.6 * STEP_S * k, 0.0, heading);
            let moving = (at.rotation.inverse() * moving.0, moving.1);
            let view = seen_by_rows(&world, &at, moving, 0.02, 2.5 + STEP_S * k);
            let tracked = step(&mut tracker, atlas.latest(), &view);
            let (m, rad) = off(&tracked.pose.expect("a pose").world_from_camera, &at);
            // Of the first frames the motion is not known yet.
            worst = worst.max(if n > 5 { m.max(rad) } else { 0.0 });
        }
        errors.push(worst);
    }
    assert!(errors[0] < 1e-3 && errors[1] > 2.0 * errors[0], "{errors:?}");
}

#[test]
fn need_asks_less_of_a_view_with_few_features_and_least_where_each_has_depth() {
    for (camera, few) in [(stereo(), 10), (mono(), 15)] {
        let world = World::around(camera, 104);
        let rich = world.see(&pose(0.0, 0.0, 0.0), 0.0);
        let mut bare = World::around(camera, 104);
        bare.keep(&rich.points[..24]);
        let tracker = tracker(camera);
        assert!(rich.points.len() > 100);
        assert_eq!(tracker.setup.need(&rich.frame), 25);
        assert_eq!(tracker.setup.need(&bare.see(&pose(0.0, 0.0, 0.0), 0.0).frame), few);
    }
}

#[test]
fn max_plausible_speed_and_drift_count_in_metres_also_where_the_unit_is_none() {
    // Twice 1.5 m/s in one second, and 2 m of drift; the walker of the single camera has gone 0.3 units a second, so 0.2 are a metre.
    for (camera, farthest, sigma_log_scale) in [(stereo(), 5.0, 0.0), (mono(), 1.0, 2.0)] {
        let world = World::around(camera, 105);
        let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
        let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
        (0..30).for_each(|_| tracker.unit.pace.push(0.3));
        let after = Stamp::from_seconds(from_s + 1.0);
        let reaches = |far: f64| {
            tracker.unit.reaches(
                atlas.latest(),
                tracker.last.as_ref(),
                ids[0],
                &pose(0.6 + far, 0.0, 0.0),
                after,
            )
        };
        assert!(reaches(0.95 * farthest) && !reaches(1.05 * farthest), "{farthest}");
        assert_eq!(tracker.unit.sigma_log_scale(), sigma_log_scale);
    }
}

#[test]
fn is_recent_is_a_frame_soon_after_the_last_pose() {
    let world = World::around(stereo(), 106);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    step(&mut tracker, atlas.latest(), &world.see(&pose(0.62, 0.0, 0.0), from_s + STEP_S));
    let after = |seconds: f64| Stamp::from_seconds(from_s + STEP_S + seconds);
    assert!(tracker.clock.is_recent(after(0.55), 0.6) && !tracker.clock.is_recent(after(0.65), 0.6));
    // A camera that reappears after a short gap where it was heading is tracked on; it was at 0.4 m/s.
    let tracked =
        step(&mut tracker, atlas.latest(), &world.see(&pose(0.82, 0.0, 0.0), from_s + STEP_S + 0.5));
    assert!(off(&tracked.pose.expect("a pose").world_from_camera, &pose(0.82, 0.0, 0.0)).0 < 1e-3);
}

#[test]
fn contradicts_depth_only_where_enough_features_lead_away_from_a_depth_that_helps() {
    for is_front_end in [false, true] {
        let (tracker, truth) = crate::dense_tests::tracker_carried_by_depth(is_front_end);
        let (here, elsewhere) = (truth, truth * pose(0.5, 0.0, 0.0));
        assert!(!tracker.contradicts_depth(&here, &matches(40)), "it agrees");
        assert_eq!(tracker.contradicts_depth(&elsewhere, &matches(40)), !is_front_end);
        assert!(!tracker.contradicts_depth(&elsewhere, &matches(24)), "too few features");
    }
    assert!(!tracker(stereo()).contradicts_depth(&Se3::identity(), &matches(40)), "no depth");
}

#[test]
fn by_motion_finds_the_pose_around_where_a_steady_motion_leads() {
    let world = World::around(stereo(), 107);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    for n in 1..=3 {
        let k = f64::from(n);
        step(&mut tracker, atlas.latest(), &world.see(&pose(0.6 - 0.05 * k, 0.0, 0.0), from_s + STEP_S * k));
    }
    // Four frames are missing; they would be searched in vain around the last pose.
    let truth = pose(0.2, 0.0, 0.0);
    let view = world.see(&truth, from_s + STEP_S * 8.0);
    let (found, matches) = tracker.by_motion(&now(&view.frame, atlas.latest())).expect("a pose");
    let (metres, radians) = off(&found, &truth);
    assert!(metres < 1e-3 && radians < 1e-3 && matches.count() > 100, "{metres} m, {}", matches.count());
}

#[test]
fn on_the_spot_sigma_grows_with_the_time_and_is_in_the_unit_of_the_map() {
    let (depth, mut single) = (tracker(stereo()), tracker(mono()));
    assert!((depth.unit.on_the_spot_sigma(0.0) - 0.3).abs() < 1e-12);
    assert!((depth.unit.on_the_spot_sigma(5.0) - 1.3).abs() < 1e-12);
    // At 0.3 units a second 0.2 are a metre.
    (0..30).for_each(|_| single.unit.pace.push(0.3));
    assert!((single.unit.on_the_spot_sigma(5.0) - 0.26).abs() < 1e-9);
}
