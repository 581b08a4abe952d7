//! Poses of key frames relative to each other, as depth tells them, in adjustments of whole maps.

use crate::synthetic as common;

use cairn_adjust::{RelativePoseFactors, Window, WindowConfig};
use cairn_atlas::{Atlas, Change, KeyFrameId, RelativePose};
use cairn_geometry::{Manifold, Se3};
use common::{World, off, pose, sideways, stereo};
use nalgebra::{Matrix6, SVector, Vector6};

/// Between each and the next, exact, without information along one axis.
fn chain(path: &[Se3], ids: &[KeyFrameId], free: Option<usize>) -> Vec<RelativePose> {
    let mut information = Vector6::repeat(1e6);
    if let Some(axis) = free {
        information[axis] = 0.0;
    }
    let information = Matrix6::from_diagonal(&information);
    let of = |n: usize| RelativePose {
        from: ids[n],
        from_from_here: path[n].inverse() * path[n + 1],
        information,
    };
    (0..path.len() - 1).map(of).collect()
}

fn adjust(world: &World, atlas: &mut Atlas, ids: &[KeyFrameId], aligned: &[RelativePose]) {
    let config = WindowConfig { iterations: [20, 20], tolerance: 1e-12, ..WindowConfig::default() };
    let map = atlas.latest().key_frame(ids[0]).expect("a key frame").map;
    let of = |(z, id): (&RelativePose, &KeyFrameId)| Change::RelativePoses(*id, vec![*z]);
    assert_eq!(atlas.commit(aligned.iter().zip(&ids[1..]).map(of).collect()).dropped, 0);
    let window = Window::of(atlas.latest(), &world.camera).add(RelativePoseFactors::default());
    let whole = window.whole(map).expect("a map");
    assert_eq!(atlas.commit(whole.solve(&config, || false).changes.changes).dropped, 0);
}

fn at(atlas: &Atlas, id: KeyFrameId) -> Se3 {
    atlas.latest().key_frame(id).expect("a key frame").world_from_camera
}

#[test]
fn key_frames_that_no_landmark_relates_lie_to_each_other_as_depth_says() {
    let world = World::empty(stereo());
    let path: Vec<Se3> = (0..5).map(|n| pose(0.2 * f64::from(n), 0.1, 0.3 * f64::from(n))).collect();
    let error = SVector::from([0.03, -0.02, 0.01, 0.02, -0.04, 0.01]);
    for free in [None, Some(1)] {
        let (mut atlas, ids) = world.exact_map(&path);
        let moved = path[4].retract(&error);
        atlas.commit(vec![Change::MoveKeyFrame(ids[4], moved)]);
        adjust(&world, &mut atlas, &ids, &chain(&path, &ids, free));
        let left = path[4].local(&at(&atlas, ids[4]));
        // Where nothing is known it stays within what it was off.
        assert!(left[1].abs() < if free.is_some() { 0.025 } else { 1e-6 }, "{free:?}: {left}");
        let others = [0, 2, 3, 4, 5].map(|i| left[i].abs()).into_iter().fold(0.0, f64::max);
        assert!(others < 1e-6, "{free:?}: {left}");
    }
}

#[test]
fn a_wrong_alignment_is_left_out_where_landmarks_contradict_it() {
    let path = sideways(5, 0.15);
    let world = World::around(stereo(), 9);
    let (mut atlas, ids) = world.exact_map(&path);
    let mut aligned = chain(&path, &ids, None);
    aligned[2].from_from_here = aligned[2].from_from_here * pose(0.1, 0.05, 0.05);
    adjust(&world, &mut atlas, &ids, &aligned);
    let worst = ids.iter().zip(&path).map(|(id, truth)| off(&at(&atlas, *id), truth).0).fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst} m");
}
