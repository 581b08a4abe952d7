//! The triangles of a cell for each set of inside corners, by where the numbers of their vertices are.

use super::rows::corner_number;
use super::{corner_at, table};
use crate::block::SIDE;
use std::sync::LazyLock;

/// More than the triangles of any block, with room behind the last for those who write several at a time; a power of two.
pub const MOST_TRIANGLES: usize = 4096;
const _: () = assert!(5 * SIDE * SIDE * SIDE + 6 < MOST_TRIANGLES);

/// The triangles of a cell.
#[derive(Clone)]
#[repr(C, align(32))]
pub struct Triangles {
    /// The edges on which their corners lie, three a triangle: four times the corner of the cell that the edge begins at, plus its
    /// axis.
    pub lanes: [u16; 15],
    /// How many there are.
    pub count: u16,
}

/// From the place of a cell to those of its edges, by lane.
static PLACES: LazyLock<[u16; 32]> =
    LazyLock::new(|| std::array::from_fn(|lane| (4 * corner_number(corner_at(lane / 4)) + lane % 4) as u16));

impl Triangles {
    fn new(edges: &[[table::Edge; 3]]) -> Self {
        let mut lanes = [0; 15];
        for (lane, &edge) in lanes.iter_mut().zip(edges.as_flattened()) {
            let (axis, corner) = table::edge_start(edge);
            *lane = (4 * corner + axis) as u16;
        }
        Self { lanes, count: edges.len() as u16 }
    }

    /// The places of the three corners of each, from the place of the cell on.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = [u16; 3]> + '_ {
        let places: &'static [u16; 32] = &PLACES;
        let of = |lane: u16| places[usize::from(lane) % 32];
        self.lanes.chunks_exact(3).take(self.count.into()).map(move |t| [of(t[0]), of(t[1]), of(t[2])])
    }
}

/// By the set of inside corners.
pub static CELLS: LazyLock<Box<[Triangles; 256]>> =
    LazyLock::new(|| Box::new(std::array::from_fn(|inside| Triangles::new(&table::TRIANGLES[inside]))));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_has_more_than_five_triangles() {
        assert_eq!(CELLS.iter().map(|t| t.count).max(), Some(5));
    }
}
