//! Jump point search (Harabor and Grastien 2011) that scans whole words of cells at once (the block-based scan of their
//! "Improving Jump Point Search", 2014, section 4) over the rows and columns of [`Passable`]. Nothing is precomputed. A
//! diagonal jump adds a node only where a straight scan from it ends in a jump point (intermediate pruning).
//!
//! The path from a node's parent goes diagonally first, then straight, so the parent alone determines the cells in
//! between.

use super::astar::Words;
use super::moves::{Moves, NOWHERE};
use super::{DIAGONAL, GridPath, NoPath, STEPS, STRAIGHT, check, octile, pack, unpack};
use crate::grid::Cell;
use crate::passable::{Lines, Passable, WINDOW};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Jump point search that reuses its memory from search to search: 12 bytes per cell, of which few are touched.
pub struct JumpPoint {
    words: Words,
    parents: Vec<u32>,
    /// By cost to the goal through the node, then by the least remaining distance.
    queue: BinaryHeap<Reverse<(u64, u64, u32)>>,
    moves: Moves,
}

impl Default for JumpPoint {
    fn default() -> Self {
        Self::new()
    }
}

impl JumpPoint {
    /// A search without memory; the first search allocates it.
    pub fn new() -> Self {
        Self { words: Words::new(), parents: Vec::new(), queue: BinaryHeap::new(), moves: Moves::new() }
    }

    /// The shortest path between two cells; it is as long as that of [`super::AStar`].
    ///
    /// # Errors
    /// When an end is outside or blocked, or the goal cannot be reached.
    pub fn search(&mut self, passable: &Passable, start: Cell, goal: Cell) -> Result<GridPath, NoPath> {
        check(passable, start, goal)?;
        let frame = passable.frame();
        self.words.begin(frame.width(), frame.height());
        self.parents.resize(frame.len(), 0);
        self.queue.clear();
        let from = (start.x as i32, start.y as i32);
        let to = (goal.x as i32, goal.y as i32);
        self.offer(from, 0, NOWHERE, from, to);
        let mut expanded = 0;
        while let Some(Reverse((_, _, word))) = self.queue.pop() {
            let at = unpack(word);
            let Some((cost, arrival)) = self.words.take(self.words.index(at.0, at.1)) else { continue };
            expanded += 1;
            if at == to {
                return Ok(GridPath::of(self.trace(start, goal), expanded));
            }
            let mut directions = self.moves.after(arrival, passable.neighbours(at.0, at.1));
            while directions != 0 {
                let d = directions.trailing_zeros() as u8;
                directions &= directions - 1;
                if d & 1 == 0 {
                    if let Some(run) = scan(passable, at, d, to) {
                        self.offer(ahead(at, d, run), cost + u64::from(run) * STRAIGHT, d, at, to);
                    }
                } else {
                    self.slant(passable, at, d, cost, to);
                }
            }
        }
        Err(NoPath::Unreachable { expanded })
    }

    /// Jumps diagonally, with a straight scan to both sides at each step.
    fn slant(&mut self, passable: &Passable, from: (i32, i32), d: u8, cost: u64, goal: (i32, i32)) {
        let (mut at, mut cost) = (from, cost);
        let sides = [d - 1, (d + 1) % 8];
        let needed = 1u8 << d | 1 << sides[0] | 1 << sides[1];
        while passable.neighbours(at.0, at.1) & needed == needed {
            at = ahead(at, d, 1);
            cost += DIAGONAL;
            if at == goal {
                return self.offer(at, cost, d, from, goal);
            }
            for side in sides {
                if let Some(run) = scan(passable, at, side, goal) {
                    let there = ahead(at, side, run);
                    self.offer(there, cost + u64::from(run) * STRAIGHT, side, from, goal);
                }
            }
        }
    }

    fn offer(&mut self, at: (i32, i32), cost: u64, arrival: u8, parent: (i32, i32), goal: (i32, i32)) {
        let index = self.words.index(at.0, at.1);
        if self.words.improve(index, cost, arrival) {
            self.parents[index] = pack(parent.0, parent.1);
            let rest = octile(at.0, at.1, goal.0, goal.1);
            self.queue.push(Reverse((cost + rest, rest, pack(at.0, at.1))));
        }
    }

