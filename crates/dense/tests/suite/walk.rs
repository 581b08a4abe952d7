//! Columns on occupancy fused from depth.

use cairn_dense::walk::{Columns, Span, Window};
use cairn_dense::{Occupancy, OccupancyConfig, OccupancyGrid};
use cairn_geometry::{Se3, So3, Vec3};
use scene::{Scene, camera};

use crate::scene;

fn window(world_from_level: Se3) -> Window {
    Window { world_from_level, half_m: 3.0, cell_m: 0.1, heights_m: [-0.8, 2.4], step_m: 0.025 }
}

/// Gravity has an arbitrary direction in the map's frame; depth is fused there, columns are sampled in a level frame.
#[test]
fn floor_and_ball_are_found_in_fused_depth() {
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
    let tops = |x_m: f64, y_m: f64| {
        let (x, y) = (((x_m + 1.8) / 0.1) as usize, ((y_m + 1.8) / 0.1) as usize);
        columns.spans(x, y).iter().filter(|s| s.occupied).map(|s| s.high_m).collect::<Vec<_>>()
    };
    // The floor is at zero, under free air.
    let cells = (0..columns.side().pow(2)).map(|i| columns.spans(i % columns.side(), i / columns.side()));
    let is_floor = |spans: &&[Span]| {
        spans.windows(2).any(|s| s[0].occupied && s[0].high_m.abs() < 0.13 && !s[1].occupied)
    };
    let floor = cells.filter(is_floor).count();
    assert!(floor > 300, "{floor} cells of floor");
    // The ball lies 1.3 m ahead and 0.2 m to the right: its top is 0.6 m high.
    let ball = tops(1.3, -0.2);
    assert!(ball.iter().any(|top| (0.4..0.75).contains(top)), "{ball:?}");
    assert!(tops(1.0, 1.0).iter().all(|top| *top < 0.2), "{:?}", tops(1.0, 1.0));
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
