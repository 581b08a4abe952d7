//! Loop closing and map merging on synthetic maps.

use super::*;
use crate::synthetic::{View, World, mono, off, pose, sideways, stereo};
use cairn_adjust::{MatchFailure, MotionLinks, MotionSince};
use cairn_atlas::Atlas;
use cairn_geometry::{So3, Vec3};
use cairn_vision::RectifiedCamera;

/// Key frames in a lap.
const LAP: usize = 36;

fn closer(camera: RectifiedCamera) -> Closer {
    Closer::new(camera, CloserConfig::default(), WindowConfig::default())
}

/// A lap of a circle with a radius of one metre and the first sixth of a second one, looking outwards.
fn circle() -> Vec<Se3> {
    let at = |n: usize| {
        let turn = std::f64::consts::TAU * n as f64 / LAP as f64;
        pose(turn.sin(), turn.cos(), turn)
    };
    (0..LAP + 6).map(at).collect()
}

/// The map of that walk, with a drift of this many metres, and a fiftieth of that in radians, between the first sixth
/// of the lap and its end.
fn lap(world: &World, drift_m: f64) -> (Atlas, Vec<KeyFrameId>, Vec<Se3>) {
    drifting_lap(world, drift_m, drift_m / 50.0)
}

/// The same with its own drift of orientation, radians.
fn drifting_lap(world: &World, drift_m: f64, drift_rad: f64) -> (Atlas, Vec<KeyFrameId>, Vec<Se3>) {
    let path = circle();
    let views = world.walk(&path, 0.0, 0.5);
    let drift = |n: usize| {
        let share = (n.clamp(6, LAP) - 6) as f64 / (LAP - 6) as f64;
        let turn = So3::exp(&Vec3::new(0.0, share * drift_rad, 0.0));
        Sim3::new(turn, Vec3::new(share * drift_m, 0.0, 0.0), 1.0)
    };
    let mut atlas = Atlas::new(Snapshot::new());
    let ids = world.map(&mut atlas, &views, &path, None, drift);
    (atlas, ids, path)
}

fn error(snapshot: &Snapshot, id: KeyFrameId, truth: &Se3) -> f64 {
    off(&snapshot.key_frame(id).expect("there").world_from_camera, truth).0
}

#[test]
fn a_revisited_place_is_accepted_with_a_second_opinion_and_the_loop_is_corrected() {
    let world = World::around(stereo(), 71);
    let (mut atlas, ids, path) = lap(&world, 0.4);
    let mut closer = closer(world.camera);
    let last = LAP + 5;
    let first = closer.step(atlas.latest(), ids[last - 1]);
    assert!(first.changes.is_empty() && first.joined.is_none());
    let waits = first.verdicts.iter().filter(|v| v.result == Err(Refusal::Alone)).count();
    assert!(waits > 0, "{:?}", first.verdicts);
    let second = closer.step(atlas.latest(), ids[last]);
    let accepted = second.verdicts.iter().find_map(|v| v.result.ok());
    let accepted = accepted.unwrap_or_else(|| panic!("{:?}", second.verdicts));
    assert_eq!(accepted.joined, Joined::Loop);
    assert!((accepted.off - 0.4).abs() < 0.02 && (accepted.off_rad - 0.008).abs() < 2e-3, "{accepted:?}");
    assert!(accepted.inliers >= 40 && accepted.scale == 1.0, "{accepted:?}");
    assert_eq!(second.joined, Some(ids[last]));
    let before = atlas.latest().clone();
    assert_eq!(atlas.commit(second.changes).dropped, 0);
    atlas.latest().check().expect("a sound map");
    assert!(error(&before, ids[last], &path[last]) > 0.38);
    let after = error(atlas.latest(), ids[last], &path[last]);
    // Pose graph optimisation distributes the error; the rest is removed by the bundle adjustment of the whole map,
    // below.
    assert!(after < 0.08, "{after}");
    // The drift is distributed over the second half of the lap.
    let mean = |s: &Snapshot| (18..=last).map(|n| error(s, ids[n], &path[n])).sum::<f64>() / 24.0;
    assert!(mean(atlas.latest()) < 0.5 * mean(&before), "{} of {}", mean(atlas.latest()), mean(&before));
    // Points seen on both laps are one landmark each now.
    let both = |s: &Snapshot| {
        let seen = |l: &&cairn_atlas::Landmark| {
            let on = |from: usize, to: usize| {
                l.observations.iter().any(|o| (ids[from]..=ids[to]).contains(&o.key_frame))
            };
            on(0, 6) && on(LAP, last)
        };
        s.landmarks().filter(seen).count()
    };
    assert_eq!(both(&before), 0);
    assert!(both(atlas.latest()) > 100, "{}", both(atlas.latest()));
    let (here, old) = (ids[last], second.verdicts.last().expect("a verdict").candidate);
    assert!(atlas.latest().key_frame(here).is_some_and(|k| k.links.contains(&old)));
    atlas.commit(closer.adjust_whole(atlas.latest(), MapId(ids[0]), || false));
    let (after, all) = (error(atlas.latest(), ids[last], &path[last]), mean(atlas.latest()));
    assert!(after < 0.02 && all < 0.02, "{after} {all}");
}