    /// All cells from start to goal.
    fn trace(&self, start: Cell, goal: Cell) -> Vec<Cell> {
        let cell = |(x, y): (i32, i32)| Cell::new(x as u32, y as u32);
        let mut turns = vec![(goal.x as i32, goal.y as i32)];
        while let Some(&at) = turns.last().filter(|&&at| cell(at) != start) {
            turns.push(unpack(self.parents[self.words.index(at.0, at.1)]));
        }
        let mut cells = vec![start];
        for pair in turns.windows(2).rev() {
            let (to, mut at) = (pair[0], pair[1]);
            while at != to {
                // Both coordinates change while both differ: the diagonal part comes first.
                at = (at.0 + (to.0 - at.0).signum(), at.1 + (to.1 - at.1).signum());
                cells.push(cell(at));
            }
        }
        cells
    }
}

#[inline(always)]
fn ahead(at: (i32, i32), d: u8, steps: u32) -> (i32, i32) {
    let (dx, dy) = STEPS[d as usize];
    (at.0 + dx * steps as i32, at.1 + dy * steps as i32)
}

/// Steps to the next jump point straight ahead; `None` if a wall comes first.
#[inline(always)]
fn scan(passable: &Passable, at: (i32, i32), d: u8, goal: (i32, i32)) -> Option<u32> {
    let (lines, line, position) =
        if d & 3 == 0 { (&passable.rows, at.1, at.0) } else { (&passable.columns, at.0, at.1) };
    let (goal_line, goal_position) = if d & 3 == 0 { (goal.1, goal.0) } else { (goal.0, goal.1) };
    let goal = (goal_line == line).then_some(goal_position);
    if d < 4 { scan_up(lines, line, position, goal) } else { scan_down(lines, line, position, goal) }
}

/// Scans a line towards higher positions.
fn scan_up(lines: &Lines, line: i32, from: i32, goal: Option<i32>) -> Option<u32> {
    // The last bit of a window can only be tested together with its successor, which is in the next window.
    const STEP: i32 = WINDOW as i32 - 1;
    let mut at = from;
    loop {
        let (beside, here, other) =
            (lines.window(line - 1, at), lines.window(line, at), lines.window(line + 1, at));
        let forced = beside & !(beside << 1) | other & !(other << 1);
        // Bit 0 is the position of the scan.
        let stops = (forced | !here) & ((1 << WINDOW) - 2);
        let first = if stops == 0 { STEP + 1 } else { stops.trailing_zeros() as i32 };
        if let Some(goal) = goal.filter(|&g| g > at && g < at + first) {
            return Some((goal - from) as u32);
        }
        if stops != 0 {
            return (here >> first & 1 != 0).then_some((at + first - from) as u32);
        }
        at += STEP;
    }
}

/// Scans a line towards lower positions.
fn scan_down(lines: &Lines, line: i32, from: i32, goal: Option<i32>) -> Option<u32> {
    const STEP: i32 = WINDOW as i32 - 1;
    let mut at = from;
    loop {
        // Bit STEP is the position of the scan. The blocked cell before the first one ends every scan within one
        // window.
        let begin = at - STEP;
        let (beside, here, other) =
            (lines.window(line - 1, begin), lines.window(line, begin), lines.window(line + 1, begin));
        let forced = beside & !(beside >> 1) | other & !(other >> 1);
        let stops = (forced | !here) & ((1 << STEP) - 1);
        let first = if stops == 0 { STEP + 1 } else { STEP - (63 - stops.leading_zeros() as i32) };
        if let Some(goal) = goal.filter(|&g| g < at && g > at - first) {
            return Some((from - goal) as u32);
        }
        if stops != 0 {
            return (here >> (STEP - first) & 1 != 0).then_some((from - at + first) as u32);
        }
        at -= STEP;
    }
}
