//! The mapping stage on synthetic maps: one test for each of its steps.

use crate::cull::{RecentLandmarks, redundant};
use crate::fuse::{around, fuse_into};
use crate::imu_walk::NOISE;
use crate::insert::{Entry, NewLandmarks, add_key_frame, points_from_depth};
use crate::rotation_only::landmarks_by_rotation;
use crate::synthetic::{World, mono, pose, sideways, stereo};
use crate::triangulation::create_landmarks;
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{
    Atlas, Change, ImuFactor, InertialState, KeyFrame, KeyFrameId, LandmarkId, MapId, Observation, Snapshot,
};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::ImuSample;
use cairn_solve::to_end;
use cairn_vision::{RectifiedCamera, SensorMode};
use std::collections::{BTreeMap, BTreeSet};

/// Asserts that every landmark lies at the true point it shows, and shows that point alone.
pub(crate) fn assert_exact(world: &World, snapshot: &Snapshot, world_from_map: &Sim3, metres: f64) {
    snapshot.check().expect("a sound map");
    for l in snapshot.landmarks() {
        let truth = world.point_of(snapshot, l.id).expect("a point");
        let error = (*world_from_map * l.position - truth).norm();
        assert!(error < metres, "{:?} is {error} m off, {} observations", l.id, l.observations.len());
        let look = |n: usize| {
            let o = l.observations[n];
            snapshot.key_frame(o.key_frame).expect("shown").frame.descriptors[o.feature as usize]
        };
        assert!((1..l.observations.len()).all(|n| look(n) == look(0)), "{:?} mixes points", l.id);
    }
}

/// Removes the landmarks that fulfil the condition.
pub(crate) fn remove(atlas: &mut Atlas, which: impl Fn(LandmarkId) -> bool) {
    let ids: Vec<LandmarkId> = atlas.latest().landmarks().map(|l| l.id).filter(|id| which(*id)).collect();
    atlas.commit(ids.into_iter().map(Change::RemoveLandmark).collect());
}

#[test]
fn add_key_frame_inserts_it_with_its_observations_and_its_words() {
    let world = World::around(stereo(), 51);
    let (mut atlas, ids) = world.exact_map(&sideways(2, 0.2));
    let at = pose(0.4, 0.0, 0.0);
    let view = world.see(&at, 1.0);
    let observed = world.matches(atlas.latest(), &view);
    let id = atlas.latest().next_key_frame_id();
    let entry = Entry { id, frame: &view.frame, world_from_camera: at, observed: &observed, motion: None };
    assert_eq!(atlas.commit(add_key_frame(&entry, Some(ids[1]))).dropped, 0);
    let k = atlas.latest().key_frame(id).expect("inserted");
    assert_eq!((k.parent, k.world_from_camera, &k.landmarks), (Some(ids[1]), at, &observed));
    assert!(!k.bag.is_empty());
    assert_eq!(k.covisible.len(), 2);
}

#[test]
fn points_from_depth_are_the_close_ones_and_the_nearest_up_to_the_least() {
    let world = World::around(stereo(), 52);
    let atlas = Atlas::new(Snapshot::new());
    let at = pose(0.3, -0.2, 0.4);
    let view = world.see(&at, 0.0);
    let frame = &view.frame;
    let close = frame.depth.iter().filter(|d| f64::from(**d) <= world.camera.close_depth).count();
    assert!(close > 50 && close < frame.len());
    let nothing = vec![None; frame.len()];
    for (least, expected) in [(0, close), (close + 20, close + 20), (usize::MAX, frame.len())] {
        let mut new = NewLandmarks::after(atlas.latest());
        let id = atlas.latest().next_key_frame_id();
        let entry = Entry { id, frame, world_from_camera: at, observed: &nothing, motion: None };
        let mut changes = add_key_frame(&entry, None);
        changes.extend(points_from_depth(atlas.latest(), &world.camera, &entry, least, &mut new));
        let mut atlas = Atlas::new(Snapshot::new());
        assert_eq!(atlas.commit(changes).dropped, 0);
        assert_eq!(atlas.latest().landmark_count(), expected);
        assert_exact(&world, atlas.latest(), &Sim3::identity(), 1e-4);
    }
}