/// Where depth gives the poses, features do not correct what they may be off by; more than that they do.
#[test]
fn poses_of_depth_are_not_moved_by_a_small_correction() {
    let world = World::around(stereo(), 71);
    for (drift, is_held) in [(0.05, true), (0.4, false)] {
        let (atlas, ids, _) = lap(&world, drift);
        let mut closer = closer(world.camera);
        closer.window.hold_poses = true;
        let closed: Vec<_> = [LAP + 4, LAP + 5].map(|n| closer.step(atlas.latest(), ids[n])).into();
        let verdicts = || closed.iter().flat_map(|c| &c.verdicts);
        let held = verdicts().filter(|v| matches!(v.result, Err(Refusal::Held { off, .. }) if off < 0.1));
        assert_eq!(held.count() > 0, is_held, "{drift}");
        assert_eq!(verdicts().any(|v| v.result.is_ok()), !is_held, "{drift}");
    }
}

/// The wheels say that the key frames lie as they do: then it is not the map that drifted, but what is recognised that has moved. Wheels
/// that may be off by as much have no say.
#[test]
fn a_correction_that_contradicts_the_measured_motion_is_refused() {
    let world = World::around(stereo(), 71);
    for (sigma, is_refused) in [(0.003, true), (0.03, false)] {
        let (atlas, ids, _) = lap(&world, 0.4);
        let at = |id| atlas.latest().key_frame(id).expect("there").world_from_camera;
        let links = MotionLinks::default();
        for ends in ids.windows(2) {
            let motion = at(ends[0]).inverse() * at(ends[1]);
            let since = MotionSince::none(cairn_sensor::Stamp::from_seconds(0.0));
            links.insert(ends[0], ends[1], since.then(&motion, [sigma * sigma; 2]));
        }
        let mut closer = closer(world.camera).with_motion_links(links);
        let closed: Vec<_> = [LAP + 4, LAP + 5].map(|n| closer.step(atlas.latest(), ids[n])).into();
        let verdicts = || closed.iter().flat_map(|c| &c.verdicts);
        let measured = |v: &&Verdict| matches!(v.result, Err(Refusal::Measured { off, .. }) if off > 0.3);
        assert_eq!(verdicts().filter(measured).count() > 0, is_refused, "{sigma}");
        assert_eq!(verdicts().any(|v| v.result.is_ok()), !is_refused, "{sigma}");
    }
}

#[test]
fn an_implausible_correction_is_refused_as_drift() {
    let world = World::around(stereo(), 72);
    let (atlas, ids, _) = lap(&world, 1.5);
    let mut closer = closer(world.camera);
    for n in [LAP + 4, LAP + 5] {
        let closed = closer.step(atlas.latest(), ids[n]);
        assert!(closed.changes.is_empty() && closed.joined.is_none());
        let drift = closed.verdicts.iter().find_map(|v| match v.result {
            Err(Refusal::Drift { off, plausible }) => Some((off, plausible)),
            _ => None,
        });
        let (off, plausible) = drift.unwrap_or_else(|| panic!("{:?}", closed.verdicts));
        assert!((off - 1.5).abs() < 0.05 && (0.7..1.2).contains(&plausible), "{off} {plausible}");
        assert!(closed.verdicts.iter().all(|v| v.result.is_err()));
    }
}

