//! Joining maps of a synthetic world that were made separately.

use super::*;
use crate::synthetic::{World, mono, off, pose, stereo};
use crate::{CloserConfig, MapJoin};
use cairn_adjust::WindowConfig;
use cairn_atlas::{Atlas, InertialState, KeyFrameId};
use cairn_geometry::{Se3, So3};
use cairn_vision::RectifiedCamera;
use std::f64::consts::TAU;

fn closer(camera: RectifiedCamera) -> Closer {
    Closer::new(camera, CloserConfig::default(), WindowConfig::default())
}

/// A part of a circle with a radius of two metres, looking outwards: key frames `from..to` of 48 a lap.
fn arc(from: usize, to: usize) -> Vec<Se3> {
    let at = |n: usize| {
        let turn = TAU * n as f64 / 48.0;
        pose(2.0 * turn.sin(), 2.0 * turn.cos(), turn)
    };
    (from..to).map(at).collect()
}

/// A map of `path` in a frame of its own, beside what is there; each pose is off by what `drift` says.
fn add(
    atlas: &mut Atlas,
    world: &World,
    path: &[Se3],
    map_from_world: impl Fn(usize) -> Sim3,
) -> Vec<KeyFrameId> {
    let start_s = 100.0 * atlas.latest().maps().count() as f64;
    let views = world.walk(path, start_s, 0.5);
    world.map(atlas, &views, path, None, map_from_world)
}

fn join(atlas: &mut Atlas, camera: RectifiedCamera) -> MapJoin {
    let maps: Vec<MapId> = atlas.latest().maps().map(|(id, _)| id).collect();
    let mut join = closer(camera).join_maps(atlas.latest(), maps[0], maps[1], Adjust::Now);
    let applied = atlas.commit(std::mem::take(&mut join.changes));
    assert_eq!(applied.dropped, 0);
    if let Some(joined) = join.joined.take() {
        let all = |s: &Snapshot| -> String {
            let key_frames = s.key_frames().map(|k| format!("{:?} {:?}", k.world_from_camera, k.landmarks));
            key_frames.chain(s.landmarks().map(|l| format!("{l:?}"))).collect()
        };
        assert!(all(&joined) == all(atlas.latest()), "the changes lead to another snapshot");
    }
    atlas.latest().check().expect("a sound map");
    join
}

fn turned(scale: f64) -> Sim3 {
    Sim3::new(So3::exp(&Vec3::new(0.1, 2.0, -0.2)), Vec3::new(7.0, -1.0, 3.0), scale)
}

#[test]
fn two_maps_that_share_a_part_become_one() {
    for (camera, scale) in [(stereo(), 1.0), (mono(), 2.5)] {
        let world = World::around(camera, 91);
        let mut atlas = Atlas::new(Snapshot::new());
        let (paths, other) = ([arc(0, 24), arc(14, 40)], turned(scale));
        let older = add(&mut atlas, &world, &paths[0], |_| Sim3::identity());
        let younger = add(&mut atlas, &world, &paths[1], |_| other);
        let before = atlas.latest().landmark_count();
        let join = join(&mut atlas, camera);
        let junction = join.result.unwrap_or_else(|apart| panic!("{apart}"));
        assert_eq!((join.from, join.into), (MapId(younger[0]), MapId(older[0])));
        assert!(junction.seams.len() >= 5 && junction.left_out == 0, "{junction:?}");
        assert!((junction.into_from.scale * scale - 1.0).abs() < 1e-3, "{junction:?}");
        assert!(junction.rms < 0.01 && junction.rms_after < 0.01, "{junction:?}");
        assert_eq!(atlas.latest().landmark_count() + junction.fused, before);
        assert!(junction.fused > 100 && atlas.latest().maps().count() == 1);
        for (id, truth) in older.iter().chain(&younger).zip(paths.iter().flatten()) {
            let k = atlas.latest().key_frame(*id).expect("none is lost");
            let (metres, radians) = off(&k.world_from_camera, truth);
            assert!(metres < 5e-3 && radians < 2e-3, "{id:?}: {metres} m, {radians} rad");
        }
        // What is anchored to a key frame of the younger map keeps its place there, in the units of today.
        let unit = atlas.latest().key_frame(younger[3]).map(|k| k.unit);
        assert!(unit.is_some_and(|unit| (unit * scale - 1.0).abs() < 1e-2), "{unit:?}");
    }
}

