//! The mapping stage as a whole on synthetic maps: key frames in, a map out.

use crate::synthetic::{View, World, mono, off, pose, sideways, stereo};
use crate::tests::{assert_exact, remove, visited_twice};
use crate::{KeyFrameInput, MapStart, Mapped, Mapper, MapperConfig};
use cairn_atlas::{Atlas, Change, KeyFrameId, LandmarkId, MapId, MapPrior, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3};

/// Submits a view as tracking does: its true matches, at a pose with an error.
fn submit(
    mapper: &mut Mapper,
    atlas: &mut Atlas,
    world: &World,
    view: &View,
    at: &Se3,
    change: impl FnOnce(&mut KeyFrameInput),
) -> Mapped {
    let landmarks = world.matches(atlas.latest(), view);
    let reference = atlas.latest().newest_key_frame().expect("a map").id;
    let reference_from_camera = atlas.latest().anchor(reference, at).expect("there");
    let mut submitted = KeyFrameInput {
        frame: &view.frame,
        landmarks: &landmarks,
        reference,
        reference_from_camera,
        imu: None,
        orientation_only: false,
        rescale: None,
        motion: None,
        by_depth: false,
    };
    change(&mut submitted);
    mapper.step(atlas, &submitted, || false).expect("a key frame")
}

#[test]
fn mapper_builds_an_exact_map_from_poses_that_are_off() {
    let world = World::around(stereo(), 61);
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let mut atlas = Atlas::new(Snapshot::new());
    let path: Vec<Se3> = (0..10).map(|n| pose(0.15 * f64::from(n), 0.0, 0.04 * f64::from(n))).collect();
    let views = world.walk(&path, 0.0, 0.5);
    let root = mapper.start(&mut atlas, &views[0].frame, &MapStart::default());
    assert_eq!(atlas.latest().landmark_count(), views[0].frame.len());
    let mut worst: f64 = 0.0;
    for (n, view) in views.iter().enumerate().skip(1) {
        let wrong = path[n] * pose(0.02, -0.01, 0.005);
        let mapped = submit(&mut mapper, &mut atlas, &world, view, &wrong, |_| ());
        assert!(mapped.created > 0, "each view shows something new");
        assert_eq!(mapped.adjustment.is_some(), n >= 2, "a window takes three key frames");
        if n >= 2 {
            let k = atlas.latest().key_frame(mapped.key_frame).expect("the newest stays");
            worst = worst.max(off(&k.world_from_camera, &path[n]).0);
        }
    }
    assert!(worst < 5e-3, "{worst} m");
    let before = atlas.latest().version();
    mapper.final_adjustment(&mut atlas, || true);
    assert_eq!(atlas.latest().version(), before, "one that is stopped changes nothing");
    mapper.final_adjustment(&mut atlas, || false);
    for k in atlas.latest().key_frames() {
        let n = views.iter().position(|v| k.frame.is(&v.frame)).expect("a view");
        let (metres, radians) = off(&k.world_from_camera, &path[n]);
        assert!(metres < 1e-3 && radians < 5e-4, "view {n}: {metres} m, {radians} rad");
    }
    assert!(atlas.latest().key_frame(root).is_some());
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 0.02);
}

#[test]
fn mapper_starts_from_a_pair_and_goes_on_in_its_unit() {
    let world = World::around(mono(), 62);
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let mut atlas = Atlas::new(Snapshot::new());
    let path = sideways(6, 0.25);
    let views = world.walk(&path, 0.0, 0.5);
    // The points seen in both, with a baseline of unit length.
    let mut points = Vec::new();
    for (i, point) in views[0].points.iter().enumerate() {
        if let Ok(j) = views[1].points.binary_search(point) {
            points.push((i as u16, j as u16, world.points[*point] * 4.0));
        }
    }
    let first_from_second = pose(1.0, 0.0, 0.0);
    let [first, second] = [&views[0].frame, &views[1].frame];
    let none = mapper.start_pair(&mut atlas, first, second, first_from_second, &[], &MapStart::default());
    assert!(none.is_none() && atlas.latest().key_frame_count() == 0, "no point, no map");
    // The assumed speed is one unit a second: the baseline, walked in half a second, is half a unit.
    let start = MapStart { speed: Some(1.0), ..MapStart::default() };
    let b = mapper.start_pair(&mut atlas, first, second, first_from_second, &points, &start);
    let b = b.expect("a map");
    let at = atlas.latest().key_frame(b).expect("there").world_from_camera;
    assert!((at.translation - Vec3::new(0.5, 0.0, 0.0)).norm() < 1e-4, "{at:?}");
    let world_from_map = Sim3 { scale: 0.5, ..Sim3::identity() };
    assert_exact(&world, atlas.latest(), &world_from_map, 2e-3);
    for (n, view) in views.iter().enumerate().skip(2) {
        let truth = world_from_map.inverse().transform_pose(&path[n]);
        let mapped =
            submit(&mut mapper, &mut atlas, &world, view, &(truth * pose(0.01, 0.01, 0.003)), |_| ());
        let k = atlas.latest().key_frame(mapped.key_frame).expect("the newest stays");
        // Rotation does not depend on the unit of length, which images alone do not determine: it follows the
        // guesses.
        let (units, radians) = off(&k.world_from_camera, &truth);
        assert!(units < 0.03 && radians < 1e-4, "view {n}: {units}, {radians} rad");
    }
    let last = atlas.latest().newest_key_frame().expect("there").world_from_camera;
    let world_from_map = Sim3 { scale: path[5].translation.x / last.translation.x, ..Sim3::identity() };
    assert!((world_from_map.scale - 0.5).abs() < 0.01, "{}", world_from_map.scale);
    assert_exact(&world, atlas.latest(), &world_from_map, 0.01);
}