#[test]
fn a_correction_that_turns_by_more_than_can_have_drifted_is_refused() {
    let world = World::around(stereo(), 77);
    let (atlas, ids, _) = drifting_lap(&world, 0.0, 0.5);
    let mut closer = closer(world.camera);
    for n in [LAP + 4, LAP + 5] {
        let closed = closer.step(atlas.latest(), ids[n]);
        assert!(closed.changes.is_empty() && closed.joined.is_none());
        let turned = closed.verdicts.iter().find_map(|v| match v.result {
            Err(Refusal::Turned { off_rad, plausible_rad }) => Some((off_rad, plausible_rad)),
            _ => None,
        });
        let (off_rad, plausible_rad) = turned.unwrap_or_else(|| panic!("{:?}", closed.verdicts));
        assert!((off_rad - 0.5).abs() < 0.02 && (0.35..0.4).contains(&plausible_rad), "{off_rad}");
    }
}

#[test]
fn a_small_correction_needs_no_second_opinion() {
    let world = World::around(stereo(), 73);
    let (atlas, ids, _) = lap(&world, 0.1);
    let closed = closer(world.camera).step(atlas.latest(), ids[LAP + 5]);
    let accepted = closed.verdicts.iter().find_map(|v| v.result.ok());
    assert!(accepted.is_some_and(|a| (a.off - 0.1).abs() < 0.02), "{:?}", closed.verdicts);
}

#[test]
fn another_place_at_the_same_position_is_refused_by_its_looks() {
    let (world, other) = (World::around(stereo(), 74), World::around(stereo(), 75));
    let path = sideways(4, 0.2);
    let (mut atlas, ids) = world.exact_map(&path);
    let views = other.walk(&path, 10.0, 0.5);
    let later = other.map(&mut atlas, &views, &path, ids.last().copied(), |_| Sim3::identity());
    let closed = closer(world.camera).step(atlas.latest(), later[3]);
    assert!(!closed.verdicts.is_empty() && closed.changes.is_empty());
    for verdict in &closed.verdicts {
        let Err(Refusal::MatchFailure(MatchFailure::Appearance { have, need })) = verdict.result else {
            panic!("{verdict:?}")
        };
        assert!(have < need && ids.contains(&verdict.candidate));
    }
}

/// An exact map of a place, and a younger one of the same place in its own frame.
fn two_maps(world: &World, map_from_world: &Sim3) -> (Atlas, [Vec<KeyFrameId>; 2], Vec<Se3>) {
    let path = sideways(5, 0.2);
    let (mut atlas, older) = world.exact_map(&path);
    let views: Vec<View> = world.walk(&path, 20.0, 0.5);
    let younger = world.map(&mut atlas, &views, &path, None, |_| *map_from_world);
    (atlas, [older, younger], path)
}

#[test]
fn two_maps_are_merged_by_one_similarity() {
    let turned = So3::exp(&Vec3::new(0.1, 2.0, -0.2));
    for (camera, scale) in [(stereo(), 1.0), (mono(), 2.0)] {
        let world = World::around(camera, 76);
        let map_from_world = Sim3::new(turned, Vec3::new(7.0, -1.0, 3.0), scale);
        let (mut atlas, [older, younger], path) = two_maps(&world, &map_from_world);
        let mut closer = closer(camera);
        let first = closer.step(atlas.latest(), younger[3]);
        assert!(first.changes.is_empty());
        assert!(first.verdicts.iter().any(|v| v.result == Err(Refusal::Alone)), "{:?}", first.verdicts);
        let second = closer.step(atlas.latest(), younger[4]);
        let accepted = second.verdicts.iter().find_map(|v| v.result.ok());
        let accepted = accepted.unwrap_or_else(|| panic!("{:?}", second.verdicts));
        let joined = Joined::Merge { from: MapId(younger[0]), into: MapId(older[0]) };
        assert_eq!(accepted.joined, joined);
        assert!((accepted.scale * scale - 1.0).abs() < 1e-3, "{accepted:?}");
        assert_eq!(atlas.commit(second.changes).dropped, 0);
        atlas.latest().check().expect("a sound map");
        assert_eq!(atlas.latest().maps().count(), 1);
        for (id, truth) in older.iter().chain(&younger).zip(path.iter().chain(&path)) {
            let k = atlas.latest().key_frame(*id).expect("none is lost");
            let (metres, radians) = off(&k.world_from_camera, truth);
            assert!(metres < 2e-3 && radians < 1e-3, "{id:?}: {metres} m, {radians} rad");
        }
    }
}

