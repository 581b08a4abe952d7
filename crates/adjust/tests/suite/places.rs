//! The pose of one frame in a synthetic map: from given matches, and by recognising the place.

use crate::synthetic as common;

use cairn_adjust::{MatchFailure, RecogniseConfig, Recognised, View, has_parallax, locate, recognise};
use cairn_atlas::{Atlas, KeyFrameId, LandmarkId};
use cairn_geometry::Se3;
use common::{World, mono, off, pose, sideways, stereo};
use std::collections::BTreeSet;
use std::f64::consts::PI;

const CONFIG: RecogniseConfig = RecogniseConfig { seed: 20, need: 40, share: 0.5 };

/// What recognising the place of a key frame in a view gives, with no landmark known.
fn recognised(
    world: &World,
    atlas: &Atlas,
    view: &common::View,
    near: KeyFrameId,
    config: &RecogniseConfig,
) -> Result<Recognised, MatchFailure> {
    let view = View::new(&world.camera, &view.frame);
    recognise(atlas.latest(), &view, near, &BTreeSet::new(), config, 7)
}

#[test]
fn locate_finds_the_pose_and_names_wrong_matches() {
    for camera in [stereo(), mono()] {
        let world = World::around(camera, 11);
        let (atlas, _) = world.exact_map(&sideways(4, 0.2));
        let truth = pose(0.35, 0.1, 0.06);
        let view = world.see(&truth, 3.0);
        let mut matches = world.matches(atlas.latest(), &view);
        let known: Vec<usize> = (0..matches.len()).filter(|i| matches[*i].is_some()).collect();
        assert!(known.len() > 150, "{}", known.len());
        // Ten matches name the landmark of another feature.
        let right: Vec<Option<LandmarkId>> = matches.clone();
        for n in 0..10 {
            matches[known[n]] = right[known[n + 60]];
        }
        let found =
            locate(atlas.latest(), &world.camera, &view.frame, &pose(0.25, 0.0, 0.0), &matches, &[], None);
        let (metres, radians) = off(&found.world_from_camera, &truth);
        assert!(metres < 5e-4 && radians < 2e-4, "{metres} m, {radians} rad");
        assert!((0..10).all(|n| found.outliers.contains(&known[n])), "{:?}", found.outliers);
        assert_eq!(found.inliers, known.len() - found.outliers.len());
        assert!(found.outliers.len() <= 11, "{:?}", found.outliers);
    }
}

#[test]
fn recognise_accepts_the_right_place() {
    for camera in [stereo(), mono()] {
        let world = World::around(camera, 12);
        let (atlas, ids) = world.exact_map(&sideways(5, 0.2));
        let truth = pose(0.5, 0.3, -0.2);
        let view = world.see(&truth, 9.0);
        let place = recognised(&world, &atlas, &view, ids[2], &CONFIG).expect("the place is in the map");
        let (metres, radians) = off(&place.world_from_camera, &truth);
        assert!(metres < 1e-3 && radians < 5e-4, "{metres} m, {radians} rad");
        let truly = world.matches(atlas.latest(), &view);
        let mut agree = 0;
        for (found, truly) in place.landmarks.iter().zip(&truly) {
            assert!(found.is_none() || found == truly);
            agree += usize::from(found.is_some());
        }
        assert_eq!(place.inliers, agree);
        assert!(agree >= CONFIG.need && agree <= place.expected, "{agree} of {}", place.expected);
    }
}

#[test]
fn recognise_tells_how_few_features_of_another_world_look_alike() {
    let (world, other) = (World::around(stereo(), 13), World::around(stereo(), 14));
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    // Another world, and the other side of this one.
    for view in [other.see(&pose(0.2, 0.0, 0.0), 9.0), world.see(&pose(0.2, 0.0, PI), 9.0)] {
        let failure = recognised(&world, &atlas, &view, ids[1], &CONFIG).expect_err("not in the map");
        let MatchFailure::Appearance { have, need } = failure else { panic!("{failure:?}") };
        assert!(have < need && need == CONFIG.seed, "{failure}");
        assert_eq!(failure.agreed(), 0);
    }
}