#[test]
fn create_landmarks_triangulates_the_true_positions_with_two_neighbours() {
    let world = World::around(mono(), 53);
    let (mut atlas, ids) = world.exact_map(&sideways(3, 0.3));
    let every = atlas.latest().landmark_count();
    // Half of the points are not in the map yet.
    remove(&mut atlas, |id| id.index() % 2 == 0);
    let before = atlas.latest().landmark_count();
    let mut new = NewLandmarks::after(atlas.latest());
    let changes = to_end(create_landmarks(atlas.latest(), &world.camera, ids[2], 10, &mut new, || false));
    assert_eq!(atlas.commit(changes).dropped, 0);
    let created = atlas.latest().landmark_count() - before;
    assert_eq!(created, new.ids.len());
    assert!(created * 10 > (every - before) * 7, "{created} of {}", every - before);
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 2e-3);
    let neighbours: BTreeSet<KeyFrameId> = (new.ids.iter())
        .map(|id| atlas.latest().landmark(*id).expect("created").observations[0].key_frame)
        .collect();
    assert!(neighbours.is_subset(&ids[..2].iter().copied().collect()), "{neighbours:?}");
}

/// A camera with another focal length, image centre and size than [`mono`].
fn other_mono() -> RectifiedCamera {
    let bounds = [0.0, 0.0, 500.0, 400.0];
    RectifiedCamera { fx: 300.0, fy: 310.0, cx: 240.0, cy: 215.0, bounds, ..mono() }
}

/// A map that [`mono`] made, in an atlas of [`other_mono`], which adds a key frame: that with its observations.
fn continued_by_another_camera(seed: u64, removed: usize) -> (World, Atlas, KeyFrameId, usize) {
    let (mut world, path) = (World::around(mono(), seed), sideways(4, 0.3));
    let (atlas, ids) = world.exact_map(&path[..3]);
    let about = About { program: String::new(), sensor: SensorMode::Mono, camera: world.camera };
    let file = MapFile { snapshot: (**atlas.latest()).clone(), about, attached: BTreeMap::new() };
    world.camera = other_mono();
    let mut atlas = Atlas::new(file.in_atlas_with(SensorMode::Mono, &world.camera, 0.0).snapshot);
    let every = atlas.latest().landmark_count();
    remove(&mut atlas, |id| id.index() % removed == 0);
    let view = world.see(&path[3], 10.0);
    let (id, observed) = (atlas.latest().next_key_frame_id(), world.matches(atlas.latest(), &view));
    let entry =
        Entry { id, frame: &view.frame, world_from_camera: path[3], observed: &observed, motion: None };
    assert_eq!(atlas.commit(add_key_frame(&entry, Some(ids[2]))).dropped, 0);
    (world, atlas, id, every)
}

#[test]
fn create_landmarks_triangulates_between_key_frames_of_two_cameras() {
    let (world, mut atlas, id, every) = continued_by_another_camera(57, 2);
    let before = atlas.latest().landmark_count();
    let mut new = NewLandmarks::after(atlas.latest());
    let changes = to_end(create_landmarks(atlas.latest(), &world.camera, id, 10, &mut new, || false));
    assert_eq!(atlas.commit(changes).dropped, 0);
    let created = atlas.latest().landmark_count() - before;
    assert!(created * 2 > every - before, "{created} of {}", every - before);
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 2e-3);
    for id in new.ids {
        let l = atlas.latest().landmark(id).expect("created");
        let is_other =
            |o: &Observation| atlas.latest().key_frame(o.key_frame).unwrap().other_camera.is_some();
        assert_eq!(l.observations.iter().filter(|o| is_other(o)).count(), 1, "{:?}", l.observations);
    }
}

