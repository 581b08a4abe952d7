//! Global registration: submaps and single images of the kitchen, turned at random, find their places; what does not
//! belong together, or leaves a direction open, is refused with numbers.

use cairn_dense::{
    AnchorId, DenseError, DenseMap, DepthConfig, DepthFrame, DepthPreparer, MapId, OccupancyConfig,
    OccupancyGrid, RegisterConfig, Registration, SubmapConfig, Surface, SurfaceFeatures, TsdfConfig,
    TsdfVolume, Verdict, register,
};
use cairn_geometry::{Se3, Vec3};
use pairs::{Submap, error, kitchen_submaps, pairs_overlapping, turned};
use std::path::Path;

use crate::common;
#[path = "common/pairs.rs"]
mod pairs;
use crate::scene;

fn registered(target: &Submap, source: &Submap, gravity: bool) -> Registration {
    let config = RegisterConfig::default();
    let features = [target, source].map(|s| SurfaceFeatures::new(&s.tsdf, &config).expect("in range"));
    let [a, b] = [target.surface(&features[0], gravity), source.surface(&features[1], gravity)];
    register(&a, &b, &config).expect("in range")
}

/// The recording's frames by number.
fn images(folder: &Path) -> impl FnMut(usize) -> (DepthFrame, Se3) {
    let mut preparer = DepthPreparer::new(DepthConfig::default(), common::camera(), 0.001).expect("a camera");
    move |n| {
        let (image, pose) = common::frame(folder, n);
        (preparer.prepare(&image).expect("a frame").clone(), pose)
    }
}

#[test]
fn twenty_pairs_of_submaps_find_each_other() {
    let Some(folder) = common::kitchen() else { return };
    let mut submaps = kitchen_submaps(images(&folder));
    for (a, b) in pairs_overlapping(&mut submaps, 0.45, 20) {
        for gravity in [false, true] {
            let found = registered(&submaps[a], &submaps[b], gravity);
            let [cm, degrees] = error(&found, &submaps[a], &submaps[b]);
            assert!(found.accepted(), "{a}-{b}, gravity {gravity}: {found:?}");
            assert!(
                cm < 10.0 && degrees < 3.5,
                "{a}-{b}, gravity {gravity}: {cm:.1} cm, {degrees:.1} degrees"
            );
        }
    }
}

#[test]
fn submaps_with_little_in_common_are_not_put_together_wrongly() {
    let Some(folder) = common::kitchen() else { return };
    let mut submaps = kitchen_submaps(images(&folder));
    let mut refused = 0;
    for (a, b) in pairs_overlapping(&mut submaps, 0.0, 10) {
        let found = registered(&submaps[a], &submaps[b], false);
        let [cm, degrees] = error(&found, &submaps[a], &submaps[b]);
        refused += usize::from(!found.accepted());
        assert!(!found.accepted() || (cm < 10.0 && degrees < 3.5), "{a}-{b}: {cm:.1} cm, {found:?}");
    }
    assert!(refused >= 8, "{refused} of 10 refused");
}

#[test]
fn an_image_finds_its_place_in_a_map_of_other_images() {
    let Some(folder) = common::kitchen() else { return };
    let camera = common::camera();
    let mut map = DenseMap::new(SubmapConfig::default(), camera, 0.001).expect("a camera");
    let world = turned(3);
    for n in (0..300).step_by(10) {
        let (image, pose) = common::frame(&folder, n);
        map.insert(AnchorId(n as u64), MapId(0), world * pose, Se3::identity(), &image, None)
            .expect("a key frame");
    }
    let mut locator = map.locator(RegisterConfig::default()).expect("in range");
    let (mut right, mut wrong) = (0, 0);
    for n in (5..300).step_by(30) {
        let (image, pose) = common::frame(&folder, n);
        let up = [world.rotation * -Vec3::y(), pose.rotation.inverse() * -Vec3::y()];
        let places = map.places(MapId(0), Some(up[0]));
        let found = locator.locate(&places, &image, Some(up[1])).expect("depth").expect("a submap");
        let off = (world * pose).inverse() * found.world_from_source;
        let near = off.translation.norm() < 0.1 && off.rotation.angle() < 0.06;
        right += usize::from(found.registration.accepted() && near);
        wrong += usize::from(found.registration.accepted() && !near);
    }
    assert!(wrong == 0 && right >= 8, "{right} right, {wrong} wrong of 10");
    let nowhere = map.places(MapId(7), None);
    assert!(locator.locate(&nowhere, &common::frame(&folder, 0).0, None).expect("depth").is_none());
}

