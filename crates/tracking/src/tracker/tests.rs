//! What stage functions that only other stages call decide, on synthetic maps; each test names its function.

use super::static_landmarks::is_confirmed_before;
use crate::match_last::Matches;
use crate::scale::PaceComparison;
use crate::state::{AnchoredPose, KeyFrameRequest, Last, anchored_at};
use crate::synthetic::{View, World, mono, off, pose, sideways, stereo};
use crate::tests::{STEP_S, step, tracker, tracker_at_end};
use cairn_atlas::{Change, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, ImuSensor, Stamp};
use cairn_solve::PosePrior;
use nalgebra::SMatrix;

/// The true matches of a view.
fn matched(world: &World, snapshot: &Snapshot, view: &View) -> Matches {
    Matches { landmarks: world.matches(snapshot, view), extra: Vec::new() }
}

#[test]
fn locate_drops_the_matches_that_disagree_and_heeds_a_prior() {
    let world = World::around(stereo(), 111);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let (snapshot, truth) = (atlas.latest(), pose(0.62, 0.0, 0.01));
    let view = world.see(&truth, from_s + STEP_S);
    let mut matches = matched(&world, snapshot, &view);
    // Every tenth match is that of another feature.
    let known: Vec<usize> = (0..view.points.len()).filter(|i| matches.landmarks[*i].is_some()).collect();
    let wrong: Vec<usize> = known.chunks_exact(10).map(|ten| ten[0]).collect();
    let far = |i: usize| known[(known.iter().position(|k| *k == i).unwrap() + known.len() / 2) % known.len()];
    let swapped: Vec<_> = wrong.iter().map(|i| matches.landmarks[far(*i)]).collect();
    wrong.iter().zip(swapped).for_each(|(i, landmark)| matches.landmarks[*i] = landmark);
    let located = tracker.locator.locate(snapshot, &view.frame, &pose(0.6, 0.0, 0.0), None, &mut matches);
    let (metres, radians) = off(&located.world_from_camera, &truth);
    assert!(metres < 1e-3 && radians < 1e-3, "{metres} m, {radians} rad");
    assert!(wrong.len() > 5 && wrong.iter().all(|i| matches.landmarks[*i].is_none()), "they are dropped");
    assert_eq!(matches.count(), located.inliers);
    // Where something else knows the pose far better than the features do, it is that.
    let elsewhere = truth * pose(0.0, 0.01, 0.0);
    let prior = PosePrior { world_from_camera: elsewhere, information: SMatrix::identity() * 1e12 };
    let mut matches = matched(&world, snapshot, &view);
    let located = tracker.locator.locate(snapshot, &view.frame, &truth, Some(&prior), &mut matches);
    assert!(off(&located.world_from_camera, &elsewhere).0 < 1e-4, "{:?}", located.world_from_camera);
}

#[test]
fn match_from_searches_farther_where_the_guess_is_poor_and_gives_up_elsewhere() {
    let (world, other) = (World::around(stereo(), 112), World::around(stereo(), 113));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let snapshot = atlas.latest();
    let k = snapshot.key_frame(ids[3]).unwrap();
    let anchored = AnchoredPose::at(k.id, k.world_from_camera);
    let last = Last { frame: k.frame.shared(), landmarks: k.landmarks.clone(), anchored };
    // Off by 21 pixels: three times as far as is searched at first.
    let (truth, guess) = (pose(0.62, 0.0, 0.05), pose(0.62, 0.0, 0.0));
    let view = world.see(&truth, from_s + STEP_S);
    let (found, matches) = tracker.locator.match_from(&last, &guess, &view.frame, snapshot).expect("a pose");
    let (metres, radians) = off(&found, &truth);
    assert!(metres < 1e-3 && radians < 1e-3, "{metres} m, {radians} rad");
    // The last search is close around the better pose, and finds nearly all that can be found.
    let truly = world.matches(snapshot, &view);
    assert!(matches.landmarks.iter().zip(&truly).all(|(found, truly)| found.is_none() || found == truly));
    assert!(matches.count() * 10 > truly.iter().flatten().count() * 9, "{}", matches.count());
    let nowhere = other.see(&truth, from_s + STEP_S);
    assert!(tracker.locator.match_from(&last, &guess, &nowhere.frame, snapshot).is_none());
}