/// Points seen in both views, in the camera frame of the first (at the origin, not turned), in baselines.
fn points_in_both(world: &World, views: [&View; 2], baseline: f64) -> Vec<(u16, u16, Vec3)> {
    let second = |point| views[1].points.binary_search(point).ok();
    let both = views[0].points.iter().enumerate().filter_map(|(i, point)| Some((i, second(point)?, *point)));
    both.map(|(i, j, point)| (i as u16, j as u16, world.points[point] / baseline)).collect()
}

#[test]
fn a_map_that_begins_after_assumed_depths_removes_the_key_frames_that_rest_on_them() {
    let world = World::around(mono(), 65);
    let path = sideways(6, 0.2);
    let (mut atlas, ids) = world.exact_map(&path);
    let before = atlas.latest().clone();
    let views = world.walk(&path, 10.0, 0.5);
    let points = points_in_both(&world, [&views[0], &views[1]], 0.2);
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let to_from_root = Se3::identity();
    let prior = MapPrior { to: ids[5], to_from_root, sigma: 1.0, sigma_rad: 0.1, sigma_log_scale: 2.0 };
    let start = MapStart { map_prior: Some(prior), assumed_since: Some(ids[4]), ..MapStart::default() };
    let [first, second] = [&views[0].frame, &views[1].frame];
    let newest = mapper
        .start_pair(&mut atlas, first, second, pose(1.0, 0.0, 0.0), &points, &start)
        .expect("a map of its own");
    let after = atlas.latest();
    after.check().unwrap();
    let alive = |id: &KeyFrameId| after.key_frame(*id).is_some();
    assert!(ids[..4].iter().all(alive) && !ids[4..].iter().any(alive) && alive(&newest));
    // What was anchored to them stays where it was.
    let moved = after.resolve(ids[5], &Se3::identity()).map(|at| off(&at, &path[5]).0);
    assert!(moved.is_some_and(|m| m < 1e-9), "{moved:?}");
    // No landmark is known by them any more, and those of the other key frames are untouched.
    let observed = |id: &KeyFrameId| after.landmarks().any(|l| l.feature_in(*id).is_some());
    assert!(!ids[4..].iter().any(observed));
    let held = |s: &Snapshot| s.key_frame(ids[1]).map_or(0, |k| k.landmarks.iter().flatten().count());
    assert_eq!(held(after), held(&before));
    let (_, prior) = after.maps().last().expect("the new map");
    assert!(prior.is_some(), "the new map knows where it began");
}

#[test]
fn a_rescale_request_changes_the_lengths_of_its_map_alone() {
    let world = World::around(mono(), 63);
    let path = sideways(4, 0.2);
    let (mut atlas, first) = world.exact_map(&path);
    let views = world.walk(&path, 10.0, 0.5);
    let second = world.map(&mut atlas, &views, &path, None, |_| Sim3::identity());
    let map = MapId(second[0]);
    let prior = MapPrior {
        to: first[3],
        to_from_root: Se3::identity(),
        sigma: 1.0,
        sigma_rad: 0.1,
        sigma_log_scale: 0.5,
    };
    atlas.commit(vec![Change::MapPrior(map, prior)]);
    let before = atlas.latest().clone();
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let view = world.see(&pose(0.65, 0.0, 0.0), 12.0);
    let at = pose(0.65, 0.0, 0.0);
    submit(&mut mapper, &mut atlas, &world, &view, &at, |s| {
        (s.orientation_only, s.rescale) = (true, Some((2.0, 0.2)));
    });
    let x = |s: &Snapshot, id: KeyFrameId| s.key_frame(id).expect("there").world_from_camera.translation.x;
    for (n, id) in second.iter().enumerate() {
        assert!((x(atlas.latest(), *id) - 0.4 * n as f64).abs() < 1e-9);
    }
    assert!(first.iter().all(|id| x(atlas.latest(), *id) == x(&before, *id)));
    let newest = atlas.latest().newest_key_frame().expect("there").id;
    assert!((x(atlas.latest(), newest) - 1.3).abs() < 1e-9, "the new key frame too");
    for l in before.landmarks() {
        let own = before.key_frame(l.observations[0].key_frame).expect("there").map == map;
        let factor = if own { 2.0 } else { 1.0 };
        let now = atlas.latest().landmark(l.id).map(|l| l.position);
        assert!(now.is_none_or(|now| (now - l.position * factor).norm() < 1e-9));
    }
    let (_, prior) = atlas.latest().maps().find(|(id, _)| *id == map).expect("there");
    assert_eq!(prior.map(|p| p.sigma_log_scale), Some(0.2));
}

