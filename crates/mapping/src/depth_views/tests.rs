//! Depth of simulated walls, seen from key frames that share no landmark.

use super::*;
use cairn_atlas::{Atlas, Change, KeyFrame};
use cairn_geometry::{Manifold, So3, Vec3};
use cairn_sensor::Camera;
use nalgebra::Vector6;

/// Walls: unit normal and distance along it, metres.
pub(super) type Wall = (Vec3, f64);

pub(super) const CORNER: &[Wall] =
    &[(Vec3::new(0.0, 0.0, 1.0), 2.0), (Vec3::new(1.0, 0.0, 0.0), 0.9), (Vec3::new(0.0, 1.0, 0.0), 0.8)];

fn sensor() -> DepthSensor {
    DepthSensor {
        camera: Camera::pinhole(320, 240, 280.0, 280.0, 159.5, 119.5),
        body_from_depth: Se3::identity(),
        metres_per_unit: 1e-3,
        registered: true,
    }
}

/// How the sensor sits on the camera.
fn mount() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.02, -0.03, 0.01)), Vec3::new(0.05, 0.01, -0.02))
}

/// What the sensor sees from a pose of the camera.
fn seen(walls: &[Wall], world_from_camera: &Se3) -> Arc<DepthImage> {
    let (camera, pose) = (sensor().camera, *world_from_camera * mount());
    let mut image = DepthImage::new(camera.width, camera.height);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let ray = Vec3::new((x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy, 1.0);
            let along = pose.rotation * ray;
            let hits = walls.iter().map(|(n, d)| (d - n.dot(&pose.translation)) / n.dot(&along));
            let z = hits.filter(|z| *z > 0.0).fold(f64::INFINITY, f64::min);
            image.data_mut()[y * camera.width + x] = if z < 10.0 { (z * 1e3).round() as u16 } else { 0 };
        }
    }
    Arc::new(image)
}

/// A map of key frames without landmarks at poses, with what they saw from other ones.
pub(super) fn map(walls: &[Wall], truth: &[Se3], placed: &[Se3]) -> (Atlas, Vec<KeyFrameId>, DepthViews) {
    let views = DepthViews::new(&sensor(), mount()).expect("a sensor");
    let mut atlas = Atlas::new(Snapshot::new());
    let mut ids: Vec<KeyFrameId> = Vec::new();
    for (n, (truth, placed)) in truth.iter().zip(placed).enumerate() {
        let (id, stamp) = (atlas.latest().next_key_frame_id(), Stamp(n as i64));
        views.offer(stamp, seen(walls, truth));
        views.keep(id, stamp);
        let key_frame = KeyFrame::new(id, Arc::default(), *placed, ids.first().copied());
        atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
        ids.push(id);
    }
    (atlas, ids, views)
}

/// What is measured of a map that has no relative poses, with the key frames whose they are.
fn aligned(atlas: &Atlas, ids: &[KeyFrameId], views: &DepthViews) -> Vec<(KeyFrameId, RelativePose)> {
    of_changes(&views.measure(atlas.latest(), MapId(ids[0]), &mut || false))
}

fn of_changes(changes: &[Change]) -> Vec<(KeyFrameId, RelativePose)> {
    let of = |change: &Change| match change {
        Change::RelativePoses(id, all) => all.iter().map(|z| (*id, *z)).collect::<Vec<_>>(),
        other => panic!("{other:?}"),
    };
    changes.iter().flat_map(of).collect()
}

pub(super) fn viewpoints() -> Vec<Se3> {
    let at = |x: f64, y: f64, turn: f64| {
        Se3::new(So3::exp(&Vec3::new(-0.25, turn, 0.0)), Vec3::new(x, y, 0.1 * x))
    };
    vec![at(0.0, 0.0, 0.2), at(0.3, -0.1, 0.0), at(-0.2, 0.1, 0.3)]
}

