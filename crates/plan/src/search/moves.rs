//! Which neighbours of a cell must be searched, given the direction of arrival.
//!
//! Pruning of Harabor and Grastien, "Online Graph Pruning for Pathfinding on Grid Maps" (2011), definitions 1 and 2,
//! for moves that cut no corner: a neighbour is pruned when it can be reached from the previous cell without the middle
//! cell, by a path that is shorter, or as long with its diagonal step earlier. The table is computed from that
//! definition over every 3 x 3 block, so no special rules for corners are needed.

use super::{DIAGONAL, STEPS, STRAIGHT};

/// Direction of arrival of a start cell.
pub(crate) const NOWHERE: u8 = 8;

/// For each direction of arrival and each set of free neighbours: the directions in which to continue.
pub(crate) struct Moves {
    table: Vec<[u8; 256]>,
}

impl Moves {
    pub(crate) fn new() -> Self {
        let mut table = vec![[0; 256]; 9];
        for (arrival, row) in table.iter_mut().enumerate() {
            for (free, moves) in row.iter_mut().enumerate() {
                let possible = steps_possible(free as u8);
                let kept = |d: u8| arrival == NOWHERE as usize || is_kept(arrival, d, free as u8);
                *moves = (0..8).filter(|&d| possible >> d & 1 != 0 && kept(d)).fold(0, |m, d| m | 1 << d);
            }
        }
        Self { table }
    }

    /// The directions in which to continue, as bits.
    #[inline(always)]
    pub(crate) fn after(&self, arrival: u8, free: u8) -> u8 {
        self.table.get(arrival as usize).map_or(0, |row| row[free as usize])
    }
}

/// The directions in which a step is possible, given the free neighbours: a diagonal one needs both adjacent ones.
#[inline(always)]
pub(crate) fn steps_possible(free: u8) -> u8 {
    let straight = free & 0b0101_0101;
    // Diagonal `d` is between `d - 1` and `d + 1`.
    let beside = straight.rotate_left(1) & straight.rotate_right(1);
    straight | free & beside & 0b1010_1010
}

/// Whether the neighbour in direction `d` is best reached through the middle, after arrival in direction `arrival`.
fn is_kept(arrival: usize, d: u8, free: u8) -> bool {
    let (dx, dy) = STEPS[arrival];
    let from = (-dx, -dy);
    let to = STEPS[d as usize];
    if from == to {
        return false;
    }
    let step = |diagonal: bool| if diagonal { DIAGONAL } else { STRAIGHT };
    let through = step(arrival % 2 == 1) + step(d % 2 == 1);
    match shortest_around(from, to, free) {
        None => true,
        Some((around, _)) if around != through => around > through,
        // Equal length: the path whose diagonal step comes first is kept.
        Some((_, diagonal_first)) => arrival % 2 == 1 || !diagonal_first,
    }
}

/// Cost of the shortest path between two cells of the 3 x 3 block that does not enter the middle, and whether one of
/// that cost begins with a diagonal step. The cell `from` counts as free.
fn shortest_around(from: (i32, i32), to: (i32, i32), free: u8) -> Option<(u64, bool)> {
    let bit = |c: (i32, i32)| STEPS.iter().position(|&s| s == c);
    // The middle is free: a diagonal step may pass beside it.
    let is_free = |c: (i32, i32)| c == (0, 0) || c == from || bit(c).is_some_and(|b| free >> b & 1 != 0);
    let inside = |c: (i32, i32)| c.0.abs() <= 1 && c.1.abs() <= 1 && c != (0, 0);
    // Cost and whether the first step was diagonal; relaxed until nothing changes.
    let mut best = [None::<(u64, bool)>; 8];
    let mut queue = vec![(from, 0u64, None::<bool>)];
    while let Some((at, cost, first)) = queue.pop() {
        for (d, (dx, dy)) in STEPS.into_iter().enumerate() {
            let next = (at.0 + dx, at.1 + dy);
            let beside = is_free((next.0, at.1)) && is_free((at.0, next.1));
            if !inside(next) || next == from || !is_free(next) || (d % 2 == 1 && !beside) {
                continue;
            }
            let cost = cost + if d % 2 == 1 { DIAGONAL } else { STRAIGHT };
            let first = first.unwrap_or(d % 2 == 1);
            let Some(place) = bit(next).map(|b| &mut best[b]) else { continue };
            if place.is_none_or(|(c, f)| cost < c || (cost == c && first && !f)) {
                *place = Some((cost, first));
                queue.push((next, cost, Some(first)));
            }
        }
    }
    bit(to).and_then(|b| best[b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_ground_is_pruned_as_in_the_paper() {
        let moves = Moves::new();
        assert_eq!(moves.after(0, 0xFF), 0b0000_0001, "straight goes straight on");
        assert_eq!(moves.after(1, 0xFF), 0b0000_0111, "diagonal goes on, and to both sides of it");
        assert_eq!(moves.after(NOWHERE, 0xFF), 0xFF);
    }

    #[test]
    fn a_corner_that_ends_forces_the_turn() {
        // Arrival towards the east; the cell north of the previous one is blocked.
        let free = !(1u8 << 3);
        assert_eq!(Moves::new().after(0, free), 0b0000_0111);
    }

    #[test]
    fn no_corner_is_cut() {
        assert_eq!(steps_possible(0xFF), 0xFF);
        assert_eq!(steps_possible(!1), !0b1000_0011, "east is blocked: neither north-east nor south-east");
    }
}
