//! Columns as `cairn-web` sends them (its `columns.rs` has the format): what is free and what is occupied above each cell of the
//! ground, in tiles.

use crate::read::{Malformed, Reader};
use crate::surface::Block;
use crate::vector::{V3, add, scaled};
use std::collections::BTreeMap;

/// Cells along the edge of a tile.
pub const TILE: i32 = 16;
/// A box is so much of its cell wide, so that boxes are told apart.
const FILLED: f32 = 0.92;

/// A vertical span that is entirely free or entirely occupied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Its lower and upper end in steps.
    pub ends: [i32; 2],
    /// Else it is free.
    pub is_occupied: bool,
}

/// Cells that are sent at once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tile {
    /// Seconds from the beginning until it was there.
    pub born_s: f32,
    /// The spans of each cell from below, row by row.
    pub cells: Vec<Vec<Run>>,
    /// Another whenever it has changed, and of no other tile.
    pub version: u64,
}

/// All columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Two directions in the ground and up, in the map.
    pub axes: [V3; 3],
    /// Edge of a cell.
    pub cell_m: f32,
    /// Height of a step.
    pub step_m: f32,
    /// By their places, in edges of a tile.
    pub tiles: BTreeMap<[i32; 2], Tile>,
    versions: u64,
}

impl Columns {
    /// Takes a message of kind 4.
    ///
    /// # Errors
    /// One that is cut off or too long.
    pub fn take(&mut self, message: &[u8]) -> Result<(), Malformed> {
        let mut r = Reader(message);
        let [_, whole, ..] = r.bytes::<4>()?;
        if whole == 1 {
            *self = Self { versions: self.versions, ..Self::default() };
        }
        self.axes = [r.floats()?, r.floats()?, r.floats()?];
        (self.cell_m, self.step_m) = (r.float()?, r.float()?);
        r.each(|r| {
            self.tiles.remove(&[r.signed()?, r.signed()?]);
            Ok(())
        })?;
        r.each(|r| {
            let at = [r.signed()?, r.signed()?];
            self.versions += 1;
            let (base, born_s) = (r.signed()?, r.number()? as f32 / 10.0);
            let cells = (0..TILE * TILE).map(|_| runs(r, base)).collect::<Result<_, _>>()?;
            self.tiles.insert(at, Tile { born_s, cells, version: self.versions });
            Ok(())
        })?;
        r.end()
    }

    /// All spans of a tile: the middle of the cell in the ground, and the span.
    fn spans<'a>(&self, at: [i32; 2], tile: &'a Tile) -> impl Iterator<Item = ([f32; 2], Run)> + 'a {
        let cell_m = self.cell_m;
        tile.cells.iter().zip(0..).flat_map(move |(runs, k): (_, i32)| {
            let middle =
                [TILE * at[0] + k % TILE, TILE * at[1] + k / TILE].map(|c| (c as f32 + 0.5) * cell_m);
            runs.iter().map(move |run| (middle, *run))
        })
    }

    fn in_map(&self, x: f32, y: f32, z: f32) -> V3 {
        add(add(scaled(self.axes[0], x), scaled(self.axes[1], y)), scaled(self.axes[2], z))
    }

    /// The middles of the upper ends of all occupied spans, in the map.
    pub fn corners(&self) -> Vec<V3> {
        let of = |(at, tile): (&[i32; 2], &_)| self.spans(*at, tile).collect::<Vec<_>>();
        let occupied = self.tiles.iter().flat_map(of).filter(|(_, run)| run.is_occupied);
        occupied.map(|([x, y], run)| self.in_map(x, y, run.ends[1] as f32 * self.step_m)).collect()
    }

    /// A line in the middle of each free span, in the map.
    pub fn free(&self) -> Vec<[V3; 2]> {
        let of = |(at, tile): (&[i32; 2], &_)| self.spans(*at, tile).collect::<Vec<_>>();
        let free = self.tiles.iter().flat_map(of).filter(|(_, run)| !run.is_occupied);
        free.map(|([x, y], run)| run.ends.map(|z| self.in_map(x, y, z as f32 * self.step_m))).collect()
    }

    /// A box for each occupied span of a tile, in the map.
    pub fn boxes(&self, at: [i32; 2], tile: &Tile) -> Block {
        let mut out = Block { born_s: tile.born_s, ..Block::default() };
        let half = FILLED * self.cell_m / 2.0;
        for ([x, y], run) in self.spans(at, tile).filter(|(_, run)| run.is_occupied) {
            let [low, high] = run.ends.map(|z| z as f32 * self.step_m);
            let centre = [x, y, (low + high) / 2.0];
            let halves = [half, half, (high - low) / 2.0];
            // Each face by its axis and side: the corners are counter-clockwise as seen from outside.
            for (axis, side) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
                let Ok(first) = u16::try_from(out.places.len() + 3).map(|n| n - 3) else { return out };
                let normal = scaled(self.axes[axis], side);
                for [a, b] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
                    let mut p = centre;
                    p[axis] += side * halves[axis];
                    p[(axis + 1) % 3] += side * a * halves[(axis + 1) % 3];
                    p[(axis + 2) % 3] += b * halves[(axis + 2) % 3];
                    out.places.push(self.in_map(p[0], p[1], p[2]));
                    out.normals.push(normal);
                }
                out.corners.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
        out
    }
}

