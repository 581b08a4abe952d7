//! A* over cells that differ in cost: a step costs its length times the mean of the costs of the cells it joins.
//!
//! Exact in whole numbers, as for equal costs; the heuristic uses the least cost on the map, so that the cost of the
//! goal is the least when it is first taken from the queue.

use super::astar::Words;
use super::buckets::Buckets;
use super::moves::{NOWHERE, steps_possible};
use super::{DIAGONAL, GridPath, NoPath, Place, STEPS, STRAIGHT, octile, pack, unpack};
use crate::grid::{Cell, Grid};

/// Cost of a cell that may not be entered.
pub const BLOCKED: u8 = 255;

/// A* over weighted cells that reuses its memory from search to search: 8 bytes per cell.
pub struct WeightedAStar {
    words: Words,
    queue: Buckets,
}

/// Width of a bucket in keys, as a power of two.
const BUCKET_SHIFT: u32 = 12;

impl Default for WeightedAStar {
    fn default() -> Self {
        Self::new()
    }
}

impl WeightedAStar {
    /// A search without memory; the first search allocates it.
    pub fn new() -> Self {
        let span = 4 * DIAGONAL * u64::from(BLOCKED);
        Self { words: Words::new(), queue: Buckets::new(BUCKET_SHIFT, span) }
    }

    /// The cheapest path between two cells. Costs are 1 to 254, or [`BLOCKED`] for cells that may not be entered; 0
    /// counts as 1. The cost of the path is the sum over its steps of length in cells times mean cost.
    ///
    /// # Errors
    /// When an end is outside or blocked, or the goal cannot be reached.
    pub fn search(&mut self, costs: &Grid<u8>, start: Cell, goal: Cell) -> Result<GridPath, NoPath> {
        let least_cost = check(costs, start, goal)?;
        let (width, height) = (costs.frame().width() as i32, costs.frame().height() as i32);
        self.words.begin(width as usize, height as usize);
        let ahead = |x: i32, y: i32| 2 * least_cost * octile(x, y, goal.x as i32, goal.y as i32);
        let values = costs.values();
        let cost_at = |x: i32, y: i32| {
            let inside = x >= 0 && y >= 0 && x < width && y < height;
            if inside { values[(y * width + x) as usize] } else { BLOCKED }
        };
        let (x, y) = (start.x as i32, start.y as i32);
        self.queue.clear(ahead(x, y));
        self.words.improve(self.words.index(x, y), 0, NOWHERE);
        self.queue.push(ahead(x, y), pack(x, y));
        let (mut best, mut expanded) = (u64::MAX, 0);
        while let Some((least, cell)) = self.queue.pop() {
            if least >= best {
                break;
            }
            let (x, y) = unpack(cell);
            let Some((cost, _)) = self.words.take(self.words.index(x, y)) else { continue };
            if cost + ahead(x, y) >= best {
                continue;
            }
            expanded += 1;
            if (x, y) == (goal.x as i32, goal.y as i32) {
                best = cost;
                continue;
            }
            let here = u64::from(cost_at(x, y).max(1));
            let around: [u8; 8] = STEPS.map(|(dx, dy)| cost_at(x + dx, y + dy));
            let free = around.iter().enumerate().fold(0, |f, (d, &c)| f | u8::from(c != BLOCKED) << d);
            let mut directions = steps_possible(free);
            while directions != 0 {
                let d = directions.trailing_zeros() as usize;
                directions &= directions - 1;
                let step = if d % 2 == 1 { DIAGONAL } else { STRAIGHT };
                let cost = cost + step * (here + u64::from(around[d].max(1)));
                let (x, y) = (x + STEPS[d].0, y + STEPS[d].1);
                if self.words.improve(self.words.index(x, y), cost, d as u8) {
                    self.queue.push(cost + ahead(x, y), pack(x, y));
                }
            }
        }
        if best == u64::MAX {
            return Err(NoPath::Unreachable { expanded });
        }
        let path = GridPath::of(self.words.trace(goal), expanded);
        Ok(GridPath { cost: cost_of(costs, &path.cells), ..path })
    }
}

/// Sum of step length times mean cost, in floating point.
pub(crate) fn cost_of(costs: &Grid<u8>, cells: &[Cell]) -> f64 {
    let at = |c: Cell| f64::from(costs.get(c).unwrap_or(BLOCKED).max(1));
    cells.windows(2).map(|w| super::distance(w[0], w[1]) * 0.5 * (at(w[0]) + at(w[1]))).sum()
}

/// Checks that both ends are free; returns the least cost of all cells.
fn check(costs: &Grid<u8>, start: Cell, goal: Cell) -> Result<u64, NoPath> {
    let least = costs.values().iter().copied().min().unwrap_or(BLOCKED);
    if least == BLOCKED {
        return Err(NoPath::NoFreeCell);
    }
    for (place, cell) in [(Place::Start, start), (Place::Goal, goal)] {
        match costs.get(cell) {
            None => return Err(NoPath::Outside(place)),
            Some(BLOCKED) => return Err(NoPath::Blocked { place, cell }),
            Some(_) => {}
        }
    }
    Ok(u64::from(least.max(1)))
}
