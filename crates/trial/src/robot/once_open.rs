//! Where to look when no known ground leads to a goal: a door may be closed, someone may have stood in it when it was last
//! seen, or the ground there was never seen. Unknown ground is taken to be free (the freespace assumption of Koenig and
//! Likhachev, "D* Lite", 2002), and so is ground that was open before.
//!
//! In: the costmap as it changes. Out: the place before what now blocks the way to a goal, from which that is seen best.

use cairn_geometry::Vec2;
use cairn_plan::search::{BLOCKED, WeightedAStar};
use cairn_plan::{Cell, CostConfig, Costmap, Grid};
use std::collections::BTreeSet;

/// Costs of ground that is open, and of ground that only once was or may be: a way round is taken up to this ratio.
const OPEN: u8 = 10;
const CLOSED: u8 = 100;
/// How far before the blockage the robot looks at it, metres along the way.
const BEFORE_M: f64 = 0.7;

/// The ground that was open at some time, as cells of the world's raster.
#[derive(Clone, Debug, Default)]
pub(super) struct OnceOpen {
    cells: BTreeSet<[i32; 2]>,
}

impl OnceOpen {
    /// Takes what is open now.
    pub fn learn(&mut self, costs: &Costmap) {
        let frame = costs.frame();
        let all = costs.costs().values().iter().enumerate();
        let open = all.filter(|(_, cost)| **cost != BLOCKED).map(|(i, _)| frame.centre(frame.cell(i)));
        self.cells.extend(open.map(|at| raster(at, frame.resolution_m())));
    }

    /// The place before the first blocked ground on the way from a cell to a goal over ground that was once open or is unknown; `None`
    /// where there can be no such way, or nothing blocks it.
    pub fn before_blockage(&self, costs: &Costmap, from: Cell, goal: Vec2) -> Option<Vec2> {
        let frame = *costs.frame();
        let hopeful = CostConfig { unknown: Some(CLOSED), ..*costs.config() };
        let hopeful = Costmap::new(costs.map().clone(), hopeful).ok()?;
        let may_open = |i: usize| hopeful.costs().values().get(i).is_some_and(|c| *c != BLOCKED);
        let price = |(i, &cost): (usize, &u8)| match cost {
            BLOCKED if may_open(i) => CLOSED,
            BLOCKED if self.cells.contains(&raster(frame.centre(frame.cell(i)), frame.resolution_m())) => {
                CLOSED
            }
            BLOCKED => BLOCKED,
            _ => OPEN,
        };
        let prices = costs.costs().values().iter().enumerate().map(price).collect();
        let prices = Grid::from_values(frame, prices).ok()?;
        let way = WeightedAStar::new().search(&prices, from, frame.cell_at(goal)?).ok()?;
        let blocked = way.cells.iter().position(|c| prices.get(*c) == Some(CLOSED))?;
        let back = (BEFORE_M / frame.resolution_m()) as usize;
        Some(frame.centre(*way.cells.get(blocked.saturating_sub(back))?))
    }
}

/// The cell of the world's own raster at a point.
fn raster(at: Vec2, resolution_m: f64) -> [i32; 2] {
    [at.x, at.y].map(|v| (v / resolution_m).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Se2;
    use cairn_plan::GridFrame;

    /// Two rooms of 3 x 3 m with a door of 1 m between them, which holds `door`; everything around is wall.
    fn rooms(door: i8) -> Costmap {
        let frame = GridFrame::new(130, 64, 0.05, Se2::identity()).unwrap();
        let mut map = Grid::filled(frame, 100i8);
        for y in 2..62 {
            for x in (2..62).chain(68..128) {
                map.set(Cell::new(x, y), 0);
            }
            for x in (62..68).filter(|_| (22..42).contains(&y)) {
                map.set(Cell::new(x, y), door);
            }
        }
        Costmap::new(map, CostConfig::default()).unwrap()
    }

    #[test]
    fn a_closed_door_is_looked_at_from_before_it_and_a_wall_is_not() {
        let (open, closed) = (rooms(0), rooms(100));
        let (from, goal) = (open.frame().cell_at(Vec2::new(0.6, 0.6)).unwrap(), Vec2::new(5.9, 2.4));
        let mut once = OnceOpen::default();
        assert_eq!(once.before_blockage(&closed, from, goal), None, "no way was ever known");
        once.learn(&closed);
        assert_eq!(once.before_blockage(&closed, from, goal), None, "there was no door");
        once.learn(&open);
        assert_eq!(once.before_blockage(&open, from, goal), None, "nothing blocks it");
        let at = once.before_blockage(&closed, from, goal).unwrap();
        assert!(at.x < 2.7 && at.x > 1.7 && (at.y - 1.6).abs() < 0.7, "{at}");
        let cell = closed.frame().cell_at(at).unwrap();
        assert_ne!(closed.costs().get(cell), Some(BLOCKED));
        let unseen = OnceOpen::default().before_blockage(&rooms(-1), from, goal).unwrap();
        assert!((unseen - at).norm() < 0.3, "unknown ground is looked at too: {unseen}");
    }
}
