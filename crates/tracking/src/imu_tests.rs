//! The inertial filter on synthetic maps: what it says of its own uncertainty while the readings carry the pose.

use crate::imu::InertialFilter;
use crate::on_the_spot::PureRotation;
use crate::state::{AnchoredPose, Last, State, anchored_at};
use crate::synthetic::{FEATURES, RATE_HZ, World, pose, sideways, stereo};
use crate::tests::tracker as new_tracker;
use crate::{Tracked, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, Change, InertialState, KeyFrame, KeyFrameId, MapId};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::Bias;
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, ImuSensor, Stamp};
use std::f64::consts::{FRAC_PI_2, PI};

const NOISE: ImuNoise = ImuNoise { gyro: 3e-4, gyro_walk: 1e-4, accel: 3e-3, accel_walk: 1e-3 };
/// Speed along x, m/s.
const SPEED: f64 = 0.4;

/// A walk at constant speed: 0.2 m in half a second, as [`sideways`] has its key frames.
fn at(t: f64) -> Se3 {
    pose(SPEED * t, 0.0, 0.0)
}

fn filter() -> InertialFilter {
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
    InertialFilter::new(&sensor, Se3::identity())
}

pub(crate) fn readings(from_s: f64, to_s: f64) -> Vec<ImuSample> {
    let count = ((to_s - from_s) * 100.0).round() as usize;
    let stamp = |i: usize| Stamp::from_seconds(from_s + i as f64 / 100.0);
    // The camera's y points down.
    (0..=count).map(|i| ImuSample::new(stamp(i), Vec3::zeros(), Vec3::y() * -GRAVITY_M_S2)).collect()
}

/// A key frame of the walk that mapping has adjusted with its IMU factors, with all landmarks in view.
fn key_frame(world: &World, atlas: &Atlas, id: KeyFrameId, t: f64) -> Vec<Change> {
    let view = world.see(&at(t), t);
    let landmarks = world.matches(atlas.latest(), &view);
    let turn = So3::exp(&(Vec3::x() * -FRAC_PI_2));
    let world_from_camera = Se3::new(turn, Vec3::zeros()) * at(t);
    let mut k = KeyFrame::new(
        id,
        view.frame.clone(),
        world_from_camera,
        atlas.latest().newest_key_frame().map(|k| k.id),
    );
    k.motion = Some(InertialState {
        velocity: Vec3::x() * SPEED,
        bias: Bias::default(),
        still_sigma: None,
        imu_factor: None,
    });
    let mut changes = vec![Change::AddKeyFrame(Box::new(k))];
    let seen = landmarks.iter().enumerate().filter_map(|(feature, l)| Some((feature, (*l)?)));
    changes.extend(seen.map(|(feature, l)| Change::Observe(l, id, feature as u16)));
    changes
}

#[test]
fn a_key_frame_made_while_the_readings_carry_the_pose_makes_it_no_better_known() {
    let world = World::around(stereo(), 31);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let up = So3::exp(&(Vec3::x() * -FRAC_PI_2));
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: up, ..Sim3::identity() })]);
    let id = atlas.latest().next_key_frame_id();
    atlas.commit(key_frame(&world, &atlas, id, 2.0));

    let mut filter = filter();
    filter.take(&readings(2.0, 5.2), atlas.latest().imu_offset());
    filter.refresh(atlas.latest());
    let anchor =
        |atlas: &Atlas, pose: Se3| -> AnchoredPose { anchored_at(atlas.latest(), id, pose).unwrap() };
    let mut sigmas = Vec::new();
    for n in 1..=30 {
        let t = 2.0 + 0.1 * f64::from(n);
        filter.refresh(atlas.latest());
        let predicted = filter.predict(Stamp::from_seconds(t)).expect("readings");
        sigmas.push(predicted.position_sigma());
        filter.coast(Stamp::from_seconds(t), &anchor(&atlas, predicted.world_from_camera), predicted, false);
        // Each of these looks as if mapping knew it to millimetres.
        if n == 10 || n == 20 {
            let id = atlas.latest().next_key_frame_id();
            atlas.commit(key_frame(&world, &atlas, id, t - 0.1));
            assert!(
                atlas.latest().newest_key_frame().is_some_and(|k| k.landmarks.iter().flatten().count() > 30)
            );
        }
    }
    assert!(sigmas.is_sorted(), "{sigmas:.3?}");
    assert!(sigmas[29] > 0.1, "{sigmas:.3?}");

    // Once the pose has been tracked again, it is known again.
    let seen = Stamp::from_seconds(5.1);
    let anchored = anchor(&atlas, Se3::new(up, Vec3::zeros()) * at(5.1));
    let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e6;
    let predicted = filter.predict(seen);
    filter.update(atlas.latest(), seen, &anchored, predicted.as_ref(), &known);
    assert!(filter.predict(Stamp::from_seconds(5.2)).unwrap().position_sigma() < 0.05);
}

