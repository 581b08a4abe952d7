//! The way out for a body that stands too near to an obstacle: following is not exact, and a map that is laid again moves its walls.
//!
//! In: costs, and the cell of the body. Out: the cells to the nearest free one (Dijkstra 1959), on which the body comes no nearer to an
//! obstacle than it already is.

use crate::costmap::Costmap;
use crate::grid::Cell;
use crate::search::{BLOCKED, DIAGONAL, STEPS, STRAIGHT};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// The cells from that of the body, included, to the nearest free one, at most `longest_m` metres away; only the cell of the body where
/// that is free. `None` where the body stands on an obstacle or on ground that may not be entered, or where no free cell is near enough.
pub fn way_out(costs: &Costmap, from: Cell, longest_m: f64) -> Option<Vec<Cell>> {
    let frame = costs.frame();
    let squared = |cell: Cell| frame.index(cell).and_then(|i| costs.field().squared().get(i)).copied();
    let least = squared(from).filter(|s| *s > 0)?;
    let longest = (longest_m / frame.resolution_m() * STRAIGHT as f64) as u64;
    let start = frame.index(from)?;
    let mut reached = BTreeMap::from([(start, (0u64, start))]);
    let mut queue = BinaryHeap::from([Reverse((0u64, start))]);
    while let Some(Reverse((length, index))) = queue.pop() {
        let cell = frame.cell(index);
        if costs.costs().get(cell).is_some_and(|cost| cost != BLOCKED) {
            return Some(traced(&reached, index).into_iter().map(|i| frame.cell(i)).collect());
        }
        for (k, (dx, dy)) in STEPS.into_iter().enumerate() {
            let to = Cell::new(cell.x.wrapping_add_signed(dx), cell.y.wrapping_add_signed(dy));
            let longer = length + if k % 2 == 1 { DIAGONAL } else { STRAIGHT };
            let Some(i) = frame.index(to).filter(|_| longer <= longest && squared(to) >= Some(least)) else {
                continue;
            };
            if reached.get(&i).is_none_or(|(known, _)| longer < *known) {
                reached.insert(i, (longer, index));
                queue.push(Reverse((longer, i)));
            }
        }
    }
    None
}

/// The cells on the way to one, from the first on.
fn traced(reached: &BTreeMap<usize, (u64, usize)>, to: usize) -> Vec<usize> {
    let mut cells = vec![to];
    while let Some((_, before)) =
        cells.last().and_then(|at| reached.get(at)).filter(|(length, _)| *length > 0)
    {
        cells.push(*before);
    }
    cells.reverse();
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::CostConfig;
    use crate::grid::{Grid, GridFrame};
    use cairn_geometry::Se2;

    /// Cells of 5 cm: a wall along x = 0, and one across it from y = `shelf` on, as far as x = 1 m.
    fn corner(shelf: u32) -> Costmap {
        let frame = GridFrame::new(60, 60, 0.05, Se2::identity()).unwrap();
        let mut map = Grid::filled(frame, 0i8);
        for y in 0..60 {
            (0..60)
                .filter(|x| *x == 0 || (y >= shelf && *x < 20))
                .for_each(|x| assert!(map.set(Cell::new(x, y), 100)));
        }
        Costmap::new(map, CostConfig::default()).unwrap()
    }

    #[test]
    fn the_way_out_leads_straight_from_the_wall_and_never_nearer_to_it() {
        let costs = corner(60);
        let out = way_out(&costs, Cell::new(1, 30), 0.6).unwrap();
        assert_eq!(out.first(), Some(&Cell::new(1, 30)));
        assert!(out.iter().all(|c| c.y == 30) && out.windows(2).all(|w| w[1].x == w[0].x + 1), "{out:?}");
        assert_ne!(costs.costs().get(*out.last().unwrap()), Some(BLOCKED));
        assert_eq!(way_out(&costs, Cell::new(30, 30), 0.6), Some(vec![Cell::new(30, 30)]), "it stands free");
        assert_eq!(way_out(&costs, Cell::new(1, 30), 0.2), None, "free ground is farther away");
        assert_eq!(way_out(&costs, Cell::new(0, 30), 0.6), None, "in the wall");
        assert_eq!(way_out(&costs, Cell::new(99, 0), 0.6), None, "outside");
        // In a corner neither wall comes nearer.
        let costs = corner(32);
        let out = way_out(&costs, Cell::new(2, 29), 0.8).unwrap();
        let to = |c: &Cell| costs.field().distance_m(*c).unwrap();
        assert!(
            out.iter().all(|c| to(c) >= to(&Cell::new(2, 29))) && to(out.last().unwrap()) > 0.28,
            "{out:?}"
        );
    }
}