/// By how much a map has drifted: 3 cm and a degree.
pub(super) fn drift() -> Vector6<f64> {
    Vector6::new(0.02, -0.015, 0.02, 0.01, -0.012, 0.008)
}

#[test]
fn in_a_corner_key_frames_find_how_they_lie_to_each_other() {
    let truth = viewpoints();
    let placed = [truth[0], truth[1].retract(&drift()), truth[2].retract(&(-drift()))];
    let (atlas, ids, views) = map(CORNER, &truth, &placed);
    let all = aligned(&atlas, &ids, &views);
    assert_eq!(all.len(), 3, "{all:?}");
    for (to, z) in &all {
        let [from, to] = [z.from, *to].map(|id| ids.iter().position(|i| *i == id).expect("of the map"));
        let off = (truth[from].inverse() * truth[to]).local(&z.from_from_here);
        assert!(off.fixed_rows::<3>(0).norm() < 0.002 && off.fixed_rows::<3>(3).norm() < 0.002, "{off}");
        let least = z.information.symmetric_eigenvalues().min();
        assert!(least > 1e4, "every direction to a centimetre: {least}");
        assert!(z.agrees(&truth[from], &truth[to]) && !z.agrees(&placed[from], &placed[to]));
    }
}

#[test]
fn before_a_wall_nothing_is_known_along_it() {
    let truth = viewpoints();
    let placed = [truth[0], truth[1].retract(&drift()), truth[2]];
    let (atlas, ids, views) = map(&CORNER[..1], &truth, &placed);
    let all = aligned(&atlas, &ids, &views);
    let (_, z) = all.iter().find(|(to, z)| [z.from, *to] == [ids[0], ids[1]]).expect("both see the wall");
    let values = z.information.symmetric_eigenvalues();
    assert_eq!(values.iter().filter(|v| **v > 1e3).count(), 3, "{values}");
    assert!(values.iter().filter(|v| v.abs() < 1.0).count() == 3, "{values}");
    // Along the wall it may be anywhere; across it is where it was.
    let slid = |by: Vec3| Se3::new(So3::identity(), by) * truth[1];
    assert!(z.agrees(&truth[0], &slid(Vec3::new(0.3, 0.2, 0.0))));
    assert!(!z.agrees(&truth[0], &slid(Vec3::new(0.0, 0.0, 0.02))));
}

#[test]
fn key_frames_that_look_elsewhere_or_are_gone_are_not_aligned() {
    let mut truth = viewpoints();
    truth.push(Se3::new(So3::exp(&Vec3::new(0.0, std::f64::consts::PI, 0.0)), Vec3::zeros()));
    let walls: Vec<Wall> = CORNER.iter().copied().chain([(Vec3::new(0.0, 0.0, -1.0), 2.0)]).collect();
    let (mut atlas, ids, views) = map(&walls, &truth, &truth);
    let of = |all: &[(KeyFrameId, RelativePose)], id| {
        all.iter().filter(|(to, z)| z.from == id || *to == id).count()
    };
    let all = aligned(&atlas, &ids, &views);
    assert_eq!((all.len(), of(&all, ids[3])), (3, 0));
    atlas.commit(vec![Change::RemoveKeyFrame(ids[2])]);
    views.drop_removed(atlas.latest());
    assert_eq!(views.kept().views.len(), 3);
    let all = aligned(&atlas, &ids, &views);
    assert_eq!((all.len(), of(&all, ids[2])), (1, 0));
    let none = of_changes(&views.measure(atlas.latest(), MapId(ids[0]), &mut || true));
    assert_eq!(none, all, "what is known is not aligned again");
    // Once the map has them, nothing changes; and it keeps them where the images are not here.
    atlas.commit(views.measure(atlas.latest(), MapId(ids[0]), &mut || false));
    assert!(aligned(&atlas, &ids, &views).is_empty());
    let elsewhere = DepthViews::new(&sensor(), mount()).expect("a sensor");
    assert!(aligned(&atlas, &ids, &elsewhere).is_empty());
}

