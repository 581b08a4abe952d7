//! Alignment of depth images, on images of a room that are drawn from its walls; and tracking that goes on where a search by
//! depth has found a lost camera.

use crate::dense::{DenseAligner, Placement, Prediction};
use crate::state::{AnchoredPose, KeyFrameRequest, State, anchored_at};
use crate::synthetic::{FEATURES, RATE_HZ, World, off, pose, sideways, stereo};
use crate::tests::{STEP_S, step, tracker_at_end};
use crate::{DepthPlaced, FoundByDepth, MotionSource, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, KeyFrameId};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor, GrayImage, Stamp};
use nalgebra::Matrix6;
use std::sync::Arc;

fn sensor() -> DepthSensor {
    let camera = Camera::pinhole(160, 120, 105.0, 105.0, 79.5, 59.5);
    DepthSensor { camera, body_from_depth: Se3::identity(), metres_per_unit: 0.001, registered: true }
}

/// The depth of a room without anything in it, whose far right corner is in view: walls at x = `right`, z = 3, floor at y = 1.2.
pub(crate) fn room(world_from_camera: &Se3, right: f64) -> Arc<DepthImage> {
    let camera = sensor().camera;
    let pixel = |n: usize| {
        let (u, v) = ((n % camera.width) as f64, (n / camera.width) as f64);
        let ray = Vec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let (from, way) = (world_from_camera.translation, world_from_camera.rotation * ray);
        let walls = [(0, right), (0, -2.5), (1, 1.2), (1, -1.6), (2, 3.0), (2, -3.0)];
        let hit = |(axis, at): (usize, f64)| (at - from[axis]) / way[axis];
        let z = walls.into_iter().map(hit).filter(|s| *s > 1e-6).fold(f64::INFINITY, f64::min);
        (z * 1000.0).round() as u16
    };
    let data = (0..camera.width * camera.height).map(pixel).collect();
    Arc::new(DepthImage::from_vec(camera.width, camera.height, data).expect("all pixels"))
}

pub(crate) const RIGHT: f64 = 1.5;

/// Covariance of a pose by features that are exact.
const SURE: Matrix6<f64> = Matrix6::from_array_storage(nalgebra::ArrayStorage([[0.0; 6]; 6]));

/// The camera looks into the corner and walks aside, turning.
pub(crate) fn at(n: usize) -> Se3 {
    let k = n as f64;
    pose(-0.3 + 0.02 * k, 0.01 * k, 0.25 + 0.005 * k)
}

pub(crate) fn stamp(n: usize) -> Stamp {
    Stamp::from_seconds(10.0 + STEP_S * n as f64)
}

/// A map, and an aligner that has been given two frames by few features.
pub(crate) fn begun(is_front_end: bool) -> (Atlas, KeyFrameId, DenseAligner) {
    let (atlas, ids) = World::around(stereo(), 81).exact_map(&sideways(2, 0.2));
    let mut aligner =
        DenseAligner::new(&sensor(), Se3::identity(), 0.5, is_front_end).expect("a depth camera");
    for n in 0..2 {
        aligner.next(Some(room(&at(n), RIGHT)), None);
        let anchored = anchored_at(atlas.latest(), ids[1], at(n)).expect("there");
        aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Weak);
    }
    (atlas, ids[1], aligner)
}