#[test]
fn fuse_into_a_key_frame_of_another_camera_finds_the_points_where_that_one_shows_them() {
    let (world, mut atlas, id, _) = continued_by_another_camera(58, 1_000_000);
    let shown: Vec<LandmarkId> =
        atlas.latest().key_frame(id).unwrap().landmarks.iter().flatten().copied().collect();
    let there = KeyFrameId::FIRST;
    let missing = |snapshot: &Snapshot| {
        let of = |l: &&LandmarkId| snapshot.landmark(**l).is_some_and(|l| l.feature_in(there).is_none());
        shown.iter().filter(of).count()
    };
    let taken: Vec<Change> = (shown.iter().step_by(2))
        .filter(|l| atlas.latest().landmark(**l).unwrap().feature_in(there).is_some())
        .map(|l| Change::Forget(*l, there))
        .collect();
    let took = taken.len();
    atlas.commit(taken);
    let before = missing(atlas.latest());
    let snapshot = atlas.latest().clone();
    let target = snapshot.key_frame(there).expect("the first");
    atlas.commit(fuse_into(&snapshot, &world.camera, &shown, target));
    let found = before - missing(atlas.latest());
    assert!(took > 30 && found * 10 > took * 9, "{found} of {took}");
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 1e-4);
}

#[test]
fn create_landmarks_triangulates_nothing_without_a_baseline() {
    let world = World::around(mono(), 54);
    let (mut atlas, ids) = world.exact_map(&sideways(3, 0.002));
    remove(&mut atlas, |id| id.index() % 2 == 0);
    let mut new = NewLandmarks::after(atlas.latest());
    let changes = to_end(create_landmarks(atlas.latest(), &world.camera, ids[2], 10, &mut new, || false));
    assert!(changes.is_empty());
}

/// One map in which each place was visited twice, with separate landmarks each time.
pub(crate) fn visited_twice(world: &World, map_from_world: &Sim3) -> (Atlas, [Vec<KeyFrameId>; 2]) {
    let path = sideways(3, 0.2);
    let (mut atlas, first) = world.exact_map(&path);
    let views = world.walk(&path, 10.0, 0.5);
    let second = world.map(&mut atlas, &views, &path, first.last().copied(), |_| *map_from_world);
    (atlas, [first, second])
}

#[test]
fn around_are_the_neighbours_and_theirs_without_the_centre() {
    let world = World::around(stereo(), 54);
    let (atlas, ids) = world.exact_map(&sideways(8, 0.4));
    let snapshot = atlas.latest();
    let near = around(snapshot, ids[0], 2);
    assert!(near.contains(&ids[1]) && !near.contains(&ids[0]), "{near:?}");
    assert!(!near.contains(&ids[7]), "{near:?}");
    let direct: Vec<KeyFrameId> =
        snapshot.key_frame(ids[0]).unwrap().covisible.iter().take(2).map(|(id, _)| *id).collect();
    assert!(direct.iter().all(|id| near.contains(id)) && near.len() > direct.len(), "{near:?} of {direct:?}");
    assert!(around(snapshot, KeyFrameId::from_index(99).unwrap(), 2).is_empty());
}

#[test]
fn fuse_into_joins_duplicates_of_a_point() {
    let world = World::around(stereo(), 55);
    let (mut atlas, [first, second]) = visited_twice(&world, &Sim3::identity());
    let before = atlas.latest().landmark_count();
    let mine: Vec<LandmarkId> =
        atlas.latest().key_frame(second[1]).expect("there").landmarks.iter().flatten().copied().collect();
    let target = atlas.latest().key_frame(first[1]).expect("there");
    let changes = fuse_into(atlas.latest(), &world.camera, &mine, target);
    assert!(changes.iter().all(|c| matches!(c, Change::Fuse(..))));
    assert_eq!(atlas.commit(changes).dropped, 0);
    let fused = before - atlas.latest().landmark_count();
    assert!(fused * 10 > mine.len() * 9, "{fused} of {}", mine.len());
    assert_exact(&world, atlas.latest(), &Sim3::identity(), 1e-4);
    let both = around(atlas.latest(), second[1], 10);
    assert!(first.iter().all(|id| both.contains(id)), "the visits share landmarks now: {both:?}");
}

