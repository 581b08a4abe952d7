//! Lazy Theta* (Nash, Koenig and Tovey, "Lazy Theta*: Any-Angle Path Planning and Path Length Analysis in 3D", 2010):
//! any-angle paths whose successive corners are in line of sight. Not always the shortest such path, but never longer
//! than the grid path through the same corners, and seldom more than one percent longer than the shortest.

use super::moves::steps_possible;
use super::{GridPath, NoPath, STEPS, check, distance, pack, unpack};
use crate::grid::Cell;
use crate::passable::Passable;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Lazy Theta* that reuses its memory from search to search: 24 bytes per cell.
#[derive(Default)]
pub struct LazyTheta {
    nodes: Vec<Node>,
    generation: u32,
    queue: BinaryHeap<Reverse<(u64, u32)>>,
}

#[derive(Clone, Copy, Default)]
struct Node {
    cost: f64,
    parent: u32,
    generation: u32,
    done: bool,
}

impl LazyTheta {
    /// A search without memory; the first search allocates it.
    pub fn new() -> Self {
        Self::default()
    }

    /// A short path between two cells that need not follow the grid: only its corners are given. Between two corners
    /// every cell that the line touches may be entered ([`line_of_sight`]).
    ///
    /// # Errors
    /// When an end is outside or blocked, or the goal cannot be reached.
    pub fn search(&mut self, passable: &Passable, start: Cell, goal: Cell) -> Result<GridPath, NoPath> {
        check(passable, start, goal)?;
        let width = passable.frame().width();
        let index = |c: Cell| c.y as usize * width + c.x as usize;
        self.begin(passable.frame().len());
        self.offer(index(start), start, start, 0.0, goal);
        let mut expanded = 0;
        while let Some(Reverse((_, word))) = self.queue.pop() {
            let (x, y) = unpack(word);
            let at = Cell::new(x as u32, y as u32);
            if self.nodes[index(at)].done {
                continue;
            }
            self.settle(passable, at, width);
            expanded += 1;
            if at == goal {
                return Ok(GridPath::of(self.trace(start, goal, width), expanded));
            }
            let Node { cost, parent, .. } = self.nodes[index(at)];
            let parent = cell_of(parent);
            // Line of sight to the grandparent is assumed; `settle` checks it when the cell is expanded.
            let from_cost = cost - distance(parent, at);
            for next in neighbours(passable, at) {
                self.offer(index(next), next, parent, from_cost + distance(parent, next), goal);
            }
        }
        Err(NoPath::Unreachable { expanded })
    }

    fn begin(&mut self, cells: usize) {
        self.generation = self.generation.wrapping_add(1);
        if self.nodes.len() != cells || self.generation == 0 {
            self.nodes.clear();
            self.nodes.resize(cells, Node::default());
            self.generation = 1;
        }
        self.queue.clear();
    }

    fn offer(&mut self, index: usize, at: Cell, parent: Cell, cost: f64, goal: Cell) {
        let node = &mut self.nodes[index];
        let fresh = node.generation != self.generation;
        if fresh || (!node.done && cost < node.cost - 1e-12) {
            let parent = pack(parent.x as i32, parent.y as i32);
            *node = Node { cost, parent, generation: self.generation, done: false };
            // The bits of positive floats have the order of the floats.
            self.queue.push(Reverse(((cost + distance(at, goal)).to_bits(), pack(at.x as i32, at.y as i32))));
        }
    }

    /// Expands a cell: without line of sight to its assumed parent, its best expanded neighbour becomes its parent.
    fn settle(&mut self, passable: &Passable, at: Cell, width: usize) {
        let index = |c: Cell| c.y as usize * width + c.x as usize;
        self.nodes[index(at)].done = true;
        if line_of_sight(passable, cell_of(self.nodes[index(at)].parent), at) {
            return;
        }
        let mut best = (f64::INFINITY, at);
        for next in neighbours(passable, at) {
            let node = &self.nodes[index(next)];
            let cost = node.cost + distance(next, at);
            if node.generation == self.generation && node.done && cost < best.0 {
                best = (cost, next);
            }
        }
        let node = &mut self.nodes[index(at)];
        (node.cost, node.parent) = (best.0, pack(best.1.x as i32, best.1.y as i32));
    }

    fn trace(&self, start: Cell, goal: Cell, width: usize) -> Vec<Cell> {
        let mut cells = vec![goal];
        while let Some(&at) = cells.last().filter(|&&at| at != start) {
            cells.push(cell_of(self.nodes[at.y as usize * width + at.x as usize].parent));
        }
        cells.reverse();
        cells
    }
}

fn cell_of(word: u32) -> Cell {
    let (x, y) = unpack(word);
    Cell::new(x as u32, y as u32)
}

/// The cells that can be reached in one step.
fn neighbours(passable: &Passable, at: Cell) -> impl Iterator<Item = Cell> {
    let directions = steps_possible(passable.neighbours(at.x as i32, at.y as i32));
    (0..8).filter(move |d| directions >> d & 1 != 0).map(move |d| {
        let (dx, dy) = STEPS[d];
        Cell::new(at.x.wrapping_add_signed(dx), at.y.wrapping_add_signed(dy))
    })
}

/// Whether every cell that the line between two cell centres touches may be entered; where the line passes exactly
/// through a corner, both cells beside it count.
pub fn line_of_sight(passable: &Passable, a: Cell, b: Cell) -> bool {
    if !passable.is_free(a) || !passable.is_free(b) {
        return false;
    }
    let (dx, dy) = (i64::from(a.x.abs_diff(b.x)), i64::from(a.y.abs_diff(b.y)));
    let (step_x, step_y) = (if b.x > a.x { 1 } else { -1 }, if b.y > a.y { 1 } else { -1 });
    let (mut x, mut y) = (a.x as i32, a.y as i32);
    // Which border of the cell is crossed first: positive the one across x, negative that across y.
    let mut lead = dx - dy;
    while (x, y) != (b.x as i32, b.y as i32) {
        match lead.signum() {
            1 => (x, lead) = (x + step_x, lead - 2 * dy),
            -1 => (y, lead) = (y + step_y, lead + 2 * dx),
            _ => {
                if !passable.at(x + step_x, y) || !passable.at(x, y + step_y) {
                    return false;
                }
                (x, y, lead) = (x + step_x, y + step_y, lead + 2 * dx - 2 * dy);
            }
        }
        if !passable.at(x, y) {
            return false;
        }
    }
    true
}