#[test]
fn metre_is_one_with_depth_and_else_by_the_walking_speed() {
    for (camera, before, walking) in [(stereo(), 1.0, 1.0), (mono(), 1.0 / 1.5, 0.2)] {
        let mut tracker = tracker(camera);
        assert!((tracker.unit.metre() - before).abs() < 1e-12, "{}", tracker.unit.metre());
        // Whoever walks at 0.3 units a second is taken to walk at 1.5 m/s.
        (0..30).for_each(|_| tracker.unit.pace.push(0.3));
        assert!((tracker.unit.metre() - walking).abs() < 1e-12, "{}", tracker.unit.metre());
    }
}

#[test]
fn with_imu_data_gives_a_beginning_map_the_readings_between_its_frames() {
    let world = World::around(stereo(), 114);
    let noise = ImuNoise { gyro: 3e-4, gyro_walk: 1e-4, accel: 3e-3, accel_walk: 1e-3 };
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise, offset_s: 0.0 };
    let mut with_imu = tracker(world.camera).with_imu(&sensor, Se3::identity());
    let reading = |i: u32| {
        let stamp = Stamp::from_seconds(f64::from(i) / 100.0);
        ImuSample::new(stamp, Vec3::zeros(), Vec3::y() * -GRAVITY_M_S2)
    };
    let readings: Vec<ImuSample> = (0..=200).map(reading).collect();
    with_imu.priors.inertial.as_mut().unwrap().filter.take(&readings, 0.0);
    let frame = |seconds: f64| world.see(&Se3::identity(), seconds).frame;
    let begun = KeyFrameRequest::First { frame: frame(1.5), relocation_prior: None, imu: None };
    let KeyFrameRequest::First { imu: Some(segment), .. } = with_imu.priors.with_imu_data(begun.clone())
    else {
        panic!("no IMU data")
    };
    let up = segment.up.expect("readings before the frame");
    assert!((up + Vec3::y()).norm() < 1e-6, "y points down: {up:?}");
    assert!(segment.samples.is_empty(), "no frame was before it");
    let pair = KeyFrameRequest::Pair {
        first: frame(0.5),
        second: frame(1.5),
        first_from_second: Se3::identity(),
        points: Vec::new(),
        relocation_prior: None,
        imu: None,
        clocks: None,
    };
    let KeyFrameRequest::Pair { imu: Some(segment), .. } = with_imu.priors.with_imu_data(pair) else {
        panic!("no IMU data")
    };
    let ends =
        [segment.samples.first(), segment.samples.last()].map(|s| s.expect("readings").stamp.seconds());
    assert_eq!(ends, [0.5, 1.5]);
    let KeyFrameRequest::First { imu, .. } = tracker(world.camera).priors.with_imu_data(begun) else {
        panic!()
    };
    assert!(imu.is_none(), "without an IMU");
}

#[test]
fn anchor_nearest_takes_the_nearest_key_frame_of_the_local_map_else_the_fallback() {
    let world = World::around(stereo(), 115);
    let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let snapshot = atlas.latest();
    let near_third = pose(0.43, 0.05, 0.1);
    let anchored = tracker.locator.anchor_nearest(snapshot, ids[0], near_third).expect("a pose");
    assert_eq!(anchored.reference, ids[0], "there is no local map yet");
    step(&mut tracker, snapshot, &world.see(&pose(0.98, 0.0, 0.0), from_s + STEP_S));
    let anchored = tracker.locator.anchor_nearest(snapshot, ids[0], near_third).expect("a pose");
    assert_eq!(anchored.reference, ids[2]);
    assert_eq!(anchored.world_from_camera, near_third);
    let resolved = snapshot.resolve(anchored.reference, &anchored.reference_from_camera).unwrap();
    assert!(off(&resolved, &near_third).0 < 1e-12);
}

#[test]
fn unit_is_supported_while_neither_parallax_is_lost_nor_a_guessed_unit_is_unchecked() {
    let world = World::around(mono(), 116);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.005));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    assert!(tracker.unit.is_supported());
    for (done, expected) in [(0, false), (1, true)] {
        tracker.unit.comparison = Some(PaceComparison { map: MapId(ids[0]), pace: 1.2, done });
        assert_eq!(tracker.unit.is_supported(), expected, "after {done} comparisons");
    }
    // No landmark of this map has parallax.
    let view = world.see(&pose(0.015, 0.0, 0.0), from_s + STEP_S);
    let matches = matched(&world, atlas.latest(), &view);
    (0..3).for_each(|_| tracker.unit.support.update(atlas.latest(), &matches.landmarks));
    assert!(!tracker.unit.is_supported());
}

