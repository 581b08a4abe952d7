//! Where to look when no known ground leads to a goal: a door may be closed, someone may have stood in it when it was last
//! seen, or the ground there was never seen. Unknown ground is taken to be free (the freespace assumption of Koenig and
//! Likhachev, "D* Lite", 2002), and so is ground that was open before.
//!
//! In: the costmap as it changes, and what was looked at in vain. Out: what now blocks the way to a goal, and the place before it from
//! which it is seen.

use cairn_geometry::Vec2;
use cairn_plan::search::{BLOCKED, WeightedAStar};
use cairn_plan::{Cell, CostConfig, Costmap, Grid};
use std::collections::BTreeSet;

/// Costs of ground that is open, was never seen, and once was open: a way round is taken up to these ratios.
const OPEN: u8 = 10;
const UNKNOWN: u8 = 30;
const CLOSED: u8 = 100;
/// How far before unknown ground the robot looks at it, metres along the way.
const BEFORE_UNKNOWN_M: f64 = 0.7;
/// How far before ground that was open and is blocked: someone who stands there must be able to leave.
const BEFORE_CLOSED_M: f64 = 1.2;
/// Ground this near to a blockage that was looked at in vain belongs to it, metres.
const SAME_M: f64 = 0.6;
/// Ground this near to a goal was open when somebody chose the goal, even if the robot has only ever seen someone there, metres.
const GOAL_M: f64 = 0.5;

/// What blocks or hides the way to a goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Blockage {
    /// Where the known way ends.
    pub at: Vec2,
    /// Where to look at it from.
    pub before: Vec2,
}

/// The ground that was open at some time, as cells of the world's raster.
#[derive(Clone, Debug, Default)]
pub(super) struct OnceOpen {
    cells: BTreeSet<[i32; 2]>,
    /// Blockages that were looked at and stayed.
    in_vain: Vec<Vec2>,
}

impl OnceOpen {
    /// Takes what is open now.
    pub fn learn(&mut self, costs: &Costmap) {
        let frame = costs.frame();
        let all = costs.costs().values().iter().enumerate();
        let open = all.filter(|(_, cost)| **cost != BLOCKED).map(|(i, _)| frame.centre(frame.cell(i)));
        self.cells.extend(open.map(|at| raster(at, frame.resolution_m())));
    }

    /// A blockage was looked at and is as it was: ways through it are left out from now on.
    pub fn search_failed(&mut self, blockage: &Blockage) {
        self.in_vain.push(blockage.at);
    }

    /// All blockages may have gone; returns whether any had been looked at in vain.
    pub fn retry(&mut self) -> bool {
        !std::mem::take(&mut self.in_vain).is_empty()
    }