#[test]
fn align_finds_the_pose_of_each_depth_image_and_is_less_sure_the_longer_it_carries() {
    let (atlas, id, mut aligner) = begun(false);
    assert!(aligner.is_active() && !aligner.is_front_end());
    let mut sigmas = Vec::new();
    for n in 2..12 {
        aligner.next(Some(room(&at(n), RIGHT)), None);
        assert!(!aligner.was_tried() && aligner.aligned().is_none());
        let aligned = aligner.align(atlas.latest(), stamp(n), None, None).expect("aligned");
        let (reckoned, moved) = (aligned.reckoned, aligned.last_from_now);
        let (m, rad) = off(&reckoned.world_from_camera, &at(n));
        assert!(m < 0.01 && rad < 0.004, "frame {n}: {m} m, {rad} rad");
        let (m, rad) = off(&moved, &(at(n - 1).inverse() * at(n)));
        assert!(m < 0.01 && rad < 0.004, "motion to frame {n}: {m} m, {rad} rad");
        assert!(aligner.was_tried() && aligner.aligned().is_some());
        sigmas.push(reckoned.sigma()[0]);
        let anchored = anchored_at(atlas.latest(), id, reckoned.world_from_camera).expect("there");
        aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Carried);
    }
    assert!(sigmas[9] > sigmas[0], "{sigmas:.4?}");
    // Seconds later nothing predicts the pose; with a prediction it is found.
    aligner.next(Some(room(&at(12), RIGHT)), None);
    let late = stamp(12).plus_seconds(5.0);
    assert!(aligner.align(atlas.latest(), late, None, None).is_none());
    let near = Prediction {
        world_from_camera: at(12) * pose(0.05, 0.0, 0.01),
        covariance: Matrix6::identity() * 0.01,
    };
    let found = aligner.align(atlas.latest(), late, Some(near), None).expect("aligned");
    assert!(off(&found.reckoned.world_from_camera, &at(12)).0 < 0.02);
}

#[test]
fn align_says_nothing_of_an_image_taken_elsewhere_or_without_what_was_seen_before() {
    let (atlas, _, mut aligner) = begun(false);
    aligner.next(Some(room(&(at(2) * pose(0.8, 0.0, 0.6)), RIGHT)), None);
    assert!(aligner.align(atlas.latest(), stamp(2), None, None).is_none(), "elsewhere");
    aligner.next(None, None);
    assert!(aligner.align(atlas.latest(), stamp(2), None, None).is_none(), "no image");
    let (atlas, _, mut aligner) = begun(false);
    aligner.moved_elsewhere();
    assert!(!aligner.is_active());
    aligner.next(Some(room(&at(2), RIGHT)), None);
    assert!(aligner.align(atlas.latest(), stamp(2), None, None).is_none(), "in another map");
}

#[test]
fn refuse_forgets_the_surface_and_features_that_suffice_end_alignment() {
    let (atlas, id, mut aligner) = begun(false);
    aligner.next(Some(room(&at(2), RIGHT)), None);
    assert!(aligner.align(atlas.latest(), stamp(2), None, None).is_some());
    aligner.refuse();
    assert!(aligner.aligned().is_none() && !aligner.is_active());
    assert!(aligner.align(atlas.latest(), stamp(2), None, None).is_none(), "no surface");
    let (_, _, mut aligner) = begun(false);
    for n in 2..8 {
        aligner.next(Some(room(&at(n), RIGHT)), None);
        let anchored = anchored_at(atlas.latest(), id, at(n)).expect("there");
        aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Sure);
        assert_eq!(aligner.is_active(), n < 6, "frame {n}");
    }
    // What it remembered meanwhile is enough to begin again.
    aligner.next(Some(room(&at(8), RIGHT)), None);
    let found = aligner.align(atlas.latest(), stamp(8), None, None).expect("aligned");
    assert!(off(&found.reckoned.world_from_camera, &at(8)).0 < 0.01);
}

#[test]
fn chosen_is_the_pose_of_the_depth_where_that_is_the_front_end_and_of_the_features_elsewhere() {
    let wrong = at(2) * pose(0.03, 0.02, 0.02);
    for is_front_end in [false, true] {
        let (atlas, id, mut aligner) = begun(is_front_end);
        assert!(aligner.is_active() && aligner.is_front_end() == is_front_end);
        aligner.next(Some(room(&at(2), RIGHT)), None);
        aligner.align(atlas.latest(), stamp(2), None, None).expect("aligned");
        let chosen = off(&aligner.chosen(wrong, &SURE), &at(2)).0;
        assert_eq!(chosen < 0.012, is_front_end, "{chosen} m");
        for n in 2..9 {
            let anchored = anchored_at(atlas.latest(), id, at(n)).expect("there");
            aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Sure);
        }
        assert_eq!(aligner.is_active(), is_front_end);
    }
}