#[test]
fn watch_keeps_the_poses_of_one_camera_that_sees_no_parallax_and_no_others() {
    let up = Sim3 { rotation: So3::exp(&(Vec3::x() * -std::f64::consts::FRAC_PI_2)), ..Sim3::identity() };
    for (camera, apart_m, is_aligned, kept) in [
        (mono(), 0.005, false, 3),
        (mono(), 0.2, false, 0),
        (mono(), 0.005, true, 0),
        (stereo(), 0.005, false, 0),
    ] {
        let world = World::around(camera, 117);
        let (mut atlas, ids) = world.exact_map(&sideways(4, apart_m));
        if is_aligned {
            atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), up)]);
        }
        let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
        let snapshot = atlas.latest();
        let at = snapshot.key_frame(ids[3]).unwrap().world_from_camera;
        for n in 1..=5 {
            let view = world.see(&pose(3.0 * apart_m, 0.0, 0.0), from_s + STEP_S * f64::from(n));
            let matches = matched(&world, snapshot, &view);
            tracker.unit.watch(&view.frame, snapshot, &matches, AnchoredPose::at(ids[3], at));
        }
        let case = format!("depth {}, {apart_m} m, aligned {is_aligned}", world.camera.has_depth());
        assert_eq!(tracker.unit.support.is_lost(), kept > 0, "{case}");
        // It is lost from the third frame on.
        let stamps: Vec<f64> = tracker.unit.unsupported.iter().map(|(stamp, _)| stamp.seconds()).collect();
        assert_eq!(stamps.len(), kept, "{case}: {stamps:?}");
        assert!(
            stamps.first().is_none_or(|first| (first - from_s - 3.0 * STEP_S).abs() < 1e-9),
            "{stamps:?}"
        );
    }
}

#[test]
fn rotation_prior_is_where_the_camera_was_carried_and_as_sure_as_it_has_turned_long() {
    let world = World::around(mono(), 118);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let (mut tracker, from_s) = tracker_at_end(&world, &atlas, &ids);
    let at = |n: u32| Stamp::from_seconds(from_s + STEP_S * f64::from(n));
    let turned = |n: u32| pose(0.6, 0.0, 0.04 * f64::from(n));
    assert!(tracker.unit.rotation_prior(at(1), atlas.latest()).is_none(), "nothing was carried");
    for n in 1..=20 {
        tracker.unit.keep_unsupported(at(n), anchored_at(atlas.latest(), ids[3], turned(n)).unwrap());
    }
    // The map moves in the meantime, and the poses with it.
    let shift = pose(0.5, 0.3, 1.5);
    let snapshot = atlas.latest().clone();
    atlas.commit(
        snapshot.key_frames().map(|k| Change::MoveKeyFrame(k.id, shift * k.world_from_camera)).collect(),
    );
    let prior = tracker.unit.rotation_prior(at(15), atlas.latest()).expect("it was carried");
    let (metres, radians) = off(&prior.anchored.world_from_camera, &(shift * turned(15)));
    assert!(metres < 1e-9 && radians < 1e-9, "{metres} m, {radians} rad");
    assert_eq!(prior.anchored.reference, ids[3]);
    assert!((prior.sigma - tracker.unit.on_the_spot_sigma(14.0 * STEP_S)).abs() < 1e-9, "{}", prior.sigma);
    assert_eq!((prior.sigma_rad, prior.gravity_aligned), (super::scale::TURNED_RAD, false));
    assert!(tracker.unit.rotation_prior(at(21), atlas.latest()).is_none(), "that frame was not carried");
}

#[test]
fn is_confirmed_before_takes_half_a_second_of_observations_that_began_in_time() {
    let world = World::around(stereo(), 119);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.3));
    let snapshot = atlas.latest();
    let at = Stamp::from_seconds;
    let mut counts = [0; 3];
    for landmark in snapshot.landmarks() {
        let n = landmark.observations.len();
        let first = snapshot.key_frame(landmark.observations[0].key_frame).unwrap().stamp;
        let before = is_confirmed_before(snapshot, landmark, first);
        // Key frames are half a second apart: two of them confirm a landmark, one does not.
        assert_eq!(before, n > 1, "{n} observations");
        assert!(!is_confirmed_before(snapshot, landmark, at(first.seconds() - 1e-3)), "it was not known yet");
        assert_eq!(is_confirmed_before(snapshot, landmark, at(100.0)), n > 1);
        counts[if n == 1 { 0 } else { 1 + usize::from(first > at(0.0)) }] += 1;
    }
    assert!(ids.len() == 4 && counts.iter().all(|n| *n > 3), "{counts:?}: one of each kind");
}
