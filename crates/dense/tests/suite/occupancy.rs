//! Occupancy: equal on all backends, true to the scene, and quick to free space that an object has left.

use cairn_dense::{
    Backend, DenseError, DepthConfig, DepthPreparer, Occupancy, OccupancyConfig, OccupancyGrid,
};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Image;
use scene::{Scene, camera, pose, turn};

use crate::scene;

fn grid(voxel_m: f64) -> OccupancyGrid {
    OccupancyGrid::new(OccupancyConfig { voxel_m, ..OccupancyConfig::default() }).expect("in range")
}

#[test]
fn all_instructions_give_the_same_odds() {
    let scene = Scene::room();
    let all: Vec<OccupancyGrid> = Backend::ALL
        .into_iter()
        .filter(|b| b.available())
        .map(|backend| {
            let mut grid = grid(0.04).with_backend(backend);
            for pose in turn(9) {
                grid.integrate(&scene.frame(&camera(), &pose), &pose).expect("a pose");
            }
            grid
        })
        .collect();
    for other in &all[1..] {
        for x in -60..60 {
            for y in -40..40 {
                for z in -50..50 {
                    assert_eq!(all[0].odds([x, y, z]), other.odds([x, y, z]), "{x} {y} {z}");
                }
            }
        }
    }
}

#[test]
fn free_is_free_and_walls_are_walls() {
    let scene = Scene::room();
    let mut grid = grid(0.05);
    for pose in turn(24) {
        grid.integrate(&scene.frame(&camera(), &pose), &pose).expect("a pose");
    }
    let (mut wrong, mut free, mut hit, mut walls) = (0, 0, 0, 0);
    for x in -40..40_i32 {
        for y in -24..24_i32 {
            for z in -30..30 {
                let p = Vec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, f64::from(z) + 0.5) * 0.05;
                let inside = (p - Vec3::new(0.4, 0.5, 0.6)).norm() < 0.3;
                match grid.at(&p) {
                    Occupancy::Free => {
                        free += 1;
                        wrong += usize::from(inside);
                    }
                    Occupancy::Occupied => {
                        hit += 1;
                        wrong += usize::from(scene.distance(p) > 0.1);
                    }
                    Occupancy::Unknown => {}
                }
                // The wall behind, well inside the view; it lies between two layers of voxels.
                if z == -30 && x.abs() < 15 && y.abs() < 10 {
                    let there = |z| grid.voxel([x, y, z]) == Occupancy::Occupied;
                    walls += usize::from(there(-30) || there(-31));
                }
            }
        }
    }
    assert_eq!(wrong, 0);
    assert!(free > 80_000 && hit > 3_000, "{free} free, {hit} hit");
    assert!(walls > 29 * 19 * 99 / 100, "{walls} of {} of the wall", 29 * 19);
}

/// A person stands for 10 s, leaves, and has disappeared from the grid within 1 s at 30 Hz.
fn leaves(background: Scene) {
    let at = Se3::identity();
    let person = Vec3::new(0.0, 0.0, 2.0);
    let mut with = background.clone();
    with.spheres.push((person, 0.3));
    let (with, without) = (with.frame(&camera(), &at), background.frame(&camera(), &at));
    let mut grid = grid(0.05);
    for _ in 0..300 {
        grid.integrate(&with, &at).expect("a pose");
    }
    let front = person - Vec3::new(0.0, 0.0, 0.29);
    assert_eq!(grid.at(&front), Occupancy::Occupied);
    let mut images = 0;
    while grid.at(&front) != Occupancy::Free {
        grid.integrate(&without, &at).expect("a pose");
        images += 1;
        assert!(images <= 30, "still there after a second");
    }
    for x in -6..6 {
        for y in -6..6 {
            let p = person + Vec3::new(f64::from(x), f64::from(y), -6.0) * 0.05;
            assert_ne!(grid.at(&p), Occupancy::Occupied, "{p:?}");
        }
    }
}

#[test]
fn who_left_before_a_wall_is_gone_within_a_second() {
    leaves(Scene {
        room: Some((Vec3::new(-2.0, -1.5, -1.0), Vec3::new(2.0, 1.5, 4.0))),
        spheres: Vec::new(),
    });
}

#[test]
fn who_left_before_an_empty_background_is_gone_within_a_second() {
    // Only an object at the side is seen: behind the person the hall is larger than the sensor's range.
    leaves(Scene { room: None, spheres: vec![(Vec3::new(-1.2, 0.6, 2.2), 0.5)] });
}

#[test]
fn a_sensor_that_fails_frees_nothing() {
    let at = Se3::identity();
    let mut scene = Scene { room: None, spheres: vec![(Vec3::new(0.0, 0.0, 2.0), 0.3)] };
    let mut grid = grid(0.05);
    grid.integrate(&scene.frame(&camera(), &at), &at).expect("a pose");
    // Hardly any pixel with depth is left.
    scene.spheres = vec![(Vec3::new(-1.0, 0.6, 2.2), 0.06)];
    let failing = scene.frame(&camera(), &at);
    for _ in 0..30 {
        grid.integrate(&failing, &at).expect("a pose");
    }
    assert_eq!(grid.at(&Vec3::new(0.0, 0.0, 1.71)), Occupancy::Occupied);
}

#[test]
fn bad_input_is_refused() {
    let mut grid = grid(0.05);
    let frame = Scene::room().frame(&camera(), &Se3::identity());
    assert!(matches!(grid.integrate(&frame, &pose([f64::NAN; 3], [0.0; 3])), Err(DenseError::Pose(_))));
    assert!(matches!(grid.integrate(&frame, &pose([1e12, 0.0, 0.0], [0.0; 3])), Err(DenseError::Pose(_))));
    // A hall of 180 m at 1 cm.
    let camera = camera();
    let depth = DepthConfig { farthest_m: 100.0, ..DepthConfig::default() };
    let mut preparer = DepthPreparer::new(depth, camera, 0.001).expect("a camera");
    let hall = Image::from_vec(160, 120, vec![90.0f32; 160 * 120]).expect("all pixels");
    let far = preparer.prepare_metres(&hall).expect("in range");
    let mut fine = OccupancyGrid::new(OccupancyConfig { voxel_m: 0.01, ..OccupancyConfig::default() })
        .expect("in range");
    assert!(matches!(fine.integrate(far, &Se3::identity()), Err(DenseError::Config(_))));
    let config = OccupancyConfig { limit: 100, ..OccupancyConfig::default() };
    assert!(matches!(OccupancyGrid::new(config), Err(DenseError::Config(_))));
    assert_eq!(grid.at(&Vec3::new(f64::NAN, 0.0, 0.0)), Occupancy::Unknown);
}