#[test]
fn a_place_found_again_after_seconds_does_not_keep_the_speed_to_which_readings_alone_had_led() {
    let world = World::around(stereo(), 31);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let up = So3::exp(&(Vec3::x() * -FRAC_PI_2));
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: up, ..Sim3::identity() })]);
    let id = atlas.latest().next_key_frame_id();
    atlas.commit(key_frame(&world, &atlas, id, 2.0));
    let anchor = |pose: Se3| anchored_at(atlas.latest(), id, pose).unwrap();
    let mut filter = filter();
    // Readings that are 2 m/s^2 off, as by a bias that was estimated wrongly.
    let wrong = readings(2.0, 6.0).into_iter().map(|s| ImuSample { accel: s.accel + Vec3::x() * 2.0, ..s });
    filter.take(&wrong.collect::<Vec<_>>(), atlas.latest().imu_offset());
    filter.refresh(atlas.latest());
    for n in 1..=30 {
        let now = Stamp::from_seconds(2.0 + 0.1 * f64::from(n));
        let predicted = filter.predict(now).expect("readings");
        filter.coast(now, &anchor(predicted.world_from_camera), predicted, false);
    }
    let ran = filter.predict(Stamp::from_seconds(5.1)).unwrap();
    assert!(ran.velocity.norm() > 5.0, "{}", ran.velocity.norm());
    let place = Se3::new(up, Vec3::zeros()) * at(5.1);
    let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e6;
    filter.update(atlas.latest(), Stamp::from_seconds(5.1), &anchor(place), None, &known);
    let next = filter.predict(Stamp::from_seconds(5.2)).unwrap();
    let off = (next.world_from_camera.translation - place.translation).norm();
    assert!(off < 0.1 && off < 3.0 * next.position_sigma(), "{off} m +- {}", next.position_sigma());
}

/// A gravity-aligned map whose newest key frame, at 2 s, mapping has adjusted; a filter with readings of four seconds from
/// there, which has begun from it; and that key frame.
pub(crate) fn begun(readings: &[ImuSample]) -> (World, Atlas, InertialFilter, KeyFrameId) {
    let world = World::around(stereo(), 31);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: up(), ..Sim3::identity() })]);
    let id = atlas.latest().next_key_frame_id();
    atlas.commit(key_frame(&world, &atlas, id, 2.0));
    let mut filter = filter();
    filter.take(readings, atlas.latest().imu_offset());
    filter.refresh(atlas.latest());
    (world, atlas, filter, id)
}

/// The rotation that makes z point up.
fn up() -> So3 {
    So3::exp(&(Vec3::x() * -FRAC_PI_2))
}

pub(crate) fn truth(t: f64) -> Se3 {
    Se3::new(up(), Vec3::zeros()) * at(t)
}

fn seconds(t: f64) -> Stamp {
    Stamp::from_seconds(t)
}

#[test]
fn moved_is_the_motion_since_the_last_frame_and_since_no_other() {
    let (_, _, filter, _) = begun(&readings(2.0, 6.0));
    let moved = filter.moved(seconds(2.0), seconds(2.5)).expect("readings");
    assert!((moved.translation - Vec3::x() * 0.5 * SPEED).norm() < 1e-3, "{moved:?}");
    assert!(filter.moved(seconds(2.1), seconds(2.5)).is_none());
    assert!(filter.moved(seconds(2.0), seconds(9.0)).is_none(), "no readings");
}