#[test]
fn recognise_tells_how_few_agree_on_a_pose_where_only_the_looks_match() {
    // The same looks, but every point lies where another one was: no pose explains them.
    let mut world = World::around(stereo(), 15);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    for point in &mut world.points {
        *point = cairn_geometry::Vec3::new(
            point.x + 2.0 * (9.1 * point.y).sin(),
            1.5 * (7.3 * point.z).sin(),
            point.z,
        );
    }
    let view = world.see(&pose(0.2, 0.0, 0.0), 9.0);
    let failure = recognised(&world, &atlas, &view, ids[1], &CONFIG).expect_err("geometry does not match");
    let MatchFailure::Posed { have, need } = failure else { panic!("{failure:?}") };
    assert!(have < need && need == CONFIG.seed, "{failure}");
}

#[test]
fn recognise_leaves_out_known_landmarks() {
    let world = World::around(stereo(), 16);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let view = world.see(&pose(0.2, 0.0, 0.0), 9.0);
    let all: BTreeSet<LandmarkId> = atlas.latest().landmarks().map(|l| l.id).collect();
    let failure = recognise(atlas.latest(), &View::new(&world.camera, &view.frame), ids[1], &all, &CONFIG, 7);
    assert!(matches!(failure, Err(MatchFailure::Appearance { have: 0, .. })), "{failure:?}");
}

#[test]
fn recognise_tells_how_many_agree_where_more_are_needed() {
    let world = World::around(stereo(), 17);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    let view = world.see(&pose(0.2, 0.0, 0.0), 9.0);
    let config = RecogniseConfig { need: 10_000, ..CONFIG };
    let failure = recognised(&world, &atlas, &view, ids[1], &config).expect_err("more than there are");
    let MatchFailure::Agree { have, of, need } = failure else { panic!("{failure:?}") };
    assert!(have > 200 && of >= have && of <= view.frame.len() && need == 10_000, "{failure}");
    assert_eq!(failure.agreed(), have);
}

#[test]
fn recognise_tells_how_many_landmarks_in_view_are_missing() {
    let world = World::around(stereo(), 18);
    let (atlas, ids) = world.exact_map(&sideways(4, 0.2));
    // A tenth of the place is there.
    let mut sparse = World::around(stereo(), 18);
    sparse.points.truncate(120);
    let view = sparse.see(&pose(0.2, 0.0, 0.0), 9.0);
    let config = RecogniseConfig { seed: 10, need: 10, share: 0.5 };
    let failure =
        recognised(&world, &atlas, &view, ids[1], &config).expect_err("nearly all of it is missing");
    let MatchFailure::Missing { have, expected, need } = failure else { panic!("{failure:?}") };
    assert!((10..need).contains(&have) && have <= view.frame.len(), "{failure}");
    assert!(expected > 200 && need < expected, "{failure}");
}

#[test]
fn has_parallax_tells_views_from_two_places_from_a_turn_on_the_spot() {
    let world = World::around(stereo(), 9);
    let turn: Vec<Se3> = (0..4).map(|n| pose(0.0, 0.0, 0.05 * f64::from(n))).collect();
    for (path, seen) in [(sideways(4, 0.15), true), (turn, false)] {
        let (atlas, ids) = world.exact_map(&path);
        let mut several = atlas.latest().landmarks().filter(|l| l.observations.len() == 4).peekable();
        assert!(several.peek().is_some());
        for l in several {
            assert_eq!(has_parallax(atlas.latest(), l, None), seen, "{:?}", l.position);
            assert!(!has_parallax(atlas.latest(), l, Some(ids[1])), "a single view shows none");
        }
    }
}
