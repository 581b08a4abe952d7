//! Frontiers: where known free ground ends at unknown ground (Yamauchi, "A Frontier-Based Approach for Autonomous
//! Exploration", 1997). A robot that drives to them one after the other sees all that it can reach.
//!
//! Frontier cells are free and touch an unknown cell; connected ones form a frontier. The one with the shortest drive is
//! next. A frontier itself is often too near to walls to be entered, and its surroundings are seen from a little farther
//! away, so the robot is sent to the nearest reachable cell from which it sees the middle of the frontier close by.

use crate::grid::{Cell, Grid, GridFrame};
use crate::passable::Passable;
use crate::search::{DIAGONAL, STEPS, STRAIGHT, line_of_sight, steps_possible};
use cairn_geometry::Vec2;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What counts as a frontier, and how it is approached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontierConfig {
    /// Frontiers of fewer cells are ignored: nothing fits through them.
    pub min_cells: usize,
    /// A frontier counts as reachable when a reachable cell is this near, in metres. The robot is not sent nearer than it
    /// must.
    pub approach_m: f64,
}

impl Default for FrontierConfig {
    fn default() -> Self {
        Self { min_cells: 14, approach_m: 0.8 }
    }
}

/// A connected part of the border between free and unknown ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Frontier {
    /// Its cells, in the order in which they were found.
    pub cells: Vec<Cell>,
    /// The cell of the frontier that is nearest to the mean of all of them, in metres, world.
    pub middle: Vec2,
}

/// A frontier that can be approached.
#[derive(Clone, Debug, PartialEq)]
pub struct Approach {
    /// The frontier.
    pub frontier: Frontier,
    /// Where to drive, in metres, world.
    pub goal: Vec2,
    /// Length of the drive over the grid, in metres.
    pub drive_m: f64,
}

/// All frontiers of a map with values of a ROS `OccupancyGrid` (0 free, 100 occupied, negative unknown).
pub fn frontiers(map: &Grid<i8>, config: &FrontierConfig) -> Vec<Frontier> {
    let frame = *map.frame();
    let is_frontier = |cell: Cell| {
        let unknown = |c: Cell| map.get(c).is_some_and(|v| v < 0);
        map.get(cell) == Some(0) && straight_neighbours(cell).any(unknown)
    };
    let mut seen = vec![false; frame.len()];
    let mut found = Vec::new();
    for index in 0..frame.len() {
        let first = frame.cell(index);
        if seen[index] || !is_frontier(first) {
            continue;
        }
        seen[index] = true;
        let (mut cells, mut next) = (vec![first], 0);
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for to in neighbours(cell) {
                if let Some(i) = frame.index(to).filter(|&i| !seen[i])
                    && is_frontier(to)
                {
                    seen[i] = true;
                    cells.push(to);
                }
            }
        }
        if cells.len() >= config.min_cells {
            let middle = middle_of(&frame, &cells);
            found.push(Frontier { cells, middle });
        }
    }
    found
}

/// The frontiers of a map that can be approached from a cell over passable ground, the shortest drive first.
pub fn approaches(
    map: &Grid<i8>,
    frontiers: Vec<Frontier>,
    passable: &Passable,
    from: Cell,
    config: &FrontierConfig,
) -> Vec<Approach> {
    let frame = *passable.frame();
    let drive = drive_lengths(passable, from);
    let seen_free = Passable::from_values(map, |v| v == 0);
    let reach = (config.approach_m / frame.resolution_m()).ceil() as i32;
    let around = |cell: Cell| {
        let offsets = (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (dx, dy)));
        offsets.map(move |(dx, dy)| shifted(cell, dx, dy))
    };
    let best_for = |target: Cell| {
        let away = |c: Cell| (frame.centre(c) - frame.centre(target)).norm();
        let reachable = around(target).filter_map(|c| {
            let length = *drive.get(frame.index(c)?)?;
            (length != u64::MAX && away(c) <= config.approach_m).then_some((c, length, away(c)))
        });
        let reachable: Vec<(Cell, u64, f64)> = reachable.collect();
        let in_view = reachable.iter().filter(|(c, _, _)| line_of_sight(&seen_free, *c, target));
        let soonest = in_view.min_by_key(|(c, length, _)| (*length, c.y, c.x));
        let nearest = || reachable.iter().min_by(|a, b| a.2.total_cmp(&b.2).then(a.1.cmp(&b.1)));
        soonest.or_else(nearest).copied()
    };
    let approach = |frontier: Frontier| {
        let middle = frame.cell_at(frontier.middle).and_then(best_for);
        let any = || {
            let all = frontier.cells.iter().step_by(4).filter_map(|&c| best_for(c));
            all.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)))
        };
        let (cell, length, _) = middle.or_else(any)?;
        let drive_m = length as f64 / STRAIGHT as f64 * frame.resolution_m();
        Some(Approach { goal: frame.centre(cell), drive_m, frontier })
    };
    let mut approaches: Vec<Approach> = frontiers.into_iter().filter_map(approach).collect();
    approaches.sort_by(|a, b| a.drive_m.total_cmp(&b.drive_m));
    approaches
}

