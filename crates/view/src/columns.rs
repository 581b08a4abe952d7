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

    fn in_map(&self, x: f32, y: f32, z: f32) -> V3 {
        add(add(scaled(self.axes[0], x), scaled(self.axes[1], y)), scaled(self.axes[2], z))
    }

    /// The corners of the tiles in the ground, in the map.
    pub fn corners(&self) -> Vec<V3> {
        let edge = TILE as f32 * self.cell_m;
        let of = |[x, y]: &[i32; 2]| {
            let ends = [[*x, *y], [x + 1, y + 1]];
            ends.map(|[x, y]| self.in_map(x as f32 * edge, y as f32 * edge, 0.0))
        };
        self.tiles.keys().flat_map(of).collect()
    }

    /// A line in each free span of every fourth cell, in the map: more would hide what is occupied.
    pub fn free(&self) -> Vec<[V3; 2]> {
        let mut out = Vec::new();
        for (at, tile) in &self.tiles {
            for (runs, k) in tile.cells.iter().zip(0..).filter(|(_, k)| k % 4 == 2 && k / TILE % 4 == 2) {
                let [x, y] = self.middle(*at, k);
                let free = runs.iter().filter(|run| !run.is_occupied);
                out.extend(free.map(|run| run.ends.map(|z| self.in_map(x, y, z as f32 * self.step_m))));
            }
        }
        out
    }

    /// A box for each occupied span of a tile, in the map: the faces that are seen from free space, so that one looks through a ceiling into
    /// the room. What is beside the tile counts as free.
    pub fn boxes(&self, at: [i32; 2], tile: &Tile) -> Block {
        let mut out = Block { born_s: tile.born_s, ..Block::default() };
        let half = FILLED * self.cell_m / 2.0;
        for (runs, k) in tile.cells.iter().zip(0..) {
            let [x, y] = self.middle(at, k);
            for run in runs.iter().filter(|run| run.is_occupied) {
                let [low, high] = run.ends.map(|z| z as f32 * self.step_m);
                let (centre, halves) = ([x, y, (low + high) / 2.0], [half, half, (high - low) / 2.0]);
                let faces = (0..3).flat_map(|axis| [(axis, 1), (axis, -1)]);
                for (axis, side) in faces.filter(|(axis, side)| is_seen(tile, k, run, *axis, *side)) {
                    self.face(&mut out, centre, halves, (axis, side as f32));
                }
            }
        }
        out
    }

    /// A face of a box by its axis and side: its corners are counter-clockwise as seen from outside. More than have numbers of 16 bits are
    /// left out.
    fn face(&self, out: &mut Block, centre: V3, halves: V3, (axis, side): (usize, f32)) {
        let Ok(first) = u16::try_from(out.places.len() + 3).map(|n| n - 3) else { return };
        for [a, b] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
            let mut p = centre;
            p[axis] += side * halves[axis];
            p[(axis + 1) % 3] += side * a * halves[(axis + 1) % 3];
            p[(axis + 2) % 3] += b * halves[(axis + 2) % 3];
            out.places.push(self.in_map(p[0], p[1], p[2]));
            out.normals.push(scaled(self.axes[axis], side));
        }
        out.corners.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }

    /// The middle of a cell along the two directions in the ground.
    fn middle(&self, at: [i32; 2], k: i32) -> [f32; 2] {
        [TILE * at[0] + k % TILE, TILE * at[1] + k / TILE].map(|c| (c as f32 + 0.5) * self.cell_m)
    }
}

/// Whether a face of an occupied span borders on free space.
fn is_seen(tile: &Tile, k: i32, run: &Run, axis: usize, side: i32) -> bool {
    let is_free_at = |cell: i32, low: i32, high: i32| {
        let runs = tile.cells.get(cell as usize).into_iter().flatten();
        runs.filter(|r| !r.is_occupied).any(|r| r.ends[0] < high && r.ends[1] > low)
    };
    match (axis, side) {
        (2, 1) => is_free_at(k, run.ends[1], run.ends[1] + 1),
        (2, _) => is_free_at(k, run.ends[0] - 1, run.ends[0]),
        _ => {
            let (along, step) = if axis == 0 { (k % TILE, 1) } else { (k / TILE, TILE) };
            !(0..TILE).contains(&(along + side)) || is_free_at(k + side * step, run.ends[0], run.ends[1])
        }
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

    /// A tile with one column, in its third cell of the third row: unknown, a floor, 100 steps of free space, a ceiling.
    fn columns() -> Columns {
        let mut message = vec![4, 1, 0, 0];
        let axes = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        message.extend(axes.iter().flatten().chain(&[0.1, 0.05]).flat_map(|v: &f32| v.to_le_bytes()));
        message.extend([0_i32, 1, -1, 0, -4, 20].iter().flat_map(|v| v.to_le_bytes()));
        message.extend([0; 34]);
        message.extend([5, 1, 0x80 | 1, 0x40 | 63, 0x40 | 35, 0x80 | 2]);
        message.extend([0; 221]);
        let mut columns = Columns::default();
        columns.take(&message).unwrap();
        columns
    }

    #[test]
    fn spans_are_where_they_were_said_to_be() {
        let columns = columns();
        let tile = &columns.tiles[&[-1, 0]];
        let run = |low, high, is_occupied| Run { ends: [low, high], is_occupied };
        let spans = vec![run(-2, 0, true), run(0, 100, false), run(100, 103, true)];
        assert_eq!((tile.born_s, tile.cells[34].clone()), (2.0, spans));
        let [low, high] = columns.free()[0];
        let near = |p: V3, q: V3| (0..3).all(|i| (p[i] - q[i]).abs() < 1e-5);
        assert!(near(low, [0.25, 0.0, -1.35]) && near(high, [0.25, 5.0, -1.35]), "{low:?} {high:?}");
    }

    #[test]
    fn faces_are_those_seen_from_free_space() {
        let columns = columns();
        let tile = &columns.tiles[&[-1, 0]];
        // The floor is seen from above and the ceiling from below; what is beside them is not known.
        let boxes = columns.boxes([-1, 0], tile);
        assert_eq!((boxes.places.len(), boxes.corners.len()), (8, 4));
        assert_eq!((boxes.normals[0], boxes.normals[4]), ([0.0, 1.0, 0.0], [0.0, -1.0, 0.0]));
        assert!((boxes.places[0][1] - 0.0).abs() < 1e-6 && (boxes.places[4][1] - 5.0).abs() < 1e-6);
        // Beside free space its sides are seen too, and corners go around each face counter-clockwise.
        let mut tile = tile.clone();
        let free = Run { ends: [-3, 110], is_occupied: false };
        for beside in [33, 35, 34 - 16, 34 + 16] {
            tile.cells[beside] = vec![free];
        }
        let boxes = columns.boxes([-1, 0], &tile);
        assert_eq!(boxes.corners.len(), 2 * 2 * 5);
        for corners in &boxes.corners {
            let [a, b, c] = corners.map(|c| boxes.places[usize::from(c)]);
            let normal = cross(sub(b, a), sub(c, a));
            assert!(dot(normal, boxes.normals[usize::from(corners[0])]) > 0.0);
        }
    }
}