    /// The first blocked ground on the way from a cell to a goal over ground that was once open or is unknown; `None` where there
    /// can be no such way, or nothing blocks it.
    pub fn blockage(&self, costs: &Costmap, from: Cell, goal: Vec2) -> Option<Blockage> {
        let frame = *costs.frame();
        let hopeful = CostConfig { unknown: Some(UNKNOWN), ..*costs.config() };
        let hopeful = Costmap::new(costs.map().clone(), hopeful).ok()?;
        let may_open = |i: usize| hopeful.costs().values().get(i).is_some_and(|c| *c != BLOCKED);
        let was_open = |at: Vec2| self.cells.contains(&raster(at, frame.resolution_m()));
        let price = |(i, &cost): (usize, &u8)| {
            let at = frame.centre(frame.cell(i));
            match cost {
                BLOCKED if self.in_vain.iter().any(|b| (b - at).norm() < SAME_M) => BLOCKED,
                BLOCKED if may_open(i) => UNKNOWN,
                BLOCKED if was_open(at) || (goal - at).norm() < GOAL_M => CLOSED,
                BLOCKED => BLOCKED,
                _ => OPEN,
            }
        };
        let prices = costs.costs().values().iter().enumerate().map(price).collect();
        let prices = Grid::from_values(frame, prices).ok()?;
        let way = WeightedAStar::new().search(&prices, from, frame.cell_at(goal)?).ok()?;
        let blocked = way.cells.iter().position(|c| prices.get(*c) != Some(OPEN))?;
        let at = *way.cells.get(blocked)?;
        let before_m = if prices.get(at) == Some(CLOSED) { BEFORE_CLOSED_M } else { BEFORE_UNKNOWN_M };
        let back = (before_m / frame.resolution_m()) as usize;
        let before = *way.cells.get(blocked.saturating_sub(back))?;
        Some(Blockage { at: frame.centre(at), before: frame.centre(before) })
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
        assert_eq!(once.blockage(&closed, from, goal), None, "no way was ever known");
        once.learn(&closed);
        assert_eq!(once.blockage(&closed, from, goal), None, "there was no door");
        once.learn(&open);
        assert_eq!(once.blockage(&open, from, goal), None, "nothing blocks it");
        let Blockage { at, before } = once.blockage(&closed, from, goal).unwrap();
        assert!((at.x - 2.9).abs() < 0.2 && (at.y - 1.6).abs() < 0.5, "the inflated door: {at}");
        assert!(before.x < 2.3 && before.x > 1.3 && (before.y - 1.6).abs() < 0.8, "{before}");
        let cell = closed.frame().cell_at(before).unwrap();
        assert_ne!(closed.costs().get(cell), Some(BLOCKED));
        let unseen = OnceOpen::default().blockage(&rooms(-1), from, goal).unwrap().before;
        assert!(unseen.x > before.x && unseen.x < 2.7, "unknown ground is looked at from nearer: {unseen}");
    }

    #[test]
    fn a_goal_that_was_never_seen_open_is_looked_at_from_before_it() {
        let mut map = rooms(0).map().clone();
        // Somebody stood on the goal whenever the robot looked there.
        for y in 46..50 {
            (116..120).for_each(|x| assert!(map.set(Cell::new(x, y), 100)));
        }
        let costs = Costmap::new(map, CostConfig::default()).unwrap();
        let (from, goal) = (costs.frame().cell_at(Vec2::new(0.6, 0.6)).unwrap(), Vec2::new(5.9, 2.4));
        assert_eq!(costs.costs().get(costs.frame().cell_at(goal).unwrap()), Some(BLOCKED));
        let mut once = OnceOpen::default();
        once.learn(&costs);
        let Blockage { at, before } = once.blockage(&costs, from, goal).unwrap();
        assert!((at - goal).norm() < 0.5, "{at}");
        assert!((0.9..1.8).contains(&(before - goal).norm()), "{before}");
    }

    #[test]
    fn what_was_looked_at_in_vain_is_gone_round_and_tried_again_when_nothing_else_is_left() {
        let (open, closed) = (rooms(0), rooms(100));
        let (from, goal) = (open.frame().cell_at(Vec2::new(0.6, 0.6)).unwrap(), Vec2::new(5.9, 2.4));
        let mut once = OnceOpen::default();
        once.learn(&open);
        let door = once.blockage(&closed, from, goal).unwrap();
        assert!(!once.retry());
        // A passage above the door that nobody has seen the end of.
        let mut other = closed.map().clone();
        for y in 48..62 {
            (62..68).for_each(|x| assert!(other.set(Cell::new(x, y), if x < 65 { 0 } else { -1 })));
        }
        let other = Costmap::new(other, CostConfig::default()).unwrap();
        once.search_failed(&door);
        let round = once.blockage(&other, from, goal).unwrap();
        assert!(round.at.y > 2.3, "{:?}", round.at);
        assert_eq!(once.blockage(&closed, from, goal), None);
        assert!(once.retry());
        assert_eq!(once.blockage(&closed, from, goal), Some(door));
    }
}
