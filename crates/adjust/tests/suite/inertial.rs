//! Windows with IMU factors on a synthetic map: one camera, a walk to and fro, exact readings.

use crate::{imu_walk, synthetic};
use cairn_adjust::{Imu, ImuModel, Level, RelativePoseFactors, Window, WindowConfig};
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{Atlas, Change, ChangeSet, ImuFactor, KeyFrameId, MapId, RelativePose, Snapshot};
use cairn_geometry::{Manifold, Se3, Sim3, So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::ImuSample;
use cairn_vision::{RectifiedCamera, SensorMode};
use imu_walk::{NOISE, ToAndFro};
use nalgebra::{Matrix6, SVector, Vector6};
use std::collections::BTreeMap;
use std::sync::Arc;
use synthetic::{mono, off};

fn model() -> ImuModel {
    ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 }
}

fn config() -> WindowConfig {
    WindowConfig { iterations: [30, 30], tolerance: 1e-10, ..WindowConfig::default() }
}

fn around(snapshot: &Snapshot, centre: KeyFrameId, chain: usize, config: &WindowConfig) -> Option<Window> {
    Window::of(snapshot, &mono()).need(Imu::new(model()).with_chain(chain)).around(centre, config)
}

fn whole(snapshot: &Snapshot, camera: &RectifiedCamera, model: ImuModel, root: KeyFrameId) -> Option<Window> {
    let window = Window::of(snapshot, camera).need(Imu::new(model)).add(Level::default());
    window.add(RelativePoseFactors::default()).whole(MapId(root))
}

/// The map of a walk that turns, metric and level but for what is said.
fn walk(tilt_rad: f64, factor: f64) -> (Atlas, Vec<KeyFrameId>) {
    ToAndFro { turn_rad: 0.5, tilt_rad, factor }.map(24)
}

/// Key frames that move are off by a centimetre and a quarter of a degree, their velocities by 5 cm/s.
fn perturb(atlas: &mut Atlas, ids: &[KeyFrameId]) {
    let snapshot = atlas.latest().clone();
    let mut changes = Vec::new();
    for (n, id) in ids.iter().enumerate() {
        let k = snapshot.key_frame(*id).unwrap();
        let d = |i: f64| (i * (n + 1) as f64).sin();
        let error = SVector::from([0.01 * d(1.3), 0.01 * d(1.7), 0.01 * d(0.7), 0.004 * d(2.1), 0.004, 0.0]);
        changes.push(Change::MoveKeyFrame(*id, k.world_from_camera.retract(&error)));
        let motion = k.motion.as_ref().unwrap();
        changes.push(Change::InertialState(*id, motion.velocity + Vec3::new(0.05, 0.0, -0.05), motion.bias));
    }
    assert_eq!(atlas.commit(changes).dropped, 0);
}

/// The greatest difference of positions in metres, and of velocities in m/s.
fn worst(a: &Snapshot, b: &Snapshot, ids: &[KeyFrameId]) -> [f64; 2] {
    ids.iter().fold([0.0; 2], |worst, id| {
        let [a, b] = [a, b].map(|s| s.key_frame(*id).unwrap());
        let speed = |k: &cairn_atlas::KeyFrame| k.motion.as_ref().unwrap().velocity;
        [
            worst[0].max(off(&a.world_from_camera, &b.world_from_camera).0),
            worst[1].max((speed(a) - speed(b)).norm()),
        ]
    })
}

#[test]
fn inertial_window_recovers_poses_and_velocities_of_its_chain_and_moves_nothing_before_it() {
    let (mut atlas, ids) = walk(0.0, 1.0);
    let truth = atlas.latest().clone();
    perturb(&mut atlas, &ids[14..]);
    let before = worst(atlas.latest(), &truth, &ids);
    assert!(before[0] > 0.01 && before[1] > 0.05, "{before:?}");
    let config = WindowConfig { key_frames: 10, ..config() };
    let window = around(atlas.latest(), ids[23], 10, &config).unwrap();
    assert_eq!(window.links(), 10, "the chain, and its link to the key frame before it");
    let result = window.solve(&config, || false);
    assert_eq!(atlas.commit(result.changes.changes).dropped, 0);
    let after = worst(atlas.latest(), &truth, &ids);
    assert!(after[0] < 1e-3 && after[1] < 5e-3, "{after:?} of {before:?}");
    assert_eq!(worst(atlas.latest(), &truth, &ids[..13])[0], 0.0, "key frames before the chain stay");
    assert!(around(atlas.latest(), KeyFrameId::from_index(99).unwrap(), 10, &config).is_none());
}

