//! Joining maps of a synthetic world that were made separately.

use super::*;
use crate::synthetic::{World, mono, off, pose, stereo};
use crate::{CloserConfig, MapJoin};
use cairn_adjust::WindowConfig;
use cairn_atlas::{Atlas, KeyFrameId};
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
    let mut join = closer(camera).join_maps(atlas.latest(), maps[0], maps[1]);
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
