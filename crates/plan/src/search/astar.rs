//! A* (Hart, Nilsson and Raphael 1968) over cells of equal cost: exact, without preprocessing or clearing memory
//! between searches.
//!
//! One word per cell holds its cost, the direction of arrival, whether it was expanded, and the number of the search
//! that wrote it, so that words of earlier searches count as unseen. Keys are whole numbers in a ring of buckets, last
//! in first out, which breaks ties towards the goal. Neighbours follow the canonical ordering of Sturtevant and Rabin
//! ("Canonical Orderings on Grids", 2016): of all shortest paths to a cell only the one with its diagonal steps first
//! is followed, so that most cells are reached once.

use super::buckets::Buckets;
use super::moves::{Moves, NOWHERE};
use super::{DIAGONAL, GridPath, NoPath, STEPS, STRAIGHT, check, octile, pack, unpack};
use crate::grid::Cell;
use crate::passable::Passable;

/// The packed words of all cells, each valid for one search only.
pub(crate) struct Words {
    words: Vec<u64>,
    width: usize,
    generation: u64,
}

/// Enough for the longest path through all cells of the largest grid, at the highest weight of a weighted search.
const COST_BITS: u32 = 48;
const COST: u64 = (1 << COST_BITS) - 1;
const DONE: u64 = 1 << COST_BITS;
const ARRIVAL_SHIFT: u32 = COST_BITS + 1;
const GENERATION_SHIFT: u32 = ARRIVAL_SHIFT + 4;
const GENERATIONS: u64 = 1 << (64 - GENERATION_SHIFT);

impl Words {
    pub(crate) fn new() -> Self {
        Self { words: Vec::new(), width: 0, generation: 0 }
    }

    /// Begins a new search: all words count as unseen.
    pub(crate) fn begin(&mut self, width: usize, height: usize) {
        self.generation += 1;
        if self.words.len() != width * height || self.generation == GENERATIONS {
            self.words.clear();
            self.words.resize(width * height, 0);
            self.generation = 1;
        }
        self.width = width;
    }

    #[inline(always)]
    pub(crate) fn index(&self, x: i32, y: i32) -> usize {
        y as usize * self.width + x as usize
    }

    /// Writes cost and arrival if the cost is lower than the stored one. Returns whether it was.
    #[inline(always)]
    pub(crate) fn improve(&mut self, index: usize, cost: u64, arrival: u8) -> bool {
        let word = &mut self.words[index];
        let better = *word >> GENERATION_SHIFT != self.generation || cost < *word & COST;
        if better {
            *word = self.generation << GENERATION_SHIFT | u64::from(arrival) << ARRIVAL_SHIFT | cost;
        }
        better
    }

    /// Cost and arrival of a cell in the queue; `None` if it was already expanded at this cost. Marks it as expanded.
    #[inline(always)]
    pub(crate) fn take(&mut self, index: usize) -> Option<(u64, u8)> {
        let word = &mut self.words[index];
        if *word & DONE != 0 {
            return None;
        }
        *word |= DONE;
        Some((*word & COST, (*word >> ARRIVAL_SHIFT & 15) as u8))
    }

    /// Cost and arrival of a cell that this search has reached.
    pub(crate) fn seen(&self, index: usize) -> Option<(u64, u8)> {
        let word = self.words[index];
        (word >> GENERATION_SHIFT == self.generation)
            .then_some((word & COST, (word >> ARRIVAL_SHIFT & 15) as u8))
    }

    /// The cells from start to goal, found by going back along the directions of arrival.
    pub(crate) fn trace(&self, goal: Cell) -> Vec<Cell> {
        let (mut x, mut y) = (goal.x as i32, goal.y as i32);
        let mut cells = vec![goal];
        while let Some((_, arrival)) = self.seen(self.index(x, y)) {
            let Some(&(dx, dy)) = STEPS.get(arrival as usize) else { break };
            (x, y) = (x - dx, y - dy);
            cells.push(Cell::new(x as u32, y as u32));
        }
        cells.reverse();
        cells
    }
}

/// A* that reuses its memory from search to search: 8 bytes per cell.
pub struct AStar {
    words: Words,
    queue: Buckets,
    moves: Moves,
}

/// Width of a bucket in keys, as a power of two: a tenth of a step.
const BUCKET_SHIFT: u32 = 9;

impl Default for AStar {
    fn default() -> Self {
        Self::new()
    }
}

impl AStar {
    /// A search without memory; the first search allocates it.
    pub fn new() -> Self {
        Self { words: Words::new(), queue: Buckets::new(BUCKET_SHIFT, 2 * DIAGONAL), moves: Moves::new() }
    }

    /// The shortest path between two cells.
    ///
    /// # Errors
    /// When an end is outside or blocked, or the goal cannot be reached.
    pub fn search(&mut self, passable: &Passable, start: Cell, goal: Cell) -> Result<GridPath, NoPath> {
        check(passable, start, goal)?;
        self.words.begin(passable.frame().width(), passable.frame().height());
        let (goal_x, goal_y) = (goal.x as i32, goal.y as i32);
        let ahead = |x: i32, y: i32| octile(x, y, goal_x, goal_y);
        let (x, y) = (start.x as i32, start.y as i32);
        self.queue.clear(ahead(x, y));
        self.words.improve(self.words.index(x, y), 0, NOWHERE);
        self.queue.push(ahead(x, y), pack(x, y));
        // Cost of the best path found so far: nodes that cannot lead to a shorter one are skipped.
        let mut best = u64::MAX;
        let mut expanded = 0;
        while let Some((least, cell)) = self.queue.pop() {
            if least >= best {
                break;
            }
            let (x, y) = unpack(cell);
            let Some((cost, arrival)) = self.words.take(self.words.index(x, y)) else { continue };
            if cost + ahead(x, y) >= best {
                continue;
            }
            expanded += 1;
            if x == goal_x && y == goal_y {
                best = cost;
                continue;
            }
            let mut directions = self.moves.after(arrival, passable.neighbours(x, y));
            while directions != 0 {
                let d = directions.trailing_zeros() as usize;
                directions &= directions - 1;
                let (x, y) = (x + STEPS[d].0, y + STEPS[d].1);
                let cost = cost + if d % 2 == 1 { DIAGONAL } else { STRAIGHT };
                if self.words.improve(self.words.index(x, y), cost, d as u8) {
                    self.queue.push(cost + ahead(x, y), pack(x, y));
                }
            }
        }
        if best == u64::MAX {
            return Err(NoPath::Unreachable { expanded });
        }
        Ok(GridPath::of(self.words.trace(goal), expanded))
    }
}