#[test]
fn what_the_younger_map_drifted_between_its_seams_is_distributed() {
    let world = World::around(stereo(), 92);
    let mut atlas = Atlas::new(Snapshot::new());
    let paths = [arc(0, 48), arc(4, 44)];
    let drift = |n: usize| Sim3::new(So3::identity(), Vec3::new(0.15 * n as f64 / 40.0, 0.0, 0.0), 1.0);
    add(&mut atlas, &world, &paths[0], |_| Sim3::identity());
    let younger = add(&mut atlas, &world, &paths[1], |n| turned(1.0) * drift(n));
    let join = join(&mut atlas, stereo());
    let junction = join.result.unwrap_or_else(|apart| panic!("{apart}"));
    assert!(junction.rms > 0.02 && (1e-9..0.01).contains(&junction.rms_after), "{junction:?}");
    let [mean, most] = junction.moved;
    assert!(mean > 0.02 && most > mean && junction.older_moved[1] < 0.02, "{junction:?}");
    for seam in &junction.seams {
        let k = atlas.latest().key_frame(seam.key_frame).expect("there");
        assert!(k.links.contains(&seam.place), "the pose graph keeps the seam");
    }
    for (id, truth) in younger.iter().zip(&paths[1]) {
        let metres = off(&atlas.latest().key_frame(*id).expect("there").world_from_camera, truth).0;
        assert!(metres < 0.02, "{id:?}: {metres} m");
    }
}

#[test]
fn metres_and_gravity_are_kept_whichever_map_has_them() {
    let world = World::around(mono(), 93);
    for aligned in [0, 1] {
        let mut atlas = Atlas::new(Snapshot::new());
        let paths = [arc(0, 20), arc(8, 28)];
        let first =
            add(&mut atlas, &world, &paths[0], |_| if aligned == 0 { Sim3::identity() } else { turned(0.4) });
        let second =
            add(&mut atlas, &world, &paths[1], |_| if aligned == 1 { Sim3::identity() } else { turned(0.4) });
        let metric = [first[0], second[0]][aligned];
        atlas.commit(vec![Change::AlignGravity(MapId(metric), Sim3::identity())]);
        let join = join(&mut atlas, mono());
        assert!(join.result.is_ok(), "{:?}", join.result);
        assert!(atlas.latest().is_gravity_aligned(MapId(first[0])));
        for (id, truth) in first.iter().chain(&second).zip(paths.iter().flatten()) {
            let metres = off(&atlas.latest().key_frame(*id).expect("there").world_from_camera, truth).0;
            assert!(metres < 5e-3, "{aligned} {id:?}: {metres} m");
        }
    }
}

#[test]
fn maps_of_different_places_stay_apart() {
    let (world, other) = (World::around(stereo(), 94), World::around(stereo(), 95));
    let mut atlas = Atlas::new(Snapshot::new());
    add(&mut atlas, &world, &arc(0, 30), |_| Sim3::identity());
    add(&mut atlas, &other, &arc(0, 30), |_| turned(1.0));
    let join = join(&mut atlas, stereo());
    assert_eq!(join.result.err(), Some(Apart::NoPlace));
    assert_eq!(atlas.latest().maps().count(), 2);
}

#[test]
fn one_position_proves_nothing() {
    let world = World::around(stereo(), 96);
    let mut atlas = Atlas::new(Snapshot::new());
    add(&mut atlas, &world, &arc(0, 20), |_| Sim3::identity());
    add(&mut atlas, &world, &arc(19, 22), |_| turned(1.0));
    let join = join(&mut atlas, stereo());
    assert!(matches!(join.result, Err(Apart::Few { need: NEED, .. })), "{:?}", join.result);
}

/// The same furniture stands at two places of the older map; the younger one shows it once.
#[test]
fn a_place_that_exists_twice_is_ambiguous() {
    let world = World::around(stereo(), 97);
    let mut atlas = Atlas::new(Snapshot::new());
    let path = [arc(0, 16), arc(0, 16)].concat();
    // The second lap is mapped as if it were 30 m further on.
    let far =
        |n: usize| Sim3::new(So3::identity(), Vec3::new(if n < 16 { 0.0 } else { 30.0 }, 0.0, 0.0), 1.0);
    let views = world.walk(&path, 0.0, 0.5);
    let (one, two) = views.split_at(16);
    let first = world.map(&mut atlas, one, &path[..16], None, far);
    world.map(&mut atlas, two, &path[16..], first.last().copied(), |n| far(n + 16));
    add(&mut atlas, &world, &arc(0, 16), |_| turned(1.0));
    let join = join(&mut atlas, stereo());
    assert!(matches!(join.result, Err(Apart::Ambiguous { .. })), "{:?}", join.result);
}

