//! Costmaps: a window that rolls with the robot, a large map updated from its changed cells, and the insertion of a
//! scan.

use crate::repeat;
use cairn_geometry::Se2;
use cairn_plan::{Cell, CostConfig, Costmap, Grid, GridFrame, OccupancyConfig, OccupancyGrid};
use std::hint::black_box;

pub fn figures(willow: &Grid<i8>) {
    println!("costs");
    let (w, h) = (willow.frame().width() as i64, willow.frame().height() as i64);
    let mut at = 0;
    repeat("window of 200 x 200, cut out and computed (goal: 5 ms)", || {
        at = (at + 7) % (w - 200);
        let window = willow.window(at, h / 2 - 100, 200, 200, -1).expect("a window");
        black_box(Costmap::new(window, CostConfig::default()).expect("costs"));
    });
    let frame = GridFrame::new(2000, 2000, 0.05, Se2::identity()).expect("a grid");
    let mut large = Grid::filled(frame, 0i8);
    for i in 0..frame.len() {
        let cell = frame.cell(i);
        large.values_mut()[i] = willow.get(Cell::new(cell.x % w as u32, cell.y % h as u32)).unwrap_or(-1);
    }
    repeat("2000 x 2000, everything", || {
        black_box(Costmap::new(large.clone(), CostConfig::default()).expect("costs"));
    });
    let mut costs = Costmap::new(large.clone(), CostConfig::default()).expect("costs");
    let field = costs.field().squared();
    let middle = (0..field.len()).max_by_key(|&i| field[i]).map(|i| frame.cell(i)).expect("cells");
    let (mut value, mut rows) = (100, 0);
    repeat("2000 x 2000, after 100 cells changed", || {
        let changes: Vec<(Cell, i8)> =
            (0..100).map(|k| (Cell::new(middle.x + k % 10, middle.y + k / 10), value)).collect();
        rows = rows.max(costs.update(&changes));
        value = 100 - value;
    });
    println!("    at most {rows} of 2000 rows again");
    let mut occupancy = OccupancyGrid::new(*willow.frame(), OccupancyConfig::default());
    let pose = Se2::from_xy_angle(30.0, 30.0, 0.1);
    let rays: Vec<(f64, f64)> = (0..720)
        .map(|i| (f64::from(i) * 0.5f64.to_radians(), 4.0 + 3.0 * (0.3 * f64::from(i)).sin()))
        .collect();
    repeat("a scan of 720 rays of 1 to 7 m taken", || {
        black_box(occupancy.insert_scan(&pose, rays.iter().copied()).expect("a scan"));
    });
}