#[test]
fn fuse_into_leaves_alone_what_lies_elsewhere() {
    let world = World::around(stereo(), 56);
    let aside = Sim3 { translation: Vec3::new(0.3, 0.0, 0.0), ..Sim3::identity() };
    let (atlas, [first, second]) = visited_twice(&world, &aside);
    let mine: Vec<LandmarkId> =
        atlas.latest().key_frame(second[1]).expect("there").landmarks.iter().flatten().copied().collect();
    let target = atlas.latest().key_frame(first[1]).expect("there");
    assert!(fuse_into(atlas.latest(), &world.camera, &mine, target).is_empty());
}

#[test]
fn recent_landmarks_that_are_not_found_again_are_culled() {
    let world = World::around(stereo(), 57);
    let (atlas, ids) = world.exact_map(&sideways(3, 0.2));
    let of = |views: usize| {
        let l = atlas.latest().landmarks().find(|l| l.observations.len() == views);
        l.expect("a landmark").id
    };
    let [once, twice, thrice] = [of(1), of(2), of(3)];
    let removed = |recent: &mut RecentLandmarks, now: KeyFrameId, depth: bool| -> Vec<LandmarkId> {
        let changes = recent.cull(atlas.latest(), now, depth);
        let id = |c: Change| match c {
            Change::RemoveLandmark(id) => id,
            other => panic!("{other:?}"),
        };
        changes.into_iter().map(id).collect()
    };
    let mut recent = RecentLandmarks::default();
    recent.admit(&[once, twice, thrice], ids[0]);
    // Found in one of five frames that should see it: less than a quarter.
    recent.note(&[(thrice, false); 4]);
    recent.note(&[(twice, false), (twice, false), (twice, true)]);
    assert_eq!(removed(&mut recent, ids[1], true), [thrice]);
    assert_eq!(removed(&mut recent, ids[2], true), [once], "one view is too few after two key frames");
    let mut recent = RecentLandmarks::default();
    recent.admit(&[once, twice, thrice], ids[0]);
    let culled = BTreeSet::from_iter(removed(&mut recent, ids[2], false));
    assert_eq!(culled, BTreeSet::from([once, twice]), "without depth three views are needed");
    // A landmark that has lasted three key frames is no longer tentative.
    let later = KeyFrameId::from_index(3).expect("an id");
    assert!(removed(&mut recent, later, false).is_empty());
    recent.note(&[(thrice, false); 100]);
    assert!(removed(&mut recent, later, false).is_empty());
}

#[test]
fn redundant_key_frame_is_one_whose_landmarks_three_others_see() {
    let world = World::around(stereo(), 58);
    let (mut atlas, ids) = world.exact_map(&sideways(6, 0.02));
    let found = redundant(atlas.latest(), &world.camera, ids[5], 0.9);
    let Some(Change::RemoveKeyFrame(id)) = found else { panic!("{found:?}") };
    assert!(id != ids[0] && id != ids[5], "neither the root nor the newest: {id:?}");
    let landmarks = atlas.latest().landmark_count();
    atlas.commit(found.into_iter().collect());
    atlas.latest().check().expect("a sound map");
    assert!(atlas.latest().key_frame(id).is_none() && landmarks - atlas.latest().landmark_count() < 5);
    // Key frames that each show a new part of the world are all needed.
    let turning: Vec<Se3> = (0..6).map(|n| pose(0.0, 0.0, 0.5 * f64::from(n))).collect();
    let (atlas, ids) = world.exact_map(&turning);
    assert!(redundant(atlas.latest(), &world.camera, ids[5], 0.9).is_none());
}