/// Places that agree, none of which was ever seen from where the other map saw it: rooms that look alike agree in that too.
#[test]
fn places_seen_from_elsewhere_alone_are_not_believed() {
    let world = World::around(stereo(), 97);
    let mut atlas = Atlas::new(Snapshot::new());
    add(&mut atlas, &world, &arc(0, 24), |_| Sim3::identity());
    let higher = |p: &Se3| Se3::new(p.rotation, p.translation + Vec3::new(0.0, 1.2, 0.0));
    let path: Vec<Se3> = arc(0, 24).iter().map(higher).collect();
    let views = world.walk(&path, 100.0, 0.5);
    world.map(&mut atlas, &views, &path, None, |_| turned(1.0));
    let join = join(&mut atlas, stereo());
    assert!(
        matches!(join.result, Err(Apart::Unsupported(Support { shown: 0, expected: 0 }))),
        "{:?}",
        join.result
    );
}

/// A room that looks like another: the younger map walks out of it where the older one has a wall, into views that the
/// older map does not know although it was there.
#[test]
fn key_frames_that_should_show_the_other_map_and_do_not_are_counted() {
    let (world, other) = (World::around(stereo(), 98), World::around(stereo(), 99));
    let mut atlas = Atlas::new(Snapshot::new());
    add(&mut atlas, &world, &arc(0, 48), |_| Sim3::identity());
    // A quarter of the lap looks the same, three quarters do not.
    let path = arc(0, 48);
    let mut views = world.walk(&path[..12], 100.0, 0.5);
    views.extend(other.walk(&path[12..], 106.0, 0.5));
    let (same, different) = views.split_at(12);
    let ids = world.map(&mut atlas, same, &path[..12], None, |_| turned(1.0));
    other.map(&mut atlas, different, &path[12..], ids.last().copied(), |_| turned(1.0));
    let join = join(&mut atlas, stereo());
    let Err(Apart::Unsupported(Support { shown, expected })) = join.result else {
        panic!("{:?}", join.result)
    };
    assert!(shown <= 14 && expected >= 40, "{shown} of {expected}");
}

/// Two maps with metres and z up, in which a metre is so long, and which say so of their standard deviations. With their key frames and
/// true poses.
fn metric_maps(
    world: &World,
    metres: [f64; 2],
    sigmas: [f64; 2],
) -> (Atlas, [Vec<KeyFrameId>; 2], [Vec<Se3>; 2]) {
    let mut atlas = Atlas::new(Snapshot::new());
    let paths = [arc(0, 24), arc(10, 34)];
    let up = So3::exp(&(Vec3::x() * -TAU / 4.0));
    let upright = [
        Sim3::new(up, Vec3::zeros(), metres[0]),
        Sim3::new(So3::exp(&(Vec3::z() * 0.7)) * up, Vec3::new(7.0, -1.0, 3.0), metres[1]),
    ];
    let ids = [0, 1].map(|n| add(&mut atlas, world, &paths[n], |_| upright[n]));
    let states = |n: usize| {
        let map = MapId(ids[n][0]);
        [Change::AlignGravity(map, Sim3::identity()), Change::ScaleSigma(map, sigmas[n])]
    };
    assert_eq!(atlas.commit([states(0), states(1)].concat()).dropped, 0);
    (atlas, ids, paths)
}