#[test]
fn a_key_frame_adjusted_since_tells_the_speed_of_a_frame_tracked_after_it() {
    let sigma_after = |is_adjusted: bool| {
        let (world, mut atlas, mut filter, id) = begun(&readings(2.0, 6.0));
        // Tracked without a prediction: the speed is not known.
        let anchored = anchored_at(atlas.latest(), id, truth(2.5)).unwrap();
        let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e5;
        filter.update(atlas.latest(), seconds(2.5), &anchored, None, &known);
        if is_adjusted {
            let id = atlas.latest().next_key_frame_id();
            atlas.commit(key_frame(&world, &atlas, id, 2.4));
        }
        filter.refresh(atlas.latest());
        filter.predict(seconds(3.0)).unwrap().position_sigma()
    };
    let (known, unknown) = (sigma_after(true), sigma_after(false));
    assert!(known < 0.1 && unknown > 0.3, "{known} m, {unknown} m");
}

#[test]
fn on_the_spot_takes_a_speed_that_is_not_known_to_zero() {
    let (_, atlas, mut filter, id) = begun(&readings(2.0, 6.0));
    let predicted = filter.predict(seconds(2.5)).unwrap();
    assert!((predicted.velocity.norm() - SPEED).abs() < 0.01);
    let anchored = anchored_at(atlas.latest(), id, truth(2.5)).unwrap();
    let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e5;
    filter.update(atlas.latest(), seconds(2.5), &anchored, None, &known);
    let unsure = filter.predict(seconds(2.6)).unwrap();
    let held = InertialFilter::on_the_spot(&unsure).expect("a state");
    assert!(held.velocity.norm() < 0.2 * unsure.velocity.norm(), "{} m/s", held.velocity.norm());
}

#[test]
fn carried_s_counts_seconds_without_a_pose_but_not_where_the_camera_is_held_or_rests() {
    let coasted = |is_held: bool| {
        let (_, atlas, mut filter, id) = begun(&readings(2.0, 6.0));
        for n in 1..=10 {
            let now = seconds(2.0 + 0.1 * f64::from(n));
            let predicted = filter.predict(now).unwrap();
            let anchored = anchored_at(atlas.latest(), id, predicted.world_from_camera).unwrap();
            filter.coast(now, &anchored, predicted, is_held);
        }
        let carried = filter.carried_s(seconds(3.1));
        let anchored = anchored_at(atlas.latest(), id, truth(3.1)).unwrap();
        let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e5;
        let predicted = filter.predict(seconds(3.1));
        filter.update(atlas.latest(), seconds(3.1), &anchored, predicted.as_ref(), &known);
        assert!(filter.carried_s(seconds(3.1)) < 1e-9, "tracked again");
        carried
    };
    let (carried, held) = (coasted(false), coasted(true));
    assert!((carried - 1.1).abs() < 1e-6 && (held - 0.1).abs() < 1e-6, "{carried} s, {held} s");
}

#[test]
fn is_stationary_where_the_readings_rest_and_the_estimate_does() {
    let stands = |shaken: f64, tracked_before: bool| {
        let shake = |(n, s): (usize, ImuSample)| {
            let side = if n % 2 == 0 { shaken } else { -shaken };
            ImuSample { accel: s.accel + Vec3::z() * side, gyro: Vec3::x() * 0.2 * side, ..s }
        };
        let samples: Vec<ImuSample> = readings(2.0, 6.0).into_iter().enumerate().map(shake).collect();
        let (_, atlas, mut filter, id) = begun(&samples);
        let predicted = tracked_before.then(|| filter.predict(seconds(3.0)).unwrap());
        if !tracked_before {
            filter.forget();
        }
        let anchored = anchored_at(atlas.latest(), id, truth(3.0)).unwrap();
        let known = nalgebra::SMatrix::<f64, 6, 6>::identity() * 1e5;
        filter.update(atlas.latest(), seconds(3.0), &anchored, predicted.as_ref(), &known);
        filter.is_stationary(seconds(3.0))
    };
    assert!(stands(0.0, false));
    assert!(!stands(1.0, false), "it is shaken");
    assert!(!stands(0.0, true), "at constant speed the readings rest too");
}

#[test]
fn still_sigma_is_what_the_images_tell_where_the_readings_tell_of_no_rest() {
    let (_, _, filter, _) = begun(&readings(2.0, 6.0));
    let sigma = |spot| filter.still_sigma(seconds(2.5), spot);
    assert_eq!(sigma(PureRotation::No), None, "it walks on steadily");
    let [new, holds] =
        [PureRotation::New, PureRotation::Holds].map(|spot| sigma(spot).expect("a turn on the spot"));
    assert!(0.05 < new && new < holds && holds < 0.5, "{new} m/s now, {holds} m/s a moment ago");
}