#[test]
fn a_key_frame_for_orientation_only_triangulates_and_adjusts_nothing() {
    let world = World::around(mono(), 64);
    let (mut atlas, _) = world.exact_map(&sideways(3, 0.3));
    remove(&mut atlas, |id| id.index() % 2 == 0);
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let at = pose(0.9, 0.0, 0.0);
    let view = world.see(&at, 3.0);
    let mut other = Atlas::new((**atlas.latest()).clone());
    let only = submit(&mut mapper, &mut other, &world, &view, &at, |s| s.orientation_only = true);
    assert!(only.created == 0 && only.adjustment.is_none(), "{only:?}");
    let usual = submit(&mut mapper, &mut atlas, &world, &view, &at, |_| ());
    assert!(usual.created > 20 && usual.adjustment.is_some(), "{usual:?}");
}

#[test]
fn note_of_landmarks_that_are_not_found_has_them_culled() {
    let world = World::around(stereo(), 69);
    let path = sideways(4, 0.15);
    let views = world.walk(&path, 0.0, 0.5);
    let left = |noted: usize| {
        let mut mapper = Mapper::new(world.camera, MapperConfig::default());
        let mut atlas = Atlas::new(Snapshot::new());
        mapper.start(&mut atlas, &views[0].frame, &MapStart::default());
        let first = submit(&mut mapper, &mut atlas, &world, &views[1], &path[1], |_| ());
        let new: Vec<LandmarkId> = (atlas.latest().landmarks())
            .filter(|l| l.observations[0].key_frame == first.key_frame)
            .map(|l| l.id)
            .collect();
        assert!(!new.is_empty());
        (0..noted).for_each(|_| mapper.note(&new.iter().map(|id| (*id, false)).collect::<Vec<_>>()));
        submit(&mut mapper, &mut atlas, &world, &views[2], &path[2], |_| ());
        new.iter().filter(|id| atlas.latest().landmark(**id).is_some()).count()
    };
    assert!(left(0) > 0 && left(10) == 0, "{} {}", left(0), left(10));
}

#[test]
fn a_step_fuses_the_landmarks_of_two_visits_that_its_key_frame_shows() {
    let world = World::around(stereo(), 70);
    let (mut atlas, [first, second]) = visited_twice(&world, &Sim3::identity());
    let at = pose(0.25, 0.0, 0.0);
    let view = world.see(&at, 20.0);
    // Every other feature was matched with the landmark of the first visit, the rest with those of the second.
    let shown_by = |k: KeyFrameId, point: usize| {
        let k = atlas.latest().key_frame(k).expect("there");
        let feature = k.frame.descriptors.iter().position(|d| *d == view.frame.descriptors[point])?;
        k.landmarks[feature]
    };
    let matched: Vec<Option<LandmarkId>> =
        (0..view.frame.len()).map(|n| shown_by([first[1], second[1]][n % 2], n)).collect();
    let before = atlas.latest().landmark_count();
    let input = KeyFrameInput {
        frame: &view.frame,
        landmarks: &matched,
        reference: second[1],
        reference_from_camera: atlas.latest().anchor(second[1], &at).expect("there"),
        imu: None,
        orientation_only: false,
        rescale: None,
        motion: None,
        by_depth: false,
    };
    let mut mapper = Mapper::new(world.camera, MapperConfig::default());
    let mapped = mapper.step(&mut atlas, &input, || false).expect("a key frame");
    let fewer = (before + mapped.created) - atlas.latest().landmark_count();
    assert!(fewer > 150, "{fewer} fewer of {before}");
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 5e-3);
}

#[test]
fn final_adjustment_straightens_a_map_that_drifted_and_leaves_one_that_is_too_large() {
    let world = World::around(stereo(), 72);
    let path: Vec<Se3> = (0..8).map(|n| pose(0.15 * f64::from(n), 0.0, 0.04 * f64::from(n))).collect();
    let views = world.walk(&path, 0.0, 0.5);
    let drift =
        |n: usize| Sim3 { translation: Vec3::new(0.004, -0.002, 0.003) * n as f64, ..Sim3::identity() };
    for (most, adjusted) in [(2000, true), (7, false)] {
        let mut atlas = Atlas::new(Snapshot::new());
        let ids = world.map(&mut atlas, &views, &path, None, drift);
        let config = MapperConfig { final_adjustment_key_frames: most, ..MapperConfig::default() };
        Mapper::new(world.camera, config).final_adjustment(&mut atlas, || false);
        let k = atlas.latest().key_frame(ids[7]).expect("there");
        let metres = off(&k.world_from_camera, &path[7]).0;
        assert_eq!(metres < 2e-3, adjusted, "{metres} m");
    }
}