#[test]
fn two_metric_maps_become_one_with_the_scale_that_both_tell_whichever_is_older() {
    let world = World::around(mono(), 101);
    let (metres, sigmas) = ([1.03f64, 0.995], [0.02, 0.01]);
    let weights = sigmas.map(|sigma: f64| sigma.powi(-2));
    let log = (weights[0] * metres[0].ln() + weights[1] * metres[1].ln()) / (weights[0] + weights[1]);
    let sigma = (weights[0] + weights[1]).sqrt().recip();
    let mut lengths = Vec::new();
    for order in [[0, 1], [1, 0]] {
        let of = |values: [f64; 2]| order.map(|n| values[n]);
        let (mut atlas, ids, paths) = metric_maps(&world, of(metres), of(sigmas));
        let into = MapId(ids[0][0]);
        let junction = join(&mut atlas, mono()).result.unwrap_or_else(|apart| panic!("{apart}"));
        let [a, b] = of(metres);
        assert!((junction.into_from.scale * b / a - 1.0).abs() < 2e-3, "{junction:?}");
        let snapshot = atlas.latest();
        let at = |id: &KeyFrameId| snapshot.key_frame(*id).expect("there").world_from_camera.translation;
        for (ids, path) in ids.iter().zip(&paths) {
            let truth = (path[20].translation - path[0].translation).norm();
            let length = (at(&ids[20]) - at(&ids[0])).norm() / truth;
            // Places tell the scale between the maps to half a percent.
            assert!((length.ln() - log).abs() < 2.5e-3, "{length} where {} is right", log.exp());
            lengths.push(length);
        }
        let known = snapshot.scale_of(into, &mono()).metric_sigma().expect("metres");
        assert!((1.0..1.12).contains(&(known / sigma)), "{known} of {sigma}");
        assert_eq!(junction.scales.sigma_log, Some(known));
        assert!(snapshot.is_gravity_aligned(into));
    }
    // The first map of one order is the second of the other. What the places leave open between both lengths, a tenth of a
    // standard deviation, is as the older map has it.
    let apart = [lengths[0] - lengths[3], lengths[1] - lengths[2]];
    assert!(apart.iter().all(|apart| apart.abs() < 0.15 * sigma), "{lengths:?}");
}

#[test]
fn velocities_are_scaled_with_their_map() {
    let world = World::around(mono(), 102);
    let (mut atlas, ids, _) = metric_maps(&world, [1.03, 1.0], [0.01, 0.01]);
    let bias = cairn_inertial::Bias::default();
    let motion = InertialState { velocity: Vec3::x(), bias, still_sigma: None, imu_factor: None };
    let last = |ids: &[KeyFrameId]| *ids.last().expect("some");
    // A key frame of each map that moves, which sees nothing.
    let new: Vec<KeyFrameId> = ids
        .iter()
        .map(|ids| {
            let id = atlas.latest().next_key_frame_id();
            let k = atlas.latest().key_frame(last(ids)).expect("there").clone();
            let empty = std::sync::Arc::new(cairn_vision::Frame::default());
            let mut k = KeyFrame::new(id, empty, k.world_from_camera, Some(last(ids)));
            k.motion = Some(motion.clone());
            atlas.commit(vec![Change::AddKeyFrame(Box::new(k))]);
            id
        })
        .collect();
    let junction = join(&mut atlas, mono()).result.unwrap_or_else(|apart| panic!("{apart}"));
    let speed =
        |id: &KeyFrameId| atlas.latest().key_frame(*id).unwrap().motion.as_ref().unwrap().velocity.norm();
    assert!(junction.scales.there < 0.99 && junction.scales.here > 1.01, "{:?}", junction.scales);
    assert!((speed(&new[0]) - junction.scales.there).abs() < 1e-9);
    assert!((speed(&new[1]) - junction.scales.here).abs() < 1e-9);
}

#[test]
fn a_match_whose_scale_contradicts_both_maps_is_refused() {
    let world = World::around(mono(), 103);
    for (sigma, is_refused) in [(0.01, true), (0.03, false)] {
        let (mut atlas, ids, _) = metric_maps(&world, [1.0, 1.08], [sigma; 2]);
        let join = join(&mut atlas, mono());
        match join.result {
            Err(Apart::MetricScale(conflict)) => {
                assert!(is_refused && (conflict.ratio * 1.08 - 1.0).abs() < 5e-3, "{conflict}");
                assert!(conflict.to_string().starts_with("a metre of one map would be 0.92"), "{conflict}");
                assert_eq!(atlas.latest().maps().count(), 2);
                assert_eq!(atlas.latest().stated_scale_sigma(MapId(ids[1][0])), Some(sigma));
            }
            other => assert!(!is_refused && other.is_ok(), "{sigma}: {other:?}"),
        }
    }
}