/// The spans of a cell: how many runs, then a byte for each, whose two highest bits say unknown, free or occupied, and the others how
/// many steps there are but one.
fn runs(r: &mut Reader, base: i32) -> Result<Vec<Run>, Malformed> {
    let (mut out, mut at) = (Vec::<Run>::new(), base);
    for _ in 0..r.byte()? {
        let run = r.byte()?;
        let ends = [at, at.saturating_add(i32::from(run & 63) + 1)];
        at = ends[1];
        let is_occupied = match run >> 6 {
            0 => continue,
            1 => false,
            2 => true,
            _ => return Err(Malformed::Dangling),
        };
        match out.last_mut() {
            // A run is at most 64 steps long.
            Some(last) if last.ends[1] == ends[0] && last.is_occupied == is_occupied => {
                last.ends[1] = ends[1]
            }
            _ => out.push(Run { ends, is_occupied }),
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::{cross, dot, sub};

    /// A tile of one column: unknown, 100 steps of free space, three that are occupied.
    fn columns() -> Columns {
        let mut message = vec![4, 1, 0, 0];
        let axes = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        message.extend(axes.iter().flatten().chain(&[0.1, 0.05]).flat_map(|v: &f32| v.to_le_bytes()));
        message.extend([0_i32, 1, -1, 0, -4, 20].iter().flat_map(|v| v.to_le_bytes()));
        message.extend([4, 1, 0x40 | 63, 0x40 | 35, 0x80 | 2]);
        message.extend([0; 255]);
        let mut columns = Columns::default();
        columns.take(&message).unwrap();
        columns
    }

    #[test]
    fn spans_are_where_they_were_said_to_be() {
        let columns = columns();
        let tile = &columns.tiles[&[-1, 0]];
        let run = |low, high, is_occupied| Run { ends: [low, high], is_occupied };
        assert_eq!((tile.born_s, tile.cells[0].clone()), (2.0, vec![run(-2, 98, false), run(98, 101, true)]));
        let [low, high] = columns.free()[0];
        let near = |p: V3, q: V3| (0..3).all(|i| (p[i] - q[i]).abs() < 1e-5);
        assert!(near(low, [0.05, -0.1, -1.55]) && near(high, [0.05, 4.9, -1.55]), "{low:?} {high:?}");
    }

    #[test]
    fn boxes_are_seen_from_outside() {
        let columns = columns();
        let boxes = columns.boxes([-1, 0], &columns.tiles[&[-1, 0]]);
        assert_eq!((boxes.places.len(), boxes.corners.len()), (24, 12));
        let centre = [0.05, 4.975, -1.55];
        for corners in &boxes.corners {
            let [a, b, c] = corners.map(|c| boxes.places[usize::from(c)]);
            let normal = cross(sub(b, a), sub(c, a));
            assert!(
                dot(normal, sub(a, centre)) > 0.0
                    && dot(normal, boxes.normals[usize::from(corners[0])]) > 0.0
            );
        }
    }
}
