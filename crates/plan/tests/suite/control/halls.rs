//! The halls and the body of the tests.

use cairn_geometry::Se2;
use cairn_plan::control::trial::SimulatedBody;
use cairn_plan::control::{Limits, Navigator, NavigatorConfig, PursuitConfig};
use cairn_plan::{CostConfig, Costmap, Grid, GridFrame};

pub fn navigator() -> Navigator {
    Navigator::new(NavigatorConfig::new(PursuitConfig::new(Limits::differential_drive())))
}

pub fn body(x: f64, y: f64, heading: f64, seed: u64) -> SimulatedBody {
    SimulatedBody::new(Se2::from_xy_angle(x, y, heading), Limits::differential_drive(), 0.05, 0.02, 1.0, seed)
}

/// A hall of `w` x `h` metres in cells of 5 cm, with walls around it and boxes (metres: from x, y to x, y) in it.
pub fn hall(w: f64, h: f64, boxes: &[[f64; 4]]) -> Grid<i8> {
    let frame = GridFrame::new((w * 20.0) as usize, (h * 20.0) as usize, 0.05, Se2::identity()).unwrap();
    let mut map = Grid::filled(frame, 0i8);
    for i in 0..frame.len() {
        let p = frame.centre(frame.cell(i));
        let rim = p.x < 0.1 || p.y < 0.1 || p.x > w - 0.1 || p.y > h - 0.1;
        let inside = |b: &[f64; 4]| p.x > b[0] && p.y > b[1] && p.x < b[2] && p.y < b[3];
        if rim || boxes.iter().any(inside) {
            map.values_mut()[i] = 100;
        }
    }
    map
}

/// Two rooms joined by two doors of 1 m: one at y = 2, one at y = 8.
pub fn two_rooms() -> Grid<i8> {
    hall(12.0, 10.0, &[[5.9, 0.0, 6.1, 1.5], [5.9, 2.5, 6.1, 7.5], [5.9, 8.5, 6.1, 10.0]])
}

pub fn costs(map: Grid<i8>) -> Costmap {
    Costmap::new(map, CostConfig::default()).unwrap()
}
