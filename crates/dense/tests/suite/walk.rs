//! Columns, ground and hazards, on synthetic worlds and on occupancy fused from depth.

use cairn_dense::walk::{Columns, Ground, GroundConfig, HazardConfig, HazardKind, Surface, Window, hazards};
use cairn_dense::{Occupancy, OccupancyConfig, OccupancyGrid};
use cairn_geometry::{Se3, So3, Vec3};
use scene::{Scene, camera};

use crate::scene;

fn window(world_from_level: Se3) -> Window {
    Window { world_from_level, half_m: 3.0, cell_m: 0.1, heights_m: [-0.8, 2.4], step_m: 0.025 }
}

/// A hall of free air over a floor at zero; `solid` adds the obstacles.
fn hall(solid: impl Fn(&Vec3) -> Option<Occupancy>) -> impl Fn(&Vec3) -> Occupancy {
    move |p| {
        solid(p).unwrap_or(if p.z < -0.05 {
            Occupancy::Unknown
        } else if p.z < 0.0 {
            Occupancy::Occupied
        } else {
            Occupancy::Free
        })
    }
}

fn ahead(world: impl Fn(&Vec3) -> Occupancy, heading_rad: f64) -> Vec<(HazardKind, f64, f64)> {
    let columns = Columns::look(window(Se3::identity()), world).expect("a window");
    let ground = Ground::follow(&columns, &GroundConfig::default());
    let found = hazards(&columns, &ground, heading_rad, &HazardConfig::default());
    found.into_iter().map(|h| (h.kind, h.ahead_m, h.left_m)).collect()
}

#[test]
fn an_open_floor_has_no_hazard() {
    assert_eq!(ahead(hall(|_| None), 0.3), []);
}

#[test]
fn a_chair_is_an_obstacle_half_a_metre_to_the_left_of_another_way() {
    let chair = |p: &Vec3| {
        ((p.x - 1.5).abs() < 0.2 && (p.y - 0.2).abs() < 0.2 && (0.0..0.9).contains(&p.z))
            .then_some(Occupancy::Occupied)
    };
    let found = ahead(hall(chair), 0.0);
    let of = |kind| found.iter().find(|h| h.0 == kind).copied();
    let (_, far, left) = of(HazardKind::Obstacle).expect("the chair");
    assert!((far - 1.3).abs() < 0.11, "{far}");
    assert!((left - 0.15).abs() < 0.15, "{left}");
    assert_eq!(ahead(hall(chair), std::f64::consts::PI), [], "behind it is clear");
}

#[test]
fn a_beam_at_head_height_is_told_apart_from_what_stands() {
    let beam =
        |p: &Vec3| ((p.x - 1.0).abs() < 0.1 && (1.5..1.7).contains(&p.z)).then_some(Occupancy::Occupied);
    let found = ahead(hall(beam), 0.0);
    assert_eq!(found[0].0, HazardKind::HeadHeight);
    assert!((found[0].1 - 0.95).abs() < 0.11, "{}", found[0].1);
    // Above the head it is no obstacle.
    let lamp =
        |p: &Vec3| ((p.x - 1.0).abs() < 0.1 && (2.1..2.3).contains(&p.z)).then_some(Occupancy::Occupied);
    assert_eq!(ahead(hall(lamp), 0.0), []);
}

#[test]
fn stairs_down_are_a_step_down_and_a_ramp_is_ground() {
    let stairs = |p: &Vec3| {
        (p.x > 1.2).then(|| {
            let tread = -0.17 * (((p.x - 1.2) / 0.28).floor() + 1.0);
            if p.z < tread - 0.05 {
                Occupancy::Unknown
            } else if p.z < tread {
                Occupancy::Occupied
            } else {
                Occupancy::Free
            }
        })
    };
    let found = ahead(hall(stairs), 0.0);
    assert_eq!(found[0].0, HazardKind::StepDown);
    assert!((found[0].1 - 1.25).abs() < 0.11, "{}", found[0].1);
    let ramp = |p: &Vec3| {
        (p.x > 0.5).then(|| {
            let floor = -0.08 * (p.x - 0.5);
            if p.z < floor - 0.05 {
                Occupancy::Unknown
            } else if p.z < floor {
                Occupancy::Occupied
            } else {
                Occupancy::Free
            }
        })
    };
    assert_eq!(ahead(hall(ramp), 0.0), []);
}

#[test]
fn ground_that_was_not_seen_is_said_to_be_unknown() {
    let found = ahead(hall(|p| (p.x > 1.0).then_some(Occupancy::Unknown)), 0.0);
    assert_eq!(found[0].0, HazardKind::UnknownGround);
    assert!((found[0].1 - 1.05).abs() < 0.11);
}

/// Gravity has an arbitrary direction in the map's frame; depth is fused there, columns are sampled in a level frame.
#[test]
fn ground_and_obstacle_are_found_in_fused_depth() {
    // The scene's room: y down, floor at y = 1.2; a ball of 0.4 m on it.
    let mut scene = Scene::room();
    scene.spheres = vec![(Vec3::new(0.2, 0.9, 0.7), 0.3)];
    let tilt = Se3::new(So3::exp(&Vec3::new(0.3, -0.5, 0.2)), Vec3::new(1.0, 2.0, -3.0));
    let config = OccupancyConfig { voxel_m: 0.05, ..OccupancyConfig::default() };
    let mut grid = OccupancyGrid::new(config).expect("in range");
    for i in 0..24 {
        let turn =
            So3::exp(&Vec3::new(0.0, f64::from(i) * 0.262, 0.0)) * So3::exp(&Vec3::new(-0.45, 0.0, 0.0));
        let pose = Se3::new(turn, Vec3::new(0.0, -0.4, -0.6));
        grid.integrate(&scene.frame(&camera(), &pose), &(tilt * pose)).expect("a pose");
    }
    // Level frame: x ahead along the scene's z, y to the left, z up; the origin on the floor under the camera.
    let axes = nalgebra::Matrix3::from_columns(&[Vec3::z(), -Vec3::x(), -Vec3::y()]);
    let level = Se3::new(So3::from_matrix(&axes), Vec3::new(0.0, 1.2, -0.6));
    let window = Window { half_m: 1.8, ..window(tilt * level) };
    let columns = Columns::look(window, |p| grid.at(p)).expect("a window");
    let ground = Ground::follow(&columns, &GroundConfig::default());
    let walkable = ground.cells.iter().filter(|c| c.surface == Surface::Walkable).count();
    assert!(walkable > 300, "{walkable} cells of ground");
    assert!(ground.cells.iter().filter(|c| c.surface == Surface::Walkable).all(|c| c.ground_m.abs() < 0.13));
    let config = HazardConfig { ahead_m: 1.6, ..HazardConfig::default() };
    let found = hazards(&columns, &ground, 0.0, &config);
    let ball = found.iter().find(|h| h.kind == HazardKind::Obstacle).expect("the ball");
    // The ball lies 1.3 m ahead, its front at 1.0 m, a little to the right.
    assert!((ball.ahead_m - 1.05).abs() < 0.16 && ball.left_m < 0.05, "{ball:?}");
}

#[test]
fn windows_that_cannot_be_are_refused() {
    for bad in [
        Window { cell_m: 0.0, ..window(Se3::identity()) },
        Window { half_m: 1e6, ..window(Se3::identity()) },
        Window { heights_m: [1.0, 0.0], ..window(Se3::identity()) },
        Window { step_m: f64::NAN, ..window(Se3::identity()) },
    ] {
        assert!(Columns::look(bad, |_| Occupancy::Free).is_err());
    }
}