/// A map whose unit of length was changed since: what depth measures stays in metres.
#[test]
fn depth_is_aligned_in_metres_whatever_the_unit_of_the_map() {
    let truth = viewpoints();
    let placed = [truth[0], truth[1].retract(&drift()), truth[2].retract(&(-drift()))];
    let (mut atlas, ids, views) = map(CORNER, &truth, &placed);
    let before = aligned(&atlas, &ids, &views);
    atlas.commit(vec![Change::Rescale(MapId(ids[0]), 1.25)]);
    let (_, _, views) = map(CORNER, &truth, &placed);
    let after = aligned(&atlas, &ids, &views);
    assert_eq!(before.len(), after.len());
    for ((_, was), (_, is)) in before.iter().zip(&after) {
        let off = was.from_from_here.local(&is.from_from_here);
        assert!(off.norm() < 1e-6, "{off}");
    }
    let closer = crate::Closer::new(crate::synthetic::stereo(), Default::default(), Default::default());
    atlas.commit(closer.with_depth_views(views).adjust_whole(atlas.latest(), MapId(ids[0]), || false));
    let at = |n: usize| atlas.latest().key_frame(ids[n]).expect("there").world_from_camera.translation;
    for n in 1..3 {
        let [is, was] = [(at(n) - at(0)).norm(), (truth[n].translation - truth[0].translation).norm()];
        assert!((is / was - 1.25).abs() < 0.01, "{is} {was}");
    }
}

#[test]
fn a_doubled_corner_is_one_after_the_adjustment_of_the_map() {
    let truth = viewpoints();
    let placed = [truth[0], truth[1].retract(&drift()), truth[2].retract(&(-drift()))];
    let (mut atlas, ids, views) = map(CORNER, &truth, &placed);
    let camera = crate::synthetic::stereo();
    let closer = crate::Closer::new(camera, Default::default(), Default::default());
    atlas.commit(closer.adjust_whole(atlas.latest(), MapId(ids[0]), || false));
    let worst = |atlas: &Atlas| {
        let pose = |n: usize| atlas.latest().key_frame(ids[n]).expect("there").world_from_camera;
        (0..3).map(|n| (pose(n).translation - truth[n].translation).norm()).fold(0.0, f64::max)
    };
    assert!(worst(&atlas) > 0.03, "without depth nothing relates them");
    let closer = closer.with_depth_views(views);
    atlas.commit(closer.adjust_whole(atlas.latest(), MapId(ids[0]), || false));
    assert!(worst(&atlas) < 0.003, "{}", worst(&atlas));
}

#[test]
fn depth_that_differs_from_what_landmarks_say_counts_for_less() {
    let truth = viewpoints();
    let (atlas, ids, views) = map(CORNER, &truth, &truth);
    // As if landmarks held them: enough pairs to tell.
    let of = |n: usize| pairs::Pair { from: ids[n % 2], to: ids[n % 2 + 1], shared: 80 };
    let shared: Vec<pairs::Pair> = (0..12).map(of).collect();
    let all = views.kept().views.clone();
    let information = |by: f64| {
        let mut moved = Atlas::new(Snapshot::clone(atlas.latest()));
        let step = |n: usize| Change::MoveKeyFrame(ids[n], truth[n].retract(&(drift() * by * n as f64)));
        moved.commit((1..3).map(step).collect());
        let all = views.aligner().align(moved.latest(), &all, &shared, &mut || false);
        all.iter().map(|(_, z)| z.information.trace()).sum::<f64>()
    };
    let [same, off, again] = [0.0, 1.0, 0.0].map(information);
    assert!(off < 0.3 * same, "{same} {off}");
    assert!(again < 0.3 * same, "the map follows it later, which proves nothing: {same} {again}");
}
