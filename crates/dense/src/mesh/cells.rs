//! The triangles of a cell for each set of inside corners, by where the numbers of their vertices are.

use super::rows::corner_number;
use super::{corner_at, table};
use crate::block::SIDE;
use std::sync::LazyLock;

/// More than the vertices of any block, one on each edge, and than its triangles, with room behind the last for those who write several
/// at a time; powers of two.
pub const MOST_VERTICES: usize = 2048;
pub const MOST_TRIANGLES: usize = 4096;
const _: () = assert!(
    3 * SIDE * (SIDE + 1) * (SIDE + 1) + 16 < MOST_VERTICES && 5 * SIDE * SIDE * SIDE + 6 < MOST_TRIANGLES
);

/// The triangles of a cell.
#[derive(Clone)]
pub struct Triangles {
    pub count: usize,
    /// The edges on which their corners lie, three a triangle: four times the corner of the cell that the edge begins at, plus its
    /// axis.
    pub lanes: [u8; 16],
    /// The same in a [`super::VertexTable`], from the place of the cell on.
    places: [u16; 16],
}

impl Triangles {
    fn new(edges: &[[table::Edge; 3]]) -> Self {
        let (mut lanes, mut places) = ([0; 16], [0; 16]);
        for (i, &edge) in edges.as_flattened().iter().enumerate() {
            let (axis, corner) = table::edge_start(edge);
            lanes[i] = (4 * corner + axis) as u8;
            places[i] = (4 * corner_number(corner_at(corner)) + axis) as u16;
        }
        Self { count: edges.len(), lanes, places }
    }

    /// The places of the three corners of each.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = [u16; 3]> + '_ {
        self.places.chunks_exact(3).take(self.count).map(|t| [t[0], t[1], t[2]])
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