/// One place tells the scale between two maps to two percent, and so does each map its own: each moves by a third.
#[test]
fn a_merge_of_two_metric_maps_weighs_their_scales() {
    let up = So3::exp(&(Vec3::x() * -std::f64::consts::FRAC_PI_2));
    for (metres, sigma, is_refused) in [(1.04, 0.02, false), (1.12, 0.005, true)] {
        let world = World::around(mono(), 76);
        let map_from_world = Sim3::new(So3::exp(&(Vec3::z() * 2.0)), Vec3::new(7.0, -1.0, 3.0), metres);
        let upright = Sim3 { rotation: up, ..Sim3::identity() };
        let path: Vec<Se3> = sideways(5, 0.2).iter().map(|pose| upright.transform_pose(pose)).collect();
        let mut atlas = Atlas::new(Snapshot::new());
        let world = world.transformed(&upright);
        let [older, younger] =
            [(0.0, Sim3::identity()), (20.0, map_from_world)].map(|(from_s, map_from_world)| {
                let views = world.walk(&path, from_s, 0.5);
                world.map(&mut atlas, &views, &path, None, |_| map_from_world)
            });
        let maps = [MapId(older[0]), MapId(younger[0])];
        let state = |map| [Change::AlignGravity(map, Sim3::identity()), Change::ScaleSigma(map, sigma)];
        atlas.commit(maps.map(state).concat());
        let mut closer = closer(mono());
        let closed = [3, 4].map(|n| closer.step(atlas.latest(), younger[n]));
        if is_refused {
            let refused = |v: &Verdict| matches!(v.result, Err(Refusal::MetricScale(_)));
            assert!(closed.iter().flat_map(|c| &c.verdicts).any(refused), "{:?}", closed[1].verdicts);
            assert!(closed.iter().all(|c| c.changes.is_empty()));
            continue;
        }
        let [_, closed] = closed;
        assert!(closed.joined.is_some(), "{:?}", closed.verdicts);
        let before = atlas.latest().clone();
        assert_eq!(atlas.commit(closed.changes).dropped, 0);
        atlas.latest().check().expect("a sound map");
        let known = atlas.latest().stated_scale_sigma(maps[0]).expect("it was stated");
        assert!((known / (sigma * (2.0f64 / 3.0).sqrt()) - 1.0).abs() < 0.02, "{known}");
        // What the window moves after that leaves the units as they are.
        let unit = |s: &Snapshot, ids: &[KeyFrameId]| s.key_frame(ids[0]).expect("there").unit;
        for (ids, share) in [(&older, 1.0 / 3.0), (&younger, -1.0 / 3.0)] {
            let log = (unit(atlas.latest(), ids) / unit(&before, ids)).ln();
            assert!((log - share * f64::ln(metres)).abs() < 1e-3, "{log} of {share}");
        }
    }
}

#[test]
fn maps_without_a_common_scale_are_refused_with_the_number_of_points() {
    let world = World::around(mono(), 77);
    let (mut atlas, [_, younger], _) = two_maps(&world, &Sim3::identity());
    let own: Vec<Change> = (atlas.latest().landmarks())
        .filter(|l| l.observations[0].key_frame >= younger[0])
        .map(|l| Change::RemoveLandmark(l.id))
        .collect();
    atlas.commit(own);
    let closed = closer(world.camera).step(atlas.latest(), younger[4]);
    // Its own key frames no longer share landmarks, and have none by which to be recognised.
    let older = closed.verdicts.iter().find(|v| v.candidate < younger[0]);
    let result = older.map(|v| v.result);
    assert!(matches!(result, Some(Err(Refusal::Scale { points: 0, .. }))), "{:?}", closed.verdicts);
    assert!(closed.changes.is_empty());
}

#[test]
fn gravity_directions_that_disagree_are_refused_as_tilt() {
    let world = World::around(stereo(), 78);
    let tilt = Sim3::new(So3::exp(&Vec3::new(0.3, 0.0, 0.0)), Vec3::zeros(), 1.0);
    let (mut atlas, [older, younger], _) = two_maps(&world, &tilt);
    let align = |id: KeyFrameId| Change::AlignGravity(MapId(id), Sim3::identity());
    atlas.commit(vec![align(older[0]), align(younger[0])]);
    let closed = closer(world.camera).step(atlas.latest(), younger[4]);
    let tilted = closed.verdicts.iter().find_map(|v| match v.result {
        Err(Refusal::Tilt { tilt_rad }) => Some(tilt_rad),
        _ => None,
    });
    assert!(tilted.is_some_and(|rad| (rad - 0.3).abs() < 0.01), "{:?}", closed.verdicts);
}

