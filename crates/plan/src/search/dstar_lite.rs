//! D* Lite (Koenig and Likhachev, "D* Lite", AAAI 2002, figure 4): the shortest path to a fixed goal is repaired
//! instead of searched again when cells open or close and while the start moves along.
//!
//! Names are those of the paper: `g` is the cost from a cell to the goal at its last expansion, `rhs` the one-step
//! lookahead of it, `km` the key offset for the motion of the start. Entries of the queue are not changed in place; an
//! entry whose key is not the current key of its cell is skipped.

use super::moves::steps_possible;
use super::{DIAGONAL, GridPath, NoPath, Place, STEPS, STRAIGHT, check, check_end, octile, pack, unpack};
use crate::grid::Cell;
use crate::passable::Passable;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

const INFINITE: u64 = u64::MAX / 4;

/// An incremental search with a fixed goal and a moving start. 32 bytes per cell.
pub struct DStarLite {
    passable: Passable,
    nodes: Vec<Node>,
    queue: BinaryHeap<Reverse<(u64, u64, u32)>>,
    start: (i32, i32),
    goal: (i32, i32),
    km: u64,
}

#[derive(Clone, Copy)]
struct Node {
    g: u64,
    rhs: u64,
    /// Key of the valid entry in the queue; `None` when the cell is not in it.
    key: Option<(u64, u64)>,
}

impl DStarLite {
    /// Prepares the search; nothing is expanded yet.
    ///
    /// # Errors
    /// When start or goal is outside or blocked.
    pub fn new(passable: Passable, start: Cell, goal: Cell) -> Result<Self, NoPath> {
        check(&passable, start, goal)?;
        let nodes = vec![Node { g: INFINITE, rhs: INFINITE, key: None }; passable.frame().len()];
        let (start, goal) = ((start.x as i32, start.y as i32), (goal.x as i32, goal.y as i32));
        let mut search = Self { passable, nodes, queue: BinaryHeap::new(), start, goal, km: 0 };
        let index = search.index(goal);
        search.nodes[index].rhs = 0;
        search.enqueue(goal);
        Ok(search)
    }

    /// The passable cells, as this search knows them.
    pub fn passable(&self) -> &Passable {
        &self.passable
    }

    /// Moves the start to the current cell of the robot.
    ///
    /// # Errors
    /// When that cell is outside or blocked; the start stays where it was.
    pub fn move_start(&mut self, start: Cell) -> Result<(), NoPath> {
        check_end(&self.passable, Place::Start, start)?;
        let to = (start.x as i32, start.y as i32);
        self.km += octile(self.start.0, self.start.1, to.0, to.1);
        self.start = to;
        Ok(())
    }

    /// Opens or closes cells. Cells outside and cells already in that state are ignored; returns how many changed.
    pub fn change(&mut self, cells: &[(Cell, bool)]) -> usize {
        let mut changed = 0;
        for &(cell, free) in cells {
            if !self.passable.set(cell, free) {
                continue;
            }
            changed += 1;
            // Every step that this cell allows or forbids connects two cells of its 3 x 3 block.
            let (x, y) = (cell.x as i32, cell.y as i32);
            for (dx, dy) in STEPS.into_iter().chain([(0, 0)]) {
                let at = (x + dx, y + dy);
                if self.inside(at) {
                    self.renew(at);
                }
            }
        }
        changed
    }

    /// The shortest path from the current start; it is as long as that of [`super::AStar`] on the same cells.
    ///
    /// # Errors
    /// When start or goal is now blocked, or the goal cannot be reached.
    pub fn path(&mut self) -> Result<GridPath, NoPath> {
        let cell = |(x, y): (i32, i32)| Cell::new(x as u32, y as u32);
        check(&self.passable, cell(self.start), cell(self.goal))?;
        let expanded = self.settle();
        let (mut at, mut cells) = (self.start, vec![cell(self.start)]);
        if self.nodes[self.index(at)].rhs >= INFINITE {
            return Err(NoPath::Unreachable { expanded });
        }
        while at != self.goal {
            let next = self.steps(at).min_by_key(|&(next, step)| step + self.nodes[self.index(next)].g);
            // The cost to the goal falls with each step, so this ends.
            let Some((next, _)) = next else { return Err(NoPath::Unreachable { expanded }) };
            at = next;
            cells.push(cell(at));
        }
        Ok(GridPath::of(cells, expanded))
    }