/// A map whose landmarks are seen on either side of one key frame, and in it: a few throughout, most on one side. Each of
/// the others has some that it alone sees.
fn linked_by(world: &World, link: usize, count: usize) -> (Atlas, Vec<KeyFrameId>) {
    let (seen, ids) = world.exact_map(&sideways(count, 0.02));
    let seen = seen.latest();
    let mut changes = Vec::new();
    for k in seen.key_frames() {
        let k = KeyFrame::new(k.id, k.frame.shared(), k.world_from_camera, k.parent);
        changes.push(Change::AddKeyFrame(Box::new(k)));
    }
    for (n, l) in seen.landmarks().enumerate() {
        let (first, last) = match n % 10 {
            0 => (0, count),
            1..=3 => (0, link + 1),
            4..=6 => (link, count),
            _ if n / 10 % count == link => (0, 0),
            _ => (n / 10 % count, n / 10 % count + 1),
        };
        changes.push(Change::AddLandmark(l.id, l.position));
        let kept = l.observations.iter().filter(|o| ids[first..last].contains(&o.key_frame));
        changes.extend(kept.map(|o| Change::Observe(l.id, o.key_frame, o.feature)));
    }
    let mut atlas = Atlas::new(Snapshot::with_octaves(seen.octaves()));
    assert_eq!(atlas.commit(changes).dropped, 0);
    (atlas, ids)
}

#[test]
fn redundant_key_frame_stays_where_one_camera_hands_on_its_scale_over_it() {
    let link = 4;
    let culled = |camera: RectifiedCamera| {
        let world = World::around(camera, 69);
        let (atlas, ids) = linked_by(&world, link, 9);
        let found = redundant(atlas.latest(), &world.camera, ids[8], 0.95);
        let Some(Change::RemoveKeyFrame(id)) = found else { return None };
        ids.iter().position(|other| *other == id)
    };
    assert_eq!(culled(mono()), None);
    // With depth each key frame has metres of its own.
    assert_eq!(culled(stereo()), Some(link));
}

/// Two key frames with parallax, then two at the same place that look far aside; only the first two have landmarks.
fn turned(world: &World) -> (Atlas, Vec<KeyFrameId>, Vec<Se3>) {
    let path = vec![pose(0.0, 0.0, 0.0), pose(0.3, 0.0, 0.0), pose(0.3, 0.0, 1.1), pose(0.3, 0.0, 1.15)];
    let (mut atlas, ids) = world.exact_map(&path);
    let early = |id| {
        let l = atlas.latest().landmark(id).expect("there");
        l.observations[0].key_frame == ids[0]
    };
    let late: BTreeSet<LandmarkId> =
        atlas.latest().landmarks().map(|l| l.id).filter(|id| !early(*id)).collect();
    remove(&mut atlas, |id| late.contains(&id));
    (atlas, ids, path)
}

#[test]
fn landmarks_by_rotation_lie_in_the_true_directions() {
    let world = World::around(mono(), 59);
    let (mut atlas, ids, path) = turned(&world);
    let k = atlas.latest().key_frame(ids[3]).expect("there");
    let known = k.landmarks.iter().flatten().count();
    assert!(known >= 5 && 5 * known < k.frame.len(), "{known} of {}", k.frame.len());
    let mut new = NewLandmarks::after(atlas.latest());
    let changes = landmarks_by_rotation(atlas.latest(), &world.camera, ids[3], &mut new);
    assert_eq!(atlas.commit(changes).dropped, 0);
    assert!(new.ids.len() > 80, "{}", new.ids.len());
    for id in &new.ids {
        let l = atlas.latest().landmark(*id).expect("created");
        let truth = world.point_of(atlas.latest(), *id).expect("a point");
        let ray = |p: &Vec3| (p - path[3].translation).normalize();
        assert!((ray(&l.position) - ray(&truth)).norm() < 1e-5);
        let depth = (path[3].inverse() * l.position).z;
        assert!((1.0..8.0).contains(&depth), "{depth}");
        assert_eq!(l.observations.len(), 2);
    }
}