#[test]
fn forget_leaves_nothing_to_predict_from() {
    let (_, _, mut filter, _) = begun(&readings(2.0, 6.0));
    assert!(filter.predict(seconds(2.5)).is_some());
    filter.forget();
    assert!(filter.predict(seconds(2.5)).is_none());
}

#[test]
fn rotations_are_wanted_for_a_while_and_go_with_the_next_segment() {
    let (_, _, mut filter, _) = begun(&readings(2.0, 6.0));
    assert!(filter.wants_rotations(seconds(2.0)));
    filter.add_rotation(seconds(2.0), up());
    assert_eq!(filter.take_segment(seconds(2.1)).turns, [(seconds(2.0), up())]);
    assert!(filter.take_segment(seconds(2.2)).turns.is_empty());
    assert!(filter.wants_rotations(seconds(17.0)) && !filter.wants_rotations(seconds(19.0)));
}

#[test]
fn take_segment_has_the_readings_since_the_last_one_or_since_the_map_was_created() {
    let (_, atlas, mut filter, id) = begun(&readings(2.0, 6.0));
    assert_eq!(filter.seconds_since_request(seconds(3.0)), None);
    filter.map_created(atlas.latest().key_frame(id).expect("there"));
    assert!(filter.predict(seconds(2.5)).is_none(), "it begins anew");
    filter.refresh(atlas.latest());
    assert!(filter.predict(seconds(2.5)).is_some());
    let ends = |s: &[ImuSample]| [s[0].stamp, s[s.len() - 1].stamp];
    let segment = filter.take_segment(seconds(3.0));
    assert_eq!(ends(&segment.samples), [seconds(2.0), seconds(3.0)]);
    assert!((segment.velocity - Vec3::x() * SPEED).norm() < 0.01, "{:?}", segment.velocity);
    // y of the camera points down.
    assert!((segment.up.expect("readings") + Vec3::y()).norm() < 1e-6);
    assert_eq!(ends(&filter.take_segment(seconds(3.5)).samples), [seconds(3.0), seconds(3.5)]);
    assert!(filter.seconds_since_request(seconds(3.9)).is_some_and(|s| (s - 0.4).abs() < 1e-9));
    assert_eq!(filter.seconds_since_request(seconds(8.0)), None, "the sensor has fallen silent");
}

#[test]
fn turning_is_the_angular_velocity_about_an_instant() {
    let turning = |s: ImuSample| ImuSample { gyro: Vec3::new(0.1, -0.4, 0.2), ..s };
    let samples: Vec<ImuSample> = readings(2.0, 3.0).into_iter().map(turning).collect();
    let (_, _, filter, _) = begun(&samples);
    let found = filter.turning(seconds(2.5)).expect("readings");
    assert!((found - Vec3::new(0.1, -0.4, 0.2)).norm() < 1e-9, "{found:?}");
    assert!(filter.turning(seconds(4.0)).is_none());
}

/// A tracker with the IMU at the end of the walk, whose view goes dark: the states that follow, frame by frame, and how far off
/// the pose is at each.
fn into_the_dark(coast_s: f64) -> Vec<(State, Option<f64>)> {
    walked_on(coast_s, 10, |s| s)
}

/// The same, with a view of so many frames, and readings that are changed.
fn walked_on(coast_s: f64, lit: i32, change: impl Fn(ImuSample) -> ImuSample) -> Vec<(State, Option<f64>)> {
    let (world, atlas, _, id) = begun(&[]);
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
    let config = TrackerConfig { coast_s, ..TrackerConfig::default() };
    let mut tracker =
        Tracker::new(world.camera, FEATURES, RATE_HZ, config).with_imu(&sensor, Se3::identity());
    tracker.map_created(atlas.latest(), id);
    let dark = World::empty(stereo());
    let mut states = Vec::new();
    for n in 1..=40 {
        let t = 2.0 + 0.05 * f64::from(n);
        let seen = if n <= lit { &world } else { &dark };
        let samples: Vec<ImuSample> = readings(t - 0.05, t).into_iter().map(&change).collect();
        let samples = if n == 1 { &samples[..] } else { &samples[1..] };
        let tracked = tracker.step(seen.see(&at(t), t).frame, samples, atlas.latest(), true, true);
        let metres = tracked.pose.map(|p| (p.world_from_camera.translation - truth(t).translation).norm());
        states.push((tracked.state, metres));
    }
    states
}