#[test]
fn chosen_takes_the_step_of_features_where_the_depth_runs_away() {
    for depth_off in [0.06, 0.0] {
        let (atlas, id, mut aligner) = begun(true);
        let mut step = |n: usize, seen: Se3, by_features: Se3| {
            aligner.next(Some(room(&seen, RIGHT)), None);
            assert!(aligner.align(atlas.latest(), stamp(n), None, None).is_some(), "frame {n}");
            let chosen = aligner.chosen(by_features, &SURE);
            let anchored = anchored_at(atlas.latest(), id, chosen).expect("there");
            aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Sure);
            (chosen, aligner.aligned().is_some())
        };
        // Features have the map elsewhere, by as much each time: their steps are right.
        let elsewhere = pose(0.05, 0.0, 0.0);
        let there = |n: usize| at([2, 3, 4, 5, 4, 3][n % 6]);
        for n in 2..120 {
            let (chosen, is_aligned) = step(n, there(n), elsewhere * there(n));
            assert!(is_aligned && off(&chosen, &there(n)).0 < 0.012, "frame {n}");
        }
        let (chosen, is_aligned) = step(120, there(120) * pose(depth_off, 0.0, 0.0), elsewhere * there(120));
        assert_eq!(is_aligned, depth_off == 0.0);
        assert!(off(&chosen, &there(120)).0 < 0.015, "{:?}", off(&chosen, &there(120)));
    }
}

/// The depth of an apartment slid by 2 to 13 cm a frame, which made such steps usual: the pose was 0.47 m off before it jumped back.
#[test]
fn chosen_is_not_led_away_by_depth_that_slides_a_little_more_in_each_frame() {
    let (atlas, id, mut aligner) = begun(true);
    let there = |n: usize| at([2, 3, 4, 5, 4, 3][n % 6]);
    let slid = |n: usize| [0.0, 0.02, 0.06, 0.11, 0.17, 0.25, 0.36, 0.49][n.saturating_sub(120).min(7)];
    for n in 2..128 {
        aligner.next(Some(room(&(there(n) * pose(slid(n), 0.0, 0.0)), RIGHT)), None);
        let aligned = aligner.align(atlas.latest(), stamp(n), None, None).is_some();
        assert!(aligned || n >= 120, "frame {n}");
        let chosen = aligner.chosen(there(n), &SURE);
        let (m, _) = off(&chosen, &there(n));
        assert!(m < if n < 120 { 0.012 } else { 0.045 }, "frame {n}: {m} m");
        let anchored = anchored_at(atlas.latest(), id, chosen).expect("there");
        aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Sure);
    }
}

#[test]
fn begin_at_goes_on_from_images_that_a_search_has_followed() {
    let (atlas, id, _) = begun(false);
    let mut aligner = DenseAligner::new(&sensor(), Se3::identity(), 0.5, false).expect("a depth camera");
    let followed: Vec<(Stamp, Arc<DepthImage>, AnchoredPose)> = (0..3)
        .map(|n| (stamp(n), room(&at(n), RIGHT), anchored_at(atlas.latest(), id, at(n)).expect("there")))
        .collect();
    aligner.begin_at(&followed, Matrix6::identity() * 1e-4);
    assert!(aligner.is_active());
    aligner.next(Some(room(&at(3), RIGHT)), None);
    let found = aligner.align(atlas.latest(), stamp(3), None, None).expect("aligned");
    assert!(off(&found.reckoned.world_from_camera, &at(3)).0 < 0.01);
}

