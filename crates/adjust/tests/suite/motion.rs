//! Motions that wheels measured between key frames hold them where nothing, or something that moves, is seen.

use crate::synthetic as common;

use cairn_adjust::{MotionLinks, MotionSince, Window, WindowConfig};
use cairn_atlas::{Atlas, Change, KeyFrameId};
use cairn_geometry::{Manifold, Se3};
use cairn_sensor::Stamp;
use common::{World, off, pose, sideways, stereo};
use nalgebra::SVector;

const SIGMA: f64 = 0.005;

fn links(path: &[Se3], ids: &[KeyFrameId], sigma: f64) -> MotionLinks {
    let links = MotionLinks::default();
    for (ids, path) in ids.windows(2).zip(path.windows(2)) {
        let since = MotionSince::none(Stamp::from_seconds(0.0));
        links.insert(ids[0], ids[1], since.then(&(path[0].inverse() * path[1]), [sigma * sigma; 2]));
    }
    links
}

/// Adjusts the window around a key frame.
fn adjust(world: &World, atlas: &mut Atlas, centre: KeyFrameId, links: &MotionLinks) {
    let config = WindowConfig { iterations: [20, 20], tolerance: 1e-12, ..WindowConfig::default() };
    let window = Window::of(atlas.latest(), &world.camera).add(links.factors()).around(centre, &config);
    let result = window.expect("a window").solve(&config, || false);
    assert_eq!(atlas.commit(result.changes.changes).dropped, 0);
}

fn at(atlas: &Atlas, id: KeyFrameId) -> Se3 {
    atlas.latest().key_frame(id).expect("a key frame").world_from_camera
}

#[test]
fn a_key_frame_that_sees_nothing_lies_where_the_wheels_led_also_past_one_that_was_culled() {
    let world = World::empty(stereo());
    let path: Vec<Se3> = (0..5).map(|n| pose(0.2 * f64::from(n), 0.1, 0.3 * f64::from(n))).collect();
    let (mut atlas, ids) = world.exact_map(&path);
    let links = links(&path, &ids, SIGMA);
    let error = SVector::from([0.3, -0.2, 0.1, 0.2, -0.4, 0.1]);
    for culled in [false, true] {
        if culled {
            atlas.commit(vec![Change::RemoveKeyFrame(ids[3])]);
        }
        atlas.commit(vec![Change::MoveKeyFrame(ids[4], path[4].retract(&error))]);
        adjust(&world, &mut atlas, ids[4], &MotionLinks::default());
        assert!(off(&at(&atlas, ids[4]), &path[4]).0 > 0.3, "nothing but the links moves it");
        adjust(&world, &mut atlas, ids[4], &links);
        let (metres, radians) = off(&at(&atlas, ids[4]), &path[4]);
        assert!(metres < 1e-6 && radians < 1e-6, "{culled}: {metres} m, {radians} rad");
    }
}

#[test]
fn what_moves_does_not_turn_key_frames_away_from_where_the_wheels_led() {
    // The last three key frames were made while someone filled the view: by what they see, the camera turned along with him.
    let truth = sideways(6, 0.15);
    let seen: Vec<Se3> =
        (0..6).map(|n| truth[n] * pose(0.0, 0.0, 0.1 * n.saturating_sub(2) as f64)).collect();
    let world = World::around(stereo(), 7);
    let turned = |links: &MotionLinks| {
        let (mut atlas, ids) = world.exact_map(&seen);
        let back = (3..6).map(|n| Change::MoveKeyFrame(ids[n], truth[n])).collect();
        atlas.commit(back);
        adjust(&world, &mut atlas, ids[5], links);
        off(&at(&atlas, ids[5]), &truth[5]).1
    };
    let (_, ids) = world.exact_map(&seen);
    assert!(turned(&MotionLinks::default()) > 0.25, "without wheels what is seen is believed");
    let radians = turned(&links(&truth, &ids, SIGMA));
    assert!(radians < 0.02, "{radians} rad");
}

#[test]
fn poor_wheels_do_not_move_what_is_seen_well() {
    let path = sideways(6, 0.15);
    let world = World::around(stereo(), 8);
    let (mut atlas, ids) = world.exact_map(&path);
    // Each step 3 cm and 0.03 rad off, as their standard deviation says: 15 cm at the end.
    let off_by = 0.03;
    let wrong: Vec<Se3> = (0..6).map(|n| path[n] * pose(off_by * n as f64, 0.0, off_by * n as f64)).collect();
    adjust(&world, &mut atlas, ids[3], &links(&wrong, &ids, off_by));
    let worst = ids.iter().zip(&path).map(|(id, truth)| off(&at(&atlas, *id), truth).0).fold(0.0, f64::max);
    assert!(worst < 0.005, "{worst} m");
}

#[test]
fn in_a_whole_map_motions_count_between_key_frames_that_no_landmark_relates() {
    let path = sideways(5, 0.15);
    let error = SVector::from([0.3, -0.2, 0.1, 0.2, -0.4, 0.1]);
    let worst_off = |world: &World, measured: &[Se3], moved: Option<&SVector<f64, 6>>| {
        let (mut atlas, ids) = world.exact_map(&path);
        atlas.commit(moved.map(|by| Change::MoveKeyFrame(ids[4], path[4].retract(by))).into_iter().collect());
        let config = WindowConfig { iterations: [20, 20], tolerance: 1e-12, ..WindowConfig::default() };
        let map = atlas.latest().key_frame(ids[0]).expect("a key frame").map;
        let links = links(measured, &ids, SIGMA);
        let window = Window::of(atlas.latest(), &world.camera).add(links.factors());
        let whole = window.whole(map).expect("a map");
        atlas.commit(whole.solve(&config, || false).changes.changes);
        ids.iter().zip(&path).map(|(id, truth)| off(&at(&atlas, *id), truth).0).fold(0.0, f64::max)
    };
    let worst = worst_off(&World::empty(stereo()), &path, Some(&error));
    assert!(worst < 1e-6, "nothing but the motions relates them: {worst} m");
    // Each step 10 cm off, which what is seen contradicts.
    let wrong: Vec<Se3> = (0..5).map(|n| path[n] * pose(0.1 * n as f64, 0.0, 0.0)).collect();
    let worst = worst_off(&World::around(stereo(), 9), &wrong, None);
    assert!(worst < 1e-3, "what is seen relates them: {worst} m");
}