/// Length of the shortest drive from a cell to every other one (Dijkstra 1959), in units of the searches; `u64::MAX`
/// where there is none.
pub(crate) fn drive_lengths(passable: &Passable, from: Cell) -> Vec<u64> {
    let frame = *passable.frame();
    let mut lengths = vec![u64::MAX; frame.len()];
    let Some(start) = frame.index(from) else { return lengths };
    lengths[start] = 0;
    let mut queue = BinaryHeap::from([Reverse((0u64, start as u32))]);
    while let Some(Reverse((length, index))) = queue.pop() {
        if lengths[index as usize] < length {
            continue;
        }
        let cell = frame.cell(index as usize);
        let near = neighbours(cell).enumerate();
        let free = near.fold(0u8, |bits, (k, c)| bits | u8::from(passable.is_free(c)) << k);
        let possible = steps_possible(free);
        for (k, to) in neighbours(cell).enumerate().filter(|(k, _)| possible >> k & 1 != 0) {
            let longer = length + if k % 2 == 1 { DIAGONAL } else { STRAIGHT };
            if let Some(i) = frame.index(to).filter(|&i| longer < lengths[i]) {
                lengths[i] = longer;
                queue.push(Reverse((longer, i as u32)));
            }
        }
    }
    lengths
}

fn middle_of(frame: &GridFrame, cells: &[Cell]) -> Vec2 {
    let mean = cells.iter().map(|&c| frame.centre(c)).sum::<Vec2>() / cells.len().max(1) as f64;
    let away = |c: &Vec2| (c - mean).norm_squared();
    let centres = cells.iter().map(|&c| frame.centre(c));
    centres.min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(mean)
}

/// The neighbour at an offset; far outside the grid where it would be negative.
fn shifted(cell: Cell, dx: i32, dy: i32) -> Cell {
    Cell::new(cell.x.wrapping_add_signed(dx), cell.y.wrapping_add_signed(dy))
}

/// The eight neighbours in the order of [`STEPS`].
fn neighbours(cell: Cell) -> impl Iterator<Item = Cell> {
    STEPS.into_iter().map(move |(dx, dy)| shifted(cell, dx, dy))
}

fn straight_neighbours(cell: Cell) -> impl Iterator<Item = Cell> {
    STEPS.into_iter().step_by(2).map(move |(dx, dy)| shifted(cell, dx, dy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Se2;

    /// `.` free, `#` occupied, anything else unknown; the first line is the row of greatest y.
    fn map(rows: &[&str]) -> Grid<i8> {
        let frame = GridFrame::new(rows[0].len(), rows.len(), 0.1, Se2::identity()).unwrap();
        let value = |b: u8| match b {
            b'.' => 0,
            b'#' => 100,
            _ => -1,
        };
        let values = rows.iter().rev().flat_map(|r| r.bytes().map(value)).collect();
        Grid::from_values(frame, values).unwrap()
    }

    fn passable(map: &Grid<i8>) -> Passable {
        Passable::from_values(map, |v| v == 0)
    }

    #[test]
    fn a_doorway_to_unknown_ground_is_a_frontier_and_a_wall_is_none() {
        let rows = [
            "######### ",
            "#......#  ",
            "#.......  ",
            "#.......  ",
            "#.......  ",
            "#......#  ",
            "######### ",
        ];
        let config = FrontierConfig { min_cells: 1, ..FrontierConfig::default() };
        let cut = map(&rows.map(|r| &r[..8]));
        assert!(frontiers(&cut, &config).is_empty(), "the edge of the grid is not unknown ground");
        let map = map(&rows);
        let found = frontiers(&map, &config);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].cells, [2, 3, 4].map(|y| Cell::new(7, y)));
        // Two cells from the frontier it is seen close enough.
        let close = FrontierConfig { approach_m: 0.21, ..config };
        let near = approaches(&map, found, &passable(&map), Cell::new(1, 3), &close);
        assert_eq!(map.frame().cell_at(near[0].goal), Some(Cell::new(5, 3)));
        assert!((near[0].drive_m - 0.4).abs() < 1e-9, "{}", near[0].drive_m);
        let strict = FrontierConfig { min_cells: 4, ..config };
        assert!(frontiers(&map, &strict).is_empty());
    }

    #[test]
    fn the_nearest_comes_first_and_what_cannot_be_reached_is_left_out() {
        let map = map(&[
            " .......................#.. ",
            " .......................#.. ",
            " .......................#.. ",
        ]);
        let config = FrontierConfig { min_cells: 3, approach_m: 0.25 };
        let found = frontiers(&map, &config);
        assert_eq!(found.len(), 2, "{found:?}");
        let near = approaches(&map, found, &passable(&map), Cell::new(8, 1), &config);
        assert_eq!(near.len(), 1, "the ground behind the wall cannot be reached");
        assert!(near[0].goal.x < 0.4, "{}", near[0].goal);
        // From a cell that is not in the grid nothing can be reached.
        assert!(
            approaches(&map, frontiers(&map, &config), &passable(&map), Cell::new(99, 0), &config).is_empty()
        );
    }
}