/// The depth of a wall at z = 2 that fills the view, and the cloth on it: waves of a few shades.
fn cloth(world_from_camera: &Se3) -> (Arc<DepthImage>, Arc<GrayImage>) {
    let camera = sensor().camera;
    let (w, h) = (camera.width, camera.height);
    let (mut depth, mut gray) = (DepthImage::new(w, h), GrayImage::new(w, h));
    for y in 0..h {
        for x in 0..w {
            let ray = Vec3::new((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy, 1.0);
            let way = world_from_camera.rotation * ray;
            let z = (2.0 - world_from_camera.translation.z) / way.z;
            let p = world_from_camera.translation + way * z;
            let waves = [(9.0, 2.0), (-4.0, 14.0), (25.0, -20.0), (30.0, 35.0)];
            let shade: f64 = waves.iter().map(|(a, b)| (a * p.x + b * p.y + a).sin()).sum();
            depth.row_mut(y)[x] = (z * 1000.0).round() as u16;
            gray.row_mut(y)[x] = (70.0 + 5.0 * shade).round() as u8;
        }
    }
    (Arc::new(depth), Arc::new(gray))
}

/// Along one wall the shape says nothing; what is on it does. The walker starts and stops, which constant velocity does not foresee.
#[test]
fn align_finds_the_way_along_a_wall_by_its_texture() {
    let at = |n: usize| pose(0.25 * (0.35 * n as f64).sin(), 0.002 * n as f64, 0.02 * (0.5 * n as f64).sin());
    let mut worst = [0.0f64; 2];
    for (has_texture, worst) in [false, true].into_iter().zip(&mut worst) {
        let (atlas, ids) = World::around(stereo(), 81).exact_map(&sideways(2, 0.2));
        let mut aligner = DenseAligner::new(&sensor(), Se3::identity(), 2.0, false).expect("a depth camera");
        for n in 0..24 {
            let (depth, gray) = cloth(&at(n));
            aligner.next(Some(depth), Some(gray).filter(|_| has_texture));
            let found = aligner.align(atlas.latest(), stamp(n), None, None).map(|a| a.reckoned);
            assert_eq!(found.is_some(), n > 0, "frame {n}");
            let (pose, by) =
                found.map_or((at(n), Placement::Weak), |r| (r.world_from_camera, Placement::Carried));
            let (m, rad) = off(&pose, &at(n));
            *worst = worst.max(m).max(rad);
            if let Some(found) = found.filter(|_| has_texture) {
                assert!(m < 0.01 && rad < 0.005, "frame {n}: {m} m, {rad} rad");
                assert!(found.sigma()[0] < 0.1, "frame {n}: {:?}", found.sigma());
            }
            let anchored = anchored_at(atlas.latest(), ids[1], pose).expect("there");
            aligner.placed(atlas.latest(), stamp(n), anchored, by);
        }
    }
    assert!(worst[0] > 0.1, "without texture it drifts: {worst:?}");
}

/// A tracker with depth at the end of a map, which then lost its way: so many frames show nothing that it knows.
fn lost(seconds: f64, config: TrackerConfig) -> (World, Atlas, Vec<KeyFrameId>, Tracker, f64) {
    let world = World::around(stereo(), 82);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (_, from_s) = tracker_at_end(&world, &atlas, &ids);
    let mut tracker =
        Tracker::new(world.camera, FEATURES, RATE_HZ, config).with_depth(&sensor(), Se3::identity());
    tracker.map_created(atlas.latest(), ids[3]);
    let mut now = from_s;
    let mut other = World::around(stereo(), 83);
    other.keep(&(0..40).collect::<Vec<_>>());
    while now < from_s + seconds {
        now += STEP_S;
        tracker.depth_seen(None, None);
        step(&mut tracker, atlas.latest(), &other.see(&pose(0.0, 0.0, 3.0), now));
    }
    (world, atlas, ids, tracker, now)
}

/// What a search by depth says: the camera is where `at(0)` to `at(2)` are, and the last image is of `stamp_s`.
fn found(id: KeyFrameId, atlas: &Atlas, stamp_s: f64) -> FoundByDepth {
    let frames = (0..3).map(|n| DepthPlaced {
        stamp: Stamp::from_seconds(stamp_s - STEP_S * (2 - n) as f64),
        image: room(&at(n), RIGHT),
        key_frame_from_camera: atlas.latest().anchor(id, &at(n)).expect("there"),
    });
    FoundByDepth { key_frame: id, frames: frames.collect(), covariance: Matrix6::identity() * 1e-4 }
}

/// A tracker whose last pose its depth has carried, and where it is.
pub(crate) fn tracker_carried_by_depth(is_front_end: bool) -> (Tracker, Se3) {
    let (world, dark) = (World::around(stereo(), 85), World::empty(stereo()));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let config = TrackerConfig { dense: is_front_end, ..TrackerConfig::default() };
    let mut tracker =
        Tracker::new(world.camera, FEATURES, RATE_HZ, config).with_depth(&sensor(), Se3::identity());
    tracker.map_created(atlas.latest(), ids[3]);
    for n in 0..16 {
        let seen = if n < 10 { &world } else { &dark };
        tracker.depth_seen(Some(room(&at(n), RIGHT)), None);
        step(&mut tracker, atlas.latest(), &seen.see(&at(n), 1.5 + STEP_S * (n + 1) as f64));
    }
    (tracker, at(15))
}

#[test]
fn found_by_depth_goes_on_by_depth_where_a_lost_camera_is() {
    let (_, atlas, ids, mut tracker, now) = lost(1.0, TrackerConfig::default());
    let dark = World::empty(stereo());
    let view = dark.see(&at(3), now + STEP_S);
    assert!(tracker.may_believe_depth(&view.frame), "it was tracked just before");
    tracker.found_by_depth(found(ids[2], &atlas, now));
    tracker.depth_seen(Some(room(&at(3), RIGHT)), None);
    let tracked = step(&mut tracker, atlas.latest(), &view);
    assert!(matches!(tracked.state, State::Coasting { .. }), "{:?}", tracked.state);
    let anchored = tracked.pose.expect("a pose");
    let (m, rad) = off(&anchored.world_from_camera, &at(3));
    assert!(m < 0.02 && rad < 0.01, "{m} m, {rad} rad");
    // It looks most like the first key frame.
    assert_eq!(anchored.reference, ids[0]);
    // And on from there.
    tracker.depth_seen(Some(room(&at(4), RIGHT)), None);
    let tracked = step(&mut tracker, atlas.latest(), &dark.see(&at(4), now + 2.0 * STEP_S));
    assert!(off(&tracked.pose.expect("a pose").world_from_camera, &at(4)).0 < 0.02);
}

#[test]
fn found_by_depth_is_not_believed_too_late_or_of_a_place_that_shape_alone_speaks_for() {
    let dark = World::empty(stereo());
    let go_on = |seconds: f64, late_s: f64, config: TrackerConfig| {
        let (_, atlas, ids, mut tracker, now) = lost(seconds, config);
        let view = dark.see(&at(3), now + STEP_S + late_s);
        let believed = tracker.may_believe_depth(&view.frame);
        tracker.found_by_depth(found(ids[2], &atlas, now));
        tracker.depth_seen(Some(room(&at(3), RIGHT)), None);
        let tracked = step(&mut tracker, atlas.latest(), &view);
        (believed, tracked.pose.is_some())
    };
    let config = TrackerConfig { new_map_s: 60.0, ..TrackerConfig::default() };
    assert_eq!(go_on(1.0, 0.0, config), (true, true));
    assert!(!go_on(1.0, 1.0, config).1, "seconds after the last image");
    // After five seconds a walker may be in another room that looks the same.
    assert_eq!(go_on(5.0, 0.0, config), (false, false));
    let alone = TrackerConfig { find_by_shape_alone: true, ..config };
    assert_eq!(go_on(5.0, 0.0, alone), (true, true));
}

#[test]
fn a_bare_wall_is_crossed_by_depth_and_the_way_back_to_features_is_smooth() {
    let world = World::around(stereo(), 84);
    let dark = World::empty(stereo());
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let config = TrackerConfig::default();
    let mut tracker =
        Tracker::new(world.camera, FEATURES, RATE_HZ, config).with_depth(&sensor(), Se3::identity());
    tracker.map_created(atlas.latest(), ids[3]);
    for n in 0..40 {
        let seen = if (10..28).contains(&n) { &dark } else { &world };
        let seconds = 1.5 + STEP_S * (n + 1) as f64;
        tracker.depth_seen(Some(room(&at(n), RIGHT)), None);
        let tracked = step(&mut tracker, atlas.latest(), &seen.see(&at(n), seconds));
        let by_depth = matches!(tracked.state, State::Coasting { .. });
        assert_eq!(by_depth, (10..28).contains(&n), "frame {n}: {:?}", tracked.state);
        let (m, rad) = off(&tracked.pose.expect("a pose").world_from_camera, &at(n));
        assert!(m < 0.03 && rad < 0.015, "frame {n}: {m} m, {rad} rad");
        if by_depth {
            assert_eq!(tracker.odometry().expect("odometry").source, MotionSource::Measured, "frame {n}");
        }
    }
}

/// Features that the map does not know give key frames, whose poses depth carries.
#[test]
fn a_key_frame_carried_by_depth_knows_the_motion_since_the_one_before() {
    let (world, unknown) = (World::around(stereo(), 86), World::around(stereo(), 87));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let mut tracker = Tracker::new(world.camera, FEATURES, RATE_HZ, TrackerConfig::default())
        .with_depth(&sensor(), Se3::identity());
    tracker.map_created(atlas.latest(), ids[3]);
    let (mut before, mut related) = (None, 0);
    for n in 0..30 {
        let seen = if n < 10 { &world } else { &unknown };
        tracker.depth_seen(Some(room(&at(n), RIGHT)), None);
        let tracked = step(&mut tracker, atlas.latest(), &seen.see(&at(n), 1.5 + STEP_S * (n + 1) as f64));
        let Some(KeyFrameRequest::Next { motion, .. }) = tracked.request else { continue };
        let is_carried = matches!(tracked.state, State::Coasting { .. });
        match (motion, before.replace((n, tracked.stamp))) {
            (Some(motion), Some((m, stamp))) if is_carried => {
                assert_eq!(motion.stamp, stamp);
                let (metres, radians) = off(&motion.since_from_now, &(at(m).inverse() * at(n)));
                assert!(metres < 0.03 && radians < 0.015, "frame {n}: {metres} m, {radians} rad");
                assert!(motion.variance.iter().all(|v| *v > 0.0 && *v < 0.01), "{:?}", motion.variance);
                related += 1;
            }
            (motion, before) => assert!(motion.is_none() && !(is_carried && before.is_some()), "frame {n}"),
        }
    }
    assert!(related > 0, "no key frame was asked for while depth carried the pose");
}

/// The depth of an apartment slid by centimetres a frame, more each time, while features saw the room; then they stayed 1.2 m apart.
#[test]
fn chosen_is_the_pose_of_features_that_stay_elsewhere() {
    let (atlas, id, mut aligner) = begun(true);
    let mut step = |n: usize, by_features: Se3| {
        aligner.next(Some(room(&at(n), RIGHT)), None);
        assert!(aligner.align(atlas.latest(), stamp(n), None, None).is_some(), "frame {n}");
        let chosen = aligner.chosen(by_features, &SURE);
        let anchored = anchored_at(atlas.latest(), id, chosen).expect("there");
        aligner.placed(atlas.latest(), stamp(n), anchored, Placement::Sure);
        off(&chosen, &by_features).0
    };
    assert!(step(2, at(2)) < 0.012);
    let elsewhere = pose(0.3, 0.0, 0.0);
    let apart: Vec<f64> = [3, 4, 5].map(|n| step(n, elsewhere * at(n))).to_vec();
    assert!(apart[1] > 0.2 && apart[2] == 0.0, "the third is believed: {apart:?}");
}