#[test]
fn a_merge_beyond_the_map_prior_is_refused_as_drift() {
    let world = World::around(stereo(), 79);
    let aside = Sim3 { translation: Vec3::new(4.0, 0.0, 0.0), ..Sim3::identity() };
    let (mut atlas, [older, younger], _) = two_maps(&world, &aside);
    let prior = cairn_atlas::MapPrior {
        to: older[4],
        to_from_root: Se3::identity(),
        sigma: 0.3,
        sigma_rad: 0.1,
        sigma_log_scale: 0.0,
    };
    atlas.commit(vec![Change::MapPrior(MapId(younger[0]), prior)]);
    let closed = closer(world.camera).step(atlas.latest(), younger[4]);
    let drift = |v: &Verdict| matches!(v.result, Err(Refusal::Drift { off, .. }) if (off - 4.0).abs() < 0.1);
    assert!(closed.verdicts.iter().any(drift), "{:?}", closed.verdicts);
}

#[test]
fn a_closer_that_is_switched_off_judges_nothing() {
    let world = World::around(stereo(), 80);
    let (atlas, ids, _) = lap(&world, 0.1);
    let config = CloserConfig { enabled: false, ..CloserConfig::default() };
    let mut closer = Closer::new(world.camera, config, WindowConfig::default());
    let closed = closer.step(atlas.latest(), ids[LAP + 5]);
    assert!(closed.verdicts.is_empty() && closed.changes.is_empty());
}

#[test]
fn adjust_whole_finishes_a_corrected_map_and_can_be_stopped() {
    let world = World::around(stereo(), 81);
    let (mut atlas, ids, path) = lap(&world, 0.1);
    let mut closer = closer(world.camera);
    let closed = closer.step(atlas.latest(), ids[LAP + 5]);
    atlas.commit(closed.changes);
    let map = MapId(ids[0]);
    assert!(closer.adjust_whole(atlas.latest(), map, || true).is_empty());
    let changes = closer.adjust_whole(atlas.latest(), map, || false);
    let before = atlas.latest().clone();
    atlas.commit(changes);
    let mean = |s: &Snapshot| {
        ids.iter().zip(&path).map(|(id, truth)| error(s, *id, truth)).sum::<f64>() / ids.len() as f64
    };
    assert!(mean(atlas.latest()) < 0.3 * mean(&before), "{} of {}", mean(atlas.latest()), mean(&before));
}

#[test]
fn candidates_are_the_place_of_before_and_no_neighbours() {
    let world = World::around(stereo(), 83);
    let (atlas, ids, _) = lap(&world, 0.4);
    let snapshot = atlas.latest();
    let here = snapshot.key_frame(ids[LAP + 3]).unwrap();
    let found = candidates::candidates(snapshot, &world.camera, here, 2.0, 5);
    assert!(!found.is_empty() && found.len() <= 5, "{found:?}");
    let neighbours: Vec<KeyFrameId> = here.covisible.iter().map(|(id, _)| *id).collect();
    assert!(found.iter().all(|id| !neighbours.contains(id) && *id != here.id), "{found:?}");
    assert!(found.iter().any(|id| ids[..7].contains(id)), "{found:?} has nothing of the first sixth");
    assert!(
        found.iter().all(|id| ids[..12].contains(id) || ids[LAP - 6..].contains(id)),
        "{found:?} is elsewhere"
    );
    // By words alone, too: nothing is within reach.
    let by_words = candidates::candidates(snapshot, &world.camera, here, 0.0, 5);
    assert!(by_words.iter().any(|id| ids[..7].contains(id)));
    // In the middle of the lap nobody was before.
    let middle = snapshot.key_frame(ids[15]).unwrap();
    let of_middle = candidates::candidates(snapshot, &world.camera, middle, 0.5, 5);
    assert!(of_middle.iter().all(|id| !ids[12..19].contains(id)));
}