/// A synthetic scene, seen from some poses, in a frame of its own.
fn seen(scene: &scene::Scene, frame: &Se3, poses: &[Se3]) -> Submap {
    let mut tsdf = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    let mut occupancy = OccupancyGrid::new(OccupancyConfig::default()).expect("in range");
    for pose in poses {
        let image = scene.frame(&scene::camera(), pose);
        tsdf.integrate(&image, None, &(*frame * *pose)).expect("a pose");
        occupancy.integrate(&image, &(*frame * *pose)).expect("a pose");
    }
    Submap { tsdf, occupancy, sub_from_world: *frame, seen: Vec3::zeros(), images: Vec::new() }
}

#[test]
fn a_bare_wall_is_not_put_onto_a_bare_wall() {
    let far = Vec3::new(50.0, 50.0, 1.5);
    let wall = scene::Scene { room: Some((-far, far)), spheres: Vec::new() };
    let [a, b] = [Se3::identity(), turned(5)].map(|frame| seen(&wall, &frame, &[Se3::identity()]));
    let found = registered(&a, &b, false);
    assert!(matches!(found.verdict, Verdict::NoAgreement | Verdict::Unconstrained), "{found:?}");
    assert!(found.open >= 3, "{found:?}");
}

#[test]
fn a_room_is_found_again_and_a_larger_one_is_not_it() {
    let poses = scene::turn(24);
    let mut room = scene::Scene::room();
    room.spheres.push((Vec3::new(-1.2, 0.6, -0.9), 0.5));
    room.spheres.push((Vec3::new(1.5, -0.8, -0.4), 0.35));
    let larger = scene::Scene {
        room: Some((Vec3::new(-2.6, -1.2, -2.2), Vec3::new(2.5, 1.5, 2.4))),
        spheres: vec![(Vec3::new(0.9, 0.2, 1.4), 0.6)],
    };
    let here = seen(&room, &Se3::identity(), &poses);
    let again = registered(&here, &seen(&room, &turned(5), &poses), false);
    assert!(again.accepted(), "{again:?}");
    let off = again.target_from_source * turned(5);
    assert!(off.translation.norm() < 0.02 && off.rotation.angle() < 0.01, "{off:?}");
    let other = registered(&here, &seen(&larger, &turned(5), &poses), false);
    assert!(!other.accepted(), "{other:?}");
}

/// A box is itself again when it is turned by half a turn; things in it tell the two apart, if there are enough of them.
#[test]
fn a_bare_box_is_ambiguous_and_things_in_it_settle_it() {
    let poses = scene::turn(24);
    let ball = |x: f64, y: f64, z: f64, radius: f64| (Vec3::new(x, y, z), radius);
    let things = vec![ball(-1.3, 0.2, -0.9, 0.5), ball(-1.5, -0.3, 0.5, 0.6), ball(0.3, 0.5, -1.3, 0.5)];
    for (spheres, expected) in [(Vec::new(), Verdict::Ambiguous), (things, Verdict::Accepted)] {
        let low_room = (Vec3::new(-2.0, -0.7, -1.5), Vec3::new(2.0, 0.7, 1.5));
        let room = scene::Scene { spheres, room: Some(low_room) };
        let here = seen(&room, &Se3::identity(), &poses);
        // Matches of features propose the other pose with some of these turns only.
        for k in 1..=8 {
            let again = registered(&here, &seen(&room, &turned(k), &poses), false);
            assert_eq!(again.verdict, expected, "turned({k}): {again:?}");
        }
    }
}

#[test]
fn bad_input_is_refused() {
    let tsdf = TsdfVolume::new(TsdfConfig::default()).expect("in range");
    let occupancy = OccupancyGrid::new(OccupancyConfig::default()).expect("in range");
    let config = RegisterConfig::default();
    let features = SurfaceFeatures::new(&tsdf, &config).expect("in range");
    assert_eq!(features.points(), 0);
    let surface = |up| Surface { tsdf: &tsdf, occupancy: &occupancy, features: &features, up };
    let empty = register(&surface(None), &surface(None), &config).expect("an empty surface is no error");
    assert_eq!((empty.verdict, empty.matches), (Verdict::NoAgreement, [0, 0]));
    for up in [Vec3::zeros(), Vec3::new(f64::NAN, 0.0, 1.0)] {
        let refused = register(&surface(Some(up)), &surface(Some(Vec3::z())), &config);
        assert!(matches!(refused, Err(DenseError::Config(_))), "{refused:?}");
    }
    let bad = RegisterConfig { cell_m: f64::NAN, ..config };
    assert!(matches!(SurfaceFeatures::new(&tsdf, &bad), Err(DenseError::Config(_))));
}