    /// `ComputeShortestPath`. Returns how many nodes were expanded.
    fn settle(&mut self) -> usize {
        let mut expanded = 0;
        while let Some(&Reverse((k1, k2, word))) = self.queue.peek() {
            let start = self.nodes[self.index(self.start)];
            if (k1, k2) >= self.key(self.start) && start.rhs == start.g {
                break;
            }
            self.queue.pop();
            let at = unpack(word);
            let index = self.index(at);
            if self.nodes[index].key != Some((k1, k2)) {
                continue;
            }
            self.nodes[index].key = None;
            if (k1, k2) < self.key(at) {
                self.enqueue(at);
                continue;
            }
            expanded += 1;
            let Node { g, rhs, .. } = self.nodes[index];
            let around: Vec<_> = self.steps(at).collect();
            if g > rhs {
                self.nodes[index].g = rhs;
                for (next, step) in around {
                    let beside = self.index(next);
                    if next != self.goal && rhs + step < self.nodes[beside].rhs {
                        self.nodes[beside].rhs = rhs + step;
                        self.enqueue(next);
                    }
                }
            } else {
                self.nodes[index].g = INFINITE;
                self.renew(at);
                around.into_iter().for_each(|(next, _)| self.renew(next));
            }
        }
        expanded
    }

    /// `UpdateVertex`: computes `rhs` again and queues the cell if it differs from `g`.
    fn renew(&mut self, at: (i32, i32)) {
        let index = self.index(at);
        if at != self.goal {
            let best = self.steps(at).map(|(next, step)| step + self.nodes[self.index(next)].g).min();
            self.nodes[index].rhs = best.unwrap_or(INFINITE).min(INFINITE);
        }
        self.enqueue(at);
    }

    /// Puts a cell into the queue with its current key if it is inconsistent (`g` differs from `rhs`), else removes it.
    fn enqueue(&mut self, at: (i32, i32)) {
        let index = self.index(at);
        let node = self.nodes[index];
        let key = (node.g != node.rhs).then(|| self.key(at));
        self.nodes[index].key = key;
        if let Some((k1, k2)) = key.filter(|_| key != node.key) {
            self.queue.push(Reverse((k1, k2, pack(at.0, at.1))));
        }
    }

    fn key(&self, at: (i32, i32)) -> (u64, u64) {
        let node = self.nodes[self.index(at)];
        let cost = node.g.min(node.rhs);
        (cost + octile(self.start.0, self.start.1, at.0, at.1) + self.km, cost)
    }

    /// The possible steps from a cell, with their costs; the same steps lead to it. None from a blocked cell.
    fn steps(&self, at: (i32, i32)) -> impl Iterator<Item = ((i32, i32), u64)> + use<> {
        let free = self.passable.at(at.0, at.1);
        let directions = if free { steps_possible(self.passable.neighbours(at.0, at.1)) } else { 0 };
        (0..8).filter(move |d| directions >> d & 1 != 0).map(move |d: usize| {
            let next = (at.0 + STEPS[d].0, at.1 + STEPS[d].1);
            (next, if d % 2 == 1 { DIAGONAL } else { STRAIGHT })
        })
    }

    fn inside(&self, (x, y): (i32, i32)) -> bool {
        let frame = self.passable.frame();
        x >= 0 && y >= 0 && x < frame.width() as i32 && y < frame.height() as i32
    }

    fn index(&self, (x, y): (i32, i32)) -> usize {
        y as usize * self.passable.frame().width() + x as usize
    }
}