#[test]
fn inertial_whole_finds_the_scale_and_the_level_of_a_map() {
    let (mut atlas, ids) = walk(0.01, 1.03);
    let (level, _) = walk(0.0, 1.0);
    let up = |s: &Snapshot| s.key_frame(ids[0]).unwrap().world_from_camera.rotation.inverse() * Vec3::z();
    let length = |s: &Snapshot| {
        let at = |n: usize| s.key_frame(ids[n]).unwrap().world_from_camera.translation;
        (at(8) - at(0)).norm()
    };
    let tilt = |s: &Snapshot| up(s).angle(&up(level.latest()));
    let scale = |s: &Snapshot| length(s) / length(level.latest());
    assert!(tilt(atlas.latest()) > 0.009 && (scale(atlas.latest()) - 1.03).abs() < 1e-9);
    let window = whole(atlas.latest(), &mono(), model(), ids[0]).unwrap();
    assert_eq!(window.links(), ids.len() - 1);
    let result = window.solve(&config(), || false);
    assert_eq!(atlas.commit(result.changes.changes).dropped, 0);
    assert!(tilt(atlas.latest()) < 1e-3, "{} rad", tilt(atlas.latest()));
    assert!((scale(atlas.latest()) - 1.0).abs() < 3e-3, "{}", scale(atlas.latest()));
    let root = atlas.latest().key_frame(ids[0]).unwrap().world_from_camera.translation;
    assert_eq!(root, walk(0.01, 1.03).0.latest().key_frame(ids[0]).unwrap().world_from_camera.translation);
}

/// A level map that keeps a few of its readings only, as one that another rig goes on with has few at first. Their accelerometer has a
/// bias, which looks like a tilt.
#[test]
fn a_few_readings_far_from_the_root_turn_no_map_that_is_level() {
    let (atlas, ids) = walk(0.0, 1.0);
    let truth = atlas.latest().clone();
    let up = |s: &Snapshot, n: usize| {
        s.key_frame(ids[n]).unwrap().world_from_camera.rotation.inverse() * Vec3::z()
    };
    for last in [2, 4, 8] {
        let bare = truth.without_imu_factors();
        let with_bias = |id: &KeyFrameId| {
            let motion = truth.key_frame(*id).unwrap().motion.as_ref().unwrap();
            let factor = motion.imu_factor.as_ref().unwrap();
            let bias = Vec3::new(0.08, -0.05, 0.06);
            let samples = factor.sum.samples().iter().map(|s| ImuSample { accel: s.accel + bias, ..*s });
            let sum = Arc::new(Preintegrated::of(NOISE, Bias::default(), samples.collect()));
            [
                Change::InertialState(*id, motion.velocity, Bias::default()),
                Change::ImuFactor(*id, Some(ImuFactor { since: factor.since, sum })),
            ]
        };
        let first = ids[ids.len() - last - 1];
        let velocity = truth.key_frame(first).unwrap().motion.as_ref().unwrap().velocity;
        let begin = Change::InertialState(first, velocity, Bias::default());
        let of_last = ids[ids.len() - last..].iter().flat_map(with_bias);
        let changes = std::iter::once(begin).chain(of_last).collect();
        let (few, applied) = bare.apply(&ChangeSet { base: bare.version(), changes });
        assert_eq!(applied.dropped, 0);
        let window = whole(&few, &mono(), model(), ids[0]).unwrap();
        assert_eq!(window.links(), last);
        let result = window.solve(&config(), || false);
        let after = few.apply(&result.changes).0;
        let tilt = (0..ids.len()).map(|n| up(&after, n).angle(&up(&truth, n))).fold(0.0, f64::max);
        let [was, is] = [&truth, &after].map(|s| s.key_frame(ids[0]).unwrap().world_from_camera);
        let turned = is.rotation * was.rotation.inverse();
        println!("{last} readings: tilted by {tilt:.4} rad");
        assert_eq!(was.translation, is.translation, "the root");
        assert!(turned.log().z.abs() < 1e-6, "the heading of the root");
        assert!(tilt < 0.003, "{last} readings: {tilt} rad");
    }
}

/// What depth measured between key frames counts beside what the IMU did.
#[test]
fn inertial_whole_takes_the_relative_poses_of_the_map() {
    let (mut atlas, ids) = walk(0.0, 1.0);
    let pose = |s: &Snapshot, n: usize| s.key_frame(ids[n]).unwrap().world_from_camera;
    // A tenth of a millimetre, where landmarks say what is four off.
    let off = Vector6::new(0.0, 4e-4, 0.0, 0.0, 0.0, 0.0);
    let from_from_here = (pose(atlas.latest(), 3).inverse() * pose(atlas.latest(), 20)).retract(&off);
    let z = RelativePose { from: ids[3], from_from_here, information: Matrix6::identity() * 1e8 };
    let chi2 = |s: &Snapshot| z.chi2(&pose(s, 3), &pose(s, 20));
    assert!(chi2(atlas.latest()) > 15.0);
    for related in [false, true] {
        if related {
            atlas.commit(vec![Change::RelativePoses(ids[20], vec![z])]);
        }
        let window = whole(atlas.latest(), &mono(), model(), ids[0]).unwrap();
        assert_eq!(window.links(), ids.len() - 1 + usize::from(related));
        let after = atlas.latest().apply(&window.solve(&config(), || false).changes).0;
        assert_eq!(chi2(&after) < 1.0, related, "{}", chi2(&after));
    }
}