#[test]
fn freedom_is_what_neither_gravity_nor_a_unit_of_length_tells() {
    for (camera, aligned, expected) in [
        (stereo(), 0, Freedom::Metric),
        (mono(), 0, Freedom::Similar),
        (mono(), 1, Freedom::Similar),
        (mono(), 2, Freedom::AlignGravity),
    ] {
        let world = World::around(camera, 84);
        let (mut atlas, ids, _) = two_maps(&world, &Sim3::identity());
        let align = |ids: &Vec<KeyFrameId>| Change::AlignGravity(MapId(ids[0]), Sim3::identity());
        atlas.commit(ids.iter().take(aligned).map(align).collect());
        let snapshot = atlas.latest();
        let here = snapshot.key_frame(ids[1][4]).unwrap();
        let visits = Visits { snapshot, camera: &camera, here, old: ids[0][0] };
        assert_eq!(visits.freedom(), expected, "{aligned} maps aligned");
    }
}

#[test]
fn plausible_drift_grows_with_the_distance_and_without_metres_with_the_median_depth() {
    for camera in [stereo(), mono()] {
        let world = World::around(camera, 85);
        let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
        let snapshot = atlas.latest();
        let here = snapshot.key_frame(ids[5]).unwrap();
        let points = here.landmarks.iter().flatten().filter_map(|id| world.point_of(snapshot, *id));
        let mut depths: Vec<f64> = points.map(|p| p.z).collect();
        depths.sort_by(f64::total_cmp);
        let middle = depths[depths.len() / 2];
        assert!((median_depth(snapshot, here).unwrap() - middle).abs() < 1e-9);
        let fixed = if camera.has_depth() { 0.5 } else { 0.3 * middle };
        let share = if camera.has_depth() { 0.05 } else { 0.1 };
        for (old, travelled) in [(0, 1.0), (4, 0.2)] {
            let visits = Visits { snapshot, camera: &camera, here, old: ids[old] };
            let drift = visits.plausible_drift([0.05, 0.1]);
            assert!((drift - fixed - share * travelled).abs() < 1e-9, "{drift} over {travelled} m");
        }
    }
}

