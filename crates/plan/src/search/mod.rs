//! Shortest paths over cells with eight neighbours that cut no corner: a diagonal step needs both adjacent cells free.
//!
//! Costs are whole numbers: 5741 for a straight step and 8119 for a diagonal one. 8119 / 5741 is a convergent of the
//! continued fraction of the square root of two, and a convergent orders `a + b * sqrt(2)` correctly for all whole `a`
//! and `|b| < 5741`: if the numbers of diagonal steps of two paths differ by less than that, the path of lower integer
//! cost is the shorter one. So rounding never decides, and the queues may be buckets.

mod astar;
mod buckets;
mod dstar_lite;
mod jump;
mod moves;
mod theta;
mod weighted;

pub use astar::AStar;
pub use dstar_lite::DStarLite;
pub use jump::JumpPoint;
pub(crate) use moves::steps_possible;
pub use theta::{LazyTheta, line_of_sight};
pub use weighted::{BLOCKED, WeightedAStar};

use crate::grid::{Cell, GridFrame};
use crate::passable::Passable;
use cairn_geometry::Vec2;

/// Cost of a straight step.
pub(crate) const STRAIGHT: u64 = 5741;
/// Cost of a diagonal step.
pub(crate) const DIAGONAL: u64 = 8119;

/// Steps in the eight directions: 0 = east, then counter-clockwise with y growing northwards; odd ones are diagonal.
pub(crate) const STEPS: [(i32, i32); 8] =
    [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoPath {
    /// A coordinate of start or goal is NaN or infinite.
    #[error("the {0} is not a finite point")]
    NotFinite(Place),
    /// Start or goal lies outside the grid.
    #[error("the {0} lies outside the grid")]
    Outside(Place),
    /// Start or goal is in a place that may not be entered: in a wall, too near to one, or on unknown ground.
    #[error("the {place} lies in or too near to an obstacle, or on unknown ground (cell {}, {})", cell.x, cell.y)]
    Blocked {
        /// Which of the two.
        place: Place,
        /// Its cell.
        cell: Cell,
    },
    /// No cell of the grid may be entered.
    #[error("the map has no free cell")]
    NoFreeCell,
    /// The goal cannot be reached from the start: everything reachable was searched.
    #[error("the goal cannot be reached ({expanded} cells can)")]
    Unreachable {
        /// Nodes expanded.
        expanded: usize,
    },
}

/// An end of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The start.
    Start,
    /// The goal.
    Goal,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Place::Start => "start",
            Place::Goal => "goal",
        })
    }
}

/// A path over cells, with its cost and the effort of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct GridPath {
    /// From start to goal, both included. Successive cells are neighbours; in any-angle paths they are in line of
    /// sight.
    pub cells: Vec<Cell>,
    /// Euclidean length in cells.
    pub length: f64,
    /// The minimised cost: the length in cells, or the length weighted by the cost of the cells.
    pub cost: f64,
    /// Nodes expanded.
    pub expanded: usize,
}

impl GridPath {
    /// Length in metres on a grid with this frame.
    pub fn length_m(&self, frame: &GridFrame) -> f64 {
        self.length * frame.resolution_m()
    }

    /// The centres of the cells in the world, in metres.
    pub fn points(&self, frame: &GridFrame) -> Vec<Vec2> {
        self.cells.iter().map(|&c| frame.centre(c)).collect()
    }

    /// From cells, with the Euclidean length as the cost.
    pub(crate) fn of(cells: Vec<Cell>, expanded: usize) -> Self {
        let length = cells.windows(2).map(|w| distance(w[0], w[1])).sum();
        Self { cells, length, cost: length, expanded }
    }
}

/// The cell that contains a point (metres, world), if it may be entered.
///
/// # Errors
/// When the point is not finite, outside, or blocked.
pub fn free_cell(passable: &Passable, place: Place, point: Vec2) -> Result<Cell, NoPath> {
    if !(point.x.is_finite() && point.y.is_finite()) {
        return Err(NoPath::NotFinite(place));
    }
    let cell = passable.frame().cell_at(point).ok_or(NoPath::Outside(place))?;
    check_end(passable, place, cell)
}

fn check_end(passable: &Passable, place: Place, cell: Cell) -> Result<Cell, NoPath> {
    if !passable.frame().contains(cell) {
        return Err(NoPath::Outside(place));
    }
    if passable.is_free(cell) { Ok(cell) } else { Err(NoPath::Blocked { place, cell }) }
}

/// Checks that both ends are free, on a grid that has free cells.
pub(crate) fn check(passable: &Passable, start: Cell, goal: Cell) -> Result<(), NoPath> {
    if passable.free() == 0 {
        return Err(NoPath::NoFreeCell);
    }
    check_end(passable, Place::Start, start)?;
    check_end(passable, Place::Goal, goal).map(drop)
}

/// Euclidean distance in cells.
pub(crate) fn distance(a: Cell, b: Cell) -> f64 {
    (f64::from(a.x) - f64::from(b.x)).hypot(f64::from(a.y) - f64::from(b.y))
}

/// Cost of the shortest path between two cells of an empty grid.
#[inline(always)]
pub(crate) fn octile(x: i32, y: i32, to_x: i32, to_y: i32) -> u64 {
    let (dx, dy) = (x.abs_diff(to_x) as u64, y.abs_diff(to_y) as u64);
    STRAIGHT * (dx + dy) - (2 * STRAIGHT - DIAGONAL) * dx.min(dy)
}

/// Packs a cell into one word.
#[inline(always)]
pub(crate) fn pack(x: i32, y: i32) -> u32 {
    (y as u32) << 16 | x as u32
}

/// Unpacks the cell of a word.
#[inline(always)]
pub(crate) fn unpack(word: u32) -> (i32, i32) {
    ((word & 0xFFFF) as i32, (word >> 16) as i32)
}