/// A phone whose camera is 6 cm from where it is said to be on the IMU, in a walk that turns about the vertical axis.
#[test]
fn a_lever_arm_that_is_unknown_is_found_along_the_axes_that_a_turn_moves() {
    let (atlas, ids) = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 1.0 }.map(48);
    let truth = atlas.latest();
    let stated = Se3::new(So3::identity(), Vec3::new(0.05, 0.0, -0.03));
    let (snapshot, model) =
        (truth.with_imu_from_camera(stated), ImuModel { imu_from_camera: stated, ..model() });
    let adjusted = |sigma_m: f64| {
        let imu = Imu::new(model).with_lever_arm(sigma_m);
        let window = Window::of(&snapshot, &mono()).need(imu).add(Level::default()).whole(MapId(ids[0]));
        let (adjusted, applied) = snapshot.apply(&window.unwrap().solve(&config(), || false).changes);
        assert_eq!(applied.dropped, 0);
        adjusted
    };
    let [as_stated, found] = [0.0, 0.04].map(adjusted);
    assert_eq!(as_stated.imu_from_camera(), Some(&stated));
    let arm = found.imu_from_camera().unwrap().translation;
    let [off_stated, off_found] = [&as_stated, &found].map(|s| worst(s, truth, &ids));
    println!("arm {arm:?}, off {off_stated:?} as stated, {off_found:?} with what was found");
    assert!(arm.xz().norm() < 0.005, "{arm:?}");
    assert!(off_found[0] < 0.3 * off_stated[0] && off_found[1] < 0.3 * off_stated[1]);
}

/// In the atlas of another camera key frames keep what their IMU measured, and how their own camera is mounted on it.
#[test]
fn readings_of_another_rig_count_by_its_own_mount() {
    let (atlas, ids) = walk(0.0, 1.03);
    let about = About { program: "a test".into(), sensor: SensorMode::Mono, camera: mono() };
    let snapshot = atlas.latest().with_imu_from_camera(Se3::identity());
    let file = MapFile { snapshot, about, attached: BTreeMap::new() };
    let camera = RectifiedCamera { fx: 1.5 * mono().fx, ..mono() };
    let first = MapFile {
        snapshot: Snapshot::with_octaves(file.snapshot.octaves()),
        about: About { camera, ..file.about.clone() },
        attached: BTreeMap::new(),
    };
    let beside = file.in_atlas_of(&first).unwrap().snapshot;
    let metre = |s: &Snapshot| {
        let at = |n: usize| s.key_frame(ids[n]).unwrap().world_from_camera.translation;
        (at(8) - at(0)).norm()
    };
    let right = metre(walk(0.0, 1.0).0.latest());
    assert!((metre(&beside) / right - 1.03).abs() < 1e-9);
    // The atlas's camera is mounted otherwise, on an IMU that is much noisier.
    let mount = Se3::new(So3::exp(&Vec3::new(1.0, 2.0, 0.3)), Vec3::new(3.0, -2.0, 1.0));
    let other = ImuModel { imu_from_camera: mount, noise: NOISE.times([100.0; 2]), others_times: 1.0 };
    let window = whole(&beside, &camera, other, ids[0]).unwrap();
    assert_eq!(window.links(), ids.len() - 1);
    let result = window.solve(&config(), || false);
    let (adjusted, applied) = beside.apply(&result.changes);
    assert_eq!(applied.dropped, 0);
    assert!((metre(&adjusted) / right - 1.0).abs() < 3e-3, "{}", metre(&adjusted) / right);
    // Nothing of it stays in what is saved, nor in the map that another camera continues.
    for bare in [adjusted.without_other_imus(), file.in_atlas_with(SensorMode::Mono, &camera, 0.0).snapshot] {
        assert!(bare.key_frames().all(|k| k.motion.is_none()));
        assert!(bare.other_cameras().all(|other| other.imu_from_camera.is_none()));
        assert_eq!((bare.other_cameras().count(), bare.check()), (1, Ok(())));
    }
    // Without its mount there is none.
    let unmounted =
        MapFile { snapshot: Snapshot::clone(atlas.latest()), ..file }.in_atlas_of(&first).unwrap().snapshot;
    assert!(whole(&unmounted, &camera, other, ids[0]).is_none());
}

#[test]
fn without_readings_there_are_no_links_and_the_window_is_visual() {
    let (atlas, ids) = walk(0.0, 1.0);
    let mut plain = Atlas::new(Snapshot::new());
    let world = synthetic::World::around(mono(), 71);
    let path = synthetic::sideways(4, 0.2);
    let seen = world.map(&mut plain, &world.walk(&path, 0.0, 0.5), &path, None, |_| Sim3::identity());
    assert!(whole(plain.latest(), &mono(), model(), seen[0]).is_none(), "it needs them");
    let added = Window::of(plain.latest(), &mono()).add(Imu::new(model())).whole(MapId(seen[0])).unwrap();
    assert_eq!(added.links(), 0);
    assert_eq!(Window::of(atlas.latest(), &mono()).whole(MapId(ids[0])).unwrap().links(), 0);
}