#[test]
fn a_dark_view_is_carried_by_the_readings_for_as_long_as_they_may() {
    let states = into_the_dark(6.0);
    assert!(states[..10].iter().all(|(s, m)| *s == State::Tracking && m.unwrap() < 2e-3), "{states:?}");
    let coasts = |(s, m): &(State, Option<f64>)| matches!(s, State::Coasting { .. }) && m.unwrap() < 0.05;
    assert!(states[10..].iter().all(coasts), "{states:?}");
    let states = into_the_dark(0.6);
    assert!(states[10..20].iter().all(coasts), "{states:?}");
    assert!(!states[30..].iter().any(coasts), "{states:?}");
}

/// Readings that lead far off, of a gyroscope that tells degrees, from a moment on: they do not carry a camera that sees.
#[test]
fn readings_that_lead_nowhere_do_not_carry_a_camera_that_sees() {
    let turning = |s: ImuSample| match s.stamp.seconds() > 2.405 {
        true => ImuSample { gyro: Vec3::new(2.0, 5.0, 1.0), ..s },
        false => s,
    };
    let states = walked_on(6.0, 40, turning);
    assert!(states.iter().all(|(s, m)| *s == State::Tracking && m.unwrap() < 5e-3), "{states:?}");
}

#[test]
fn up_is_told_by_an_imu_in_a_map_that_is_aligned_with_gravity() {
    let (world, atlas, _, id) = begun(&[]);
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
    let tracker = || Tracker::new(world.camera, FEATURES, RATE_HZ, TrackerConfig::default());
    let up_after = |mut tracker: Tracker| {
        tracker.map_created(atlas.latest(), id);
        let view = world.see(&at(2.05), 2.05);
        tracker.step(view.frame, &readings(2.0, 2.1), atlas.latest(), true, true);
        tracker.up(seconds(2.1))
    };
    // y of the camera points down.
    let up = up_after(tracker().with_imu(&sensor, Se3::identity())).expect("a direction");
    assert!((up + Vec3::y()).norm() < 0.01, "{up:?}");
    assert_eq!(up_after(tracker()), None);
}

/// A sensor whose stated noise hides a gentle start: a walker who has stood sets out with 0.6 m/s^2.
#[test]
fn one_who_sets_out_gently_is_not_held_where_he_stood() {
    let world = World::around(stereo(), 31);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let up = So3::exp(&(Vec3::x() * -FRAC_PI_2));
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: up, ..Sim3::identity() })]);
    let id = atlas.latest().next_key_frame_id();
    let mut changes = key_frame(&world, &atlas, id, 2.0);
    changes.push(Change::InertialState(id, Vec3::zeros(), Bias::default()));
    atlas.commit(changes);
    let noise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 60.0, noise, offset_s: 0.0 };
    let mut filter = InertialFilter::new(&sensor, Se3::identity());
    let pushed = |s: ImuSample| match s.stamp.seconds() >= 4.0 {
        true => ImuSample { accel: s.accel + Vec3::x() * 0.6, ..s },
        false => s,
    };
    filter.take(&readings(2.0, 5.2).into_iter().map(pushed).collect::<Vec<_>>(), atlas.latest().imu_offset());
    filter.refresh(atlas.latest());
    let anchor = |pose: Se3| anchored_at(atlas.latest(), id, pose).unwrap();
    let begin = filter.predict(Stamp::from_seconds(2.1)).expect("readings").world_from_camera.translation;
    for n in 1..=30 {
        let now = Stamp::from_seconds(2.0 + 0.1 * f64::from(n));
        let predicted = filter.predict(now).expect("readings");
        filter.coast(now, &anchor(predicted.world_from_camera), predicted, false);
        if n == 20 {
            assert!(filter.is_stationary(now), "he stands");
        }
    }
    let end = filter.predict(Stamp::from_seconds(5.1)).expect("readings");
    let gone = (end.world_from_camera.translation - begin).norm();
    assert!(
        (gone - 0.36).abs() < 0.1 && (end.velocity.norm() - 0.66).abs() < 0.1,
        "{gone} m, {}",
        end.velocity
    );
}