#[test]
fn with_gravity_of_keeps_heading_and_place_and_takes_the_rest_from_the_map() {
    let world = World::around(stereo(), 86);
    let (atlas, ids) = world.exact_map(&sideways(2, 0.2));
    let mut here = atlas.latest().key_frame(ids[1]).unwrap().clone();
    here.world_from_camera.rotation = So3::exp(&Vec3::new(-1.5, 0.1, 0.0));
    let heading = So3::exp(&(Vec3::z() * 0.7));
    let recognised = |tilt: f64| {
        let turn = heading * So3::exp(&(Vec3::x() * tilt));
        Sim3::new(turn * here.world_from_camera.rotation, Vec3::new(1.0, 2.0, 3.0), 1.3)
    };
    let level = with_gravity_of(&here, &recognised(0.05)).expect("it is nearly level");
    let off = (level.rotation.inverse() * (heading * here.world_from_camera.rotation)).angle();
    assert!(off < 2e-3, "{off} rad");
    let up = |r: &So3| r.inverse() * Vec3::z();
    assert!(
        (up(&level.rotation) - up(&here.world_from_camera.rotation)).norm() < 1e-9,
        "gravity is the map's"
    );
    assert_eq!((level.translation, level.scale), (Vec3::new(1.0, 2.0, 3.0), 1.3));
    match with_gravity_of(&here, &recognised(0.2)) {
        Err(Refusal::Tilt { tilt_rad }) => assert!((tilt_rad - 0.2).abs() < 1e-9, "{tilt_rad}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn agrees_with_the_same_correction_of_a_key_frame_near_in_time_and_no_other() {
    let world = World::around(stereo(), 87);
    let (atlas, ids) = world.exact_map(&sideways(14, 0.1));
    let snapshot = atlas.latest();
    let shift = Sim3::new(So3::exp(&(Vec3::y() * 0.3)), Vec3::new(1.0, 0.0, 0.5), 1.0);
    let first = Hypothesis { key_frame: ids[12], old: ids[0], shift };
    let agrees = |here: usize, by: &Sim3| {
        first.agrees(snapshot, snapshot.key_frame(ids[here]).unwrap(), ids[1], &(*by * shift))
    };
    let moved = |x: f64, turn: f64, scale: f64| {
        Sim3::new(So3::exp(&(Vec3::y() * turn)), Vec3::new(x, 0.0, 0.0), scale)
    };
    assert!(agrees(13, &Sim3::identity()) && agrees(11, &moved(0.1, 0.0, 1.0)));
    assert!(!agrees(12, &Sim3::identity()), "it is its own");
    assert!(!agrees(2, &Sim3::identity()), "ten key frames before");
    // A tenth of the depth, which is 3 to 7 m; a tenth of a radian; a seventh of the scale.
    for wrong in [moved(1.0, 0.0, 1.0), moved(0.0, 0.15, 1.0), moved(0.0, 0.0, 1.25)] {
        assert!(!agrees(13, &wrong), "{wrong:?}");
    }
}

#[test]
fn merge_moves_the_younger_map_into_the_older_whichever_of_them_is_here() {
    let world = World::around(mono(), 88);
    let map_from_world = Sim3::new(So3::exp(&Vec3::new(0.1, 2.0, -0.2)), Vec3::new(7.0, -1.0, 3.0), 2.0);
    let (atlas, [older, younger], path) = two_maps(&world, &map_from_world);
    for (here, old, there_from_here) in
        [(younger[3], older[2], map_from_world.inverse()), (older[2], younger[3], map_from_world)]
    {
        let mut draft = Draft::new(atlas.latest());
        correct::merge(&mut draft, atlas.latest().key_frame(here).unwrap(), old, &there_from_here);
        let merged = draft.snapshot();
        merged.check().expect("a sound map");
        assert_eq!(merged.maps().map(|(id, _)| id).collect::<Vec<_>>(), [MapId(older[0])]);
        assert!(merged.key_frame(here).unwrap().links.contains(&old));
        for (id, truth) in older.iter().chain(&younger).zip(path.iter().chain(&path)) {
            assert!(error(merged, *id, truth) < 1e-9, "{id:?}");
        }
    }
}

#[test]
fn relax_distributes_what_a_loop_contradicts_and_leaves_what_is_fixed() {
    let world = World::around(stereo(), 89);
    let (atlas, ids, path) = lap(&world, 0.4);
    let before = atlas.latest();
    let (first, middle, last) = (ids[0], ids[LAP / 2], ids[LAP]);
    let closed = [Loop { here: last, old: first, world_from_here: path[LAP].into() }];
    let relaxed = |fixed: Option<KeyFrameId>| {
        let changes =
            relax(before, MapId(first), &closed, None, 1.0, Freedom::Metric, |id| Some(id) == fixed);
        let mut draft = Draft::new(before);
        draft.push(changes);
        draft.snapshot().clone()
    };
    let after = relaxed(None);
    assert!(error(before, last, &path[LAP]) > 0.35, "it had drifted");
    let (drifted, closed_m) = (error(before, last, &path[LAP]), error(&after, last, &path[LAP]));
    assert!(closed_m < 0.3 * drifted, "{closed_m} of {drifted} m");
    assert!(error(&after, middle, &path[LAP / 2]) < error(before, middle, &path[LAP / 2]));
    assert_eq!(after.key_frame(first).unwrap().world_from_camera, path[0], "the root stays");
    // Landmarks go with the first key frame that shows them.
    let landmark = after.landmarks().find(|l| l.observations[0].key_frame == last).expect("one of its own");
    let seen_from = |snapshot: &Snapshot| {
        snapshot.key_frame(last).unwrap().world_from_camera.inverse()
            * snapshot.landmark(landmark.id).unwrap().position
    };
    assert!((seen_from(&after) - seen_from(before)).norm() < 1e-9);
    let held = relaxed(Some(middle));
    let pose = |snapshot: &Snapshot| snapshot.key_frame(middle).unwrap().world_from_camera;
    assert_eq!(pose(&held), pose(before));
    assert_ne!(pose(&after), pose(before));
}

/// The rig of a phone allows for ten times the noise of its sensor: neither of the two counts that.
#[test]
fn closing_adjusts_with_the_noise_that_mapping_begins_with() {
    let stated = cairn_sensor::ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
    let phone = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 60.0, noise: stated, offset_s: 0.0 };
    let config = InertialConfig { enabled: true, ..InertialConfig::default() };
    let closer = closer(mono()).with_imu(&phone, Se3::identity(), config);
    let mapping = crate::inertial::Inertial::new(&phone, Se3::identity(), config);
    assert_eq!(closer.imu.map(|(imu, _)| imu), Some(mapping.imu));
}