#[test]
fn landmarks_by_rotation_are_not_made_of_views_with_a_baseline() {
    let world = World::around(mono(), 60);
    let (mut atlas, ids, path) = turned(&world);
    let aside = Se3::new(path[3].rotation, path[3].translation + Vec3::new(0.5, 0.0, 0.0));
    atlas.commit(vec![Change::MoveKeyFrame(ids[3], aside)]);
    let mut new = NewLandmarks::after(atlas.latest());
    assert!(landmarks_by_rotation(atlas.latest(), &world.camera, ids[3], &mut new).is_empty());
}

/// The key frames of an exact map again, each with readings from the one before.
fn with_factors(seen: &Snapshot, ids: &[KeyFrameId]) -> Atlas {
    let mut changes = Vec::new();
    for (n, id) in ids.iter().enumerate() {
        let k = seen.key_frame(*id).expect("there");
        let imu_factor = n.checked_sub(1).map(|before| {
            let since = seen.key_frame(ids[before]).expect("there");
            let reading = |i: i64| {
                let stamp = since.stamp.plus_seconds(i as f64 * (k.stamp - since.stamp) / 10.0);
                ImuSample::new(stamp, Vec3::zeros(), Vec3::y() * -9.8)
            };
            let sum = Preintegrated::of(NOISE, Bias::default(), (0..=10).map(reading).collect());
            ImuFactor { since: since.id, sum: sum.into() }
        });
        let mut again = KeyFrame::new(k.id, k.frame.shared(), k.world_from_camera, k.parent);
        again.motion = Some(InertialState {
            velocity: Vec3::zeros(),
            bias: Bias::default(),
            still_sigma: None,
            imu_factor,
        });
        changes.push(Change::AddKeyFrame(Box::new(again)));
    }
    for l in seen.landmarks() {
        changes.push(Change::AddLandmark(l.id, l.position));
        changes.extend(l.observations.iter().map(|o| Change::Observe(l.id, o.key_frame, o.feature)));
    }
    let mut atlas = Atlas::new(Snapshot::new());
    assert_eq!(atlas.commit(changes).dropped, 0);
    atlas
}

#[test]
fn redundant_key_frame_stays_where_it_keeps_imu_factors_short() {
    let world = World::around(stereo(), 66);
    let (seen, ids) = world.exact_map(&sideways(6, 0.02));
    assert!(redundant(seen.latest(), &world.camera, ids[5], 0.9).is_some());
    // Half a second from key frame to key frame: without one of them a factor would span a second, which is too long before
    // gravity is known.
    let atlas = with_factors(seen.latest(), &ids);
    assert!(redundant(atlas.latest(), &world.camera, ids[5], 0.9).is_none());
}

#[test]
fn create_landmarks_with_key_frames_that_only_readings_link() {
    let world = World::around(mono(), 67);
    let path = sideways(4, 0.3);
    let (seen, ids) = world.exact_map(&path);
    let mut atlas = with_factors(seen.latest(), &ids);
    // Nothing is shared any more.
    remove(&mut atlas, |_| true);
    let created = |atlas: &Atlas| {
        let mut new = NewLandmarks::after(atlas.latest());
        to_end(create_landmarks(atlas.latest(), &world.camera, ids[3], 10, &mut new, || false));
        new.ids.len()
    };
    assert_eq!(created(&atlas), 0, "without gravity, nothing tells the baseline");
    atlas.commit(vec![Change::AlignGravity(MapId(ids[0]), Sim3::identity())]);
    assert!(created(&atlas) > 50, "{}", created(&atlas));
}

#[test]
fn create_landmarks_takes_no_stereo_pair_nearer_than_its_own_baseline() {
    let world = World::around(stereo(), 68);
    let created = |step: f64| {
        let (mut atlas, ids) = world.exact_map(&sideways(2, step));
        remove(&mut atlas, |id| id.index() % 2 == 0);
        let mut new = NewLandmarks::after(atlas.latest());
        to_end(create_landmarks(atlas.latest(), &world.camera, ids[1], 10, &mut new, || false));
        new.ids.len()
    };
    let own = world.camera.baseline_fx / world.camera.fx;
    assert_eq!(created(0.9 * own), 0);
    assert!(created(1.5 * own) > 50);
}