/// Nothing of the map is in view after a turn on the spot; there, landmarks were made since that contradict where the camera is by
/// `off_m`, as if its key frames had been moved.
fn after_a_turn(off_m: f64, is_old: bool) -> (Tracked, f64) {
    let world = World::around(stereo(), 31);
    let (mut atlas, ids) = world.exact_map(&sideways(4, 0.0));
    let turn = So3::exp(&(Vec3::x() * -FRAC_PI_2));
    let level = Se3::new(turn, Vec3::zeros());
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3 { rotation: turn, ..Sim3::identity() })]);
    let behind = |atlas: &mut Atlas, from_s: f64| {
        let path = [pose(0.0, 0.0, PI); 4];
        let views = world.walk(&path, from_s, 0.3);
        let newest = atlas.latest().newest_key_frame().map(|k| k.id);
        world.map(atlas, &views, &path, newest, |_| Sim3::new(turn, Vec3::x() * off_m, 1.0))[3]
    };
    let mut there = is_old.then(|| behind(&mut atlas, 0.5));
    let id = atlas.latest().next_key_frame_id();
    let view = world.see(&pose(0.0, 0.0, 0.0), 2.0);
    let mut k = KeyFrame::new(id, view.frame.clone(), level, Some(ids[3]));
    k.motion = Some(InertialState {
        velocity: Vec3::zeros(),
        bias: Bias::default(),
        still_sigma: None,
        imu_factor: None,
    });
    let mut changes = vec![Change::AddKeyFrame(Box::new(k))];
    let seen = world.matches(atlas.latest(), &view);
    let seen = seen.into_iter().enumerate().filter_map(|(feature, l)| Some((feature, l?)));
    changes.extend(seen.map(|(feature, l)| Change::Observe(l, id, feature as u16)));
    atlas.commit(changes);

    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 100.0, noise: NOISE, offset_s: 0.0 };
    let mut tracker = new_tracker(world.camera).with_imu(&sensor, Se3::identity());
    tracker.map_created(atlas.latest(), id);
    let rate = PI / 2.0;
    let turning = |s: ImuSample| match s.stamp.seconds() {
        t if (2.2..4.2).contains(&t) => ImuSample { gyro: Vec3::y() * rate, ..s },
        _ => s,
    };
    let mut last = None;
    for n in 1..=26 {
        let t = 2.0 + 0.1 * f64::from(n);
        let imu: Vec<ImuSample> = readings(t - 0.1, t).into_iter().map(turning).collect();
        let view = match n {
            1..=2 => world.see(&pose(0.0, 0.0, 0.0), t),
            // Nothing to match while he turns.
            3..=24 => World::around(stereo(), 1000 + n as u64).see(&Se3::identity(), t),
            _ => world.see(&pose(0.0, 0.0, PI), t),
        };
        let tracked = tracker.step(view.frame.clone(), &imu, atlas.latest(), false, true);
        if n == 24 {
            // As with a key frame that is made there.
            let there = *there.get_or_insert_with(|| behind(&mut atlas, 3.0));
            let carried = tracked.pose.expect("the readings carry it").world_from_camera;
            tracker.last = Some(Last {
                landmarks: vec![None; view.frame.len()],
                frame: view.frame,
                anchored: anchored_at(atlas.latest(), there, carried).unwrap(),
            });
        }
        last = Some(tracked);
    }
    let tracked = last.unwrap();
    let place = tracked.pose.map_or(f64::NAN, |p| p.world_from_camera.translation.norm());
    (tracked, place)
}

#[test]
fn landmarks_made_since_a_turn_do_not_move_the_camera_but_confirmed_ones_do() {
    let (agreeing, place) = after_a_turn(0.0, false);
    assert!(agreeing.state == State::Tracking && place < 0.1, "{:?} {place} m", agreeing.state);
    let (contradicting, place) = after_a_turn(2.2, false);
    assert!(matches!(contradicting.state, State::Coasting { .. }), "{:?}", contradicting.state);
    assert!(place < 0.3, "{place} m");
    let (known, place) = after_a_turn(2.2, true);
    assert!(known.state == State::Tracking && (place - 2.2).abs() < 0.1, "{:?} {place} m", known.state);
}
