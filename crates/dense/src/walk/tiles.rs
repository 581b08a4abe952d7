//! Columns in tiles, run by run: small enough to be told whenever they change.

use super::{Columns, Window};
use crate::{DenseError, Occupancy};
use cairn_geometry::{Mat3, Se3, So3, Vec3};

/// Cells along the edge of a tile.
pub const TILE: i32 = 16;
/// Edge of a cell, metres.
const CELL_M: f64 = 0.1;
/// Steps of a run, at most.
const LONGEST: i32 = 64;

/// How columns stand in a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColumnAxes {
    /// Two directions in the ground and up, in the map.
    pub axes: [Vec3; 3],
    /// Edge of a cell, metres.
    pub cell_m: f64,
    /// Height of a step, metres.
    pub step_m: f64,
}

/// The columns of [`TILE`] x [`TILE`] cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnTile {
    /// Its place along the two directions in the ground, in edges of a tile.
    pub at: [i32; 2],
    /// Height of its lower end, in steps.
    pub base: i32,
    /// For each cell, row by row, how many runs it has, then a byte for each from below: in the two highest bits 0 for unknown, 1 for
    /// free, 2 for occupied; in the others how many steps it has, but one.
    pub runs: Vec<u8>,
}

impl ColumnAxes {
    /// For a map in which this is up, with steps of a voxel.
    pub fn new(up: &Vec3, step_m: f64) -> Self {
        let up = up.try_normalize(1e-9).unwrap_or(-Vec3::y());
        let other = if up.z.abs() < 0.9 { Vec3::z() } else { Vec3::x() };
        let side = other.cross(&up).normalize();
        Self { axes: [side, up.cross(&side), up], cell_m: CELL_M, step_m }
    }

    /// The tiles that are above or below any of these points, first and last along each direction, and the steps from the lowest to the
    /// highest.
    pub fn around(&self, points: impl Iterator<Item = Vec3>) -> Option<([[i32; 2]; 2], [i32; 2])> {
        let tile_m = f64::from(TILE) * self.cell_m;
        let edges = [tile_m, tile_m, self.step_m];
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        for p in points {
            let at: [i32; 3] = std::array::from_fn(|k| (self.axes[k].dot(&p) / edges[k]).floor() as i32);
            let [low, high] = bounds.get_or_insert([at, at]);
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(at[k]), high[k].max(at[k]));
            }
        }
        bounds.map(|[low, high]| ([[low[0], low[1]], [high[0], high[1]]], [low[2], high[2] + 1]))
    }

    /// The columns of a tile between two heights in steps; `None` where all is unknown.
    ///
    /// # Errors
    /// Heights so far apart that it would take too long.
    pub fn tile(
        &self,
        at: [i32; 2],
        steps: [i32; 2],
        occupancy: impl Fn(&Vec3) -> Occupancy,
    ) -> Result<Option<ColumnTile>, DenseError> {
        let half_m = 0.5 * f64::from(TILE) * self.cell_m;
        let [x, y] = at.map(|k| (f64::from(k) + 0.5) * 2.0 * half_m);
        let rotation = So3::from_matrix(&Mat3::from_columns(&self.axes));
        let world_from_level = Se3::new(rotation, self.axes[0] * x + self.axes[1] * y);
        let heights_m = steps.map(|k| f64::from(k) * self.step_m);
        let window = Window { world_from_level, half_m, cell_m: self.cell_m, heights_m, step_m: self.step_m };
        let columns = Columns::look(window, occupancy)?;
        let mut runs = Vec::new();
        let mut is_known = false;
        for k in 0..columns.side() * columns.side() {
            let first = runs.len();
            runs.push(0);
            let mut until = steps[0];
            for span in columns.spans(k % columns.side(), k / columns.side()) {
                let [low, high] =
                    [span.low_m, span.high_m].map(|z| (f64::from(z) / self.step_m).round() as i32);
                push(&mut runs, 0, low - until);
                push(&mut runs, if span.occupied { 2 } else { 1 }, high - low);
                (until, is_known) = (high, true);
            }
            let count = u8::try_from(runs.len() - first - 1);
            runs[first] = count.map_err(|_| DenseError::Config("a column of too many spans".into()))?;
        }
        Ok(is_known.then_some(ColumnTile { at, base: steps[0], runs }))
    }
}

fn push(runs: &mut Vec<u8>, what: u8, mut steps: i32) {
    while steps > 0 {
        let run = steps.min(LONGEST);
        runs.push(what << 6 | (run - 1) as u8);
        steps -= run;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_room_has_its_floor_its_free_space_and_its_ceiling_in_each_cell() {
        // Up is against y: the floor is at y = 1.5, the ceiling at y = -1, a wall at x = 2.
        let axes = ColumnAxes::new(&-Vec3::y(), 0.05);
        let room = |p: &Vec3| match (p.y, p.x) {
            (y, _) if !(-1.1..1.6).contains(&y) => Occupancy::Unknown,
            (_, x) if x > 2.1 => Occupancy::Unknown,
            (y, x) if !(-1.0..1.5).contains(&y) || x > 2.0 => Occupancy::Occupied,
            _ => Occupancy::Free,
        };
        let corners = [Vec3::new(0.0, -1.21, 0.0), Vec3::new(2.5, 1.99, 1.0)];
        let ([low, high], steps) = axes.around(corners.into_iter()).unwrap();
        assert_eq!((low, high, steps), ([0, 0], [1, 0], [-40, 25]));
        let tile = axes.tile([0, 0], steps, room).unwrap().unwrap();
        // 8 steps of nothing, 2 of floor, 50 of free space, 2 of ceiling; nothing above.
        let cell = [4, 7, 0x80 | 1, 0x40 | 49, 0x80 | 1];
        assert!(tile.runs.chunks(5).all(|runs| runs == cell), "{:?}", &tile.runs[..10]);
        // The next tile has the wall in it, and what is behind it is unknown.
        let tile = axes.tile([1, 0], steps, room).unwrap().unwrap();
        assert_eq!(tile.runs[..5], cell);
        assert_eq!(tile.runs[4 * 5..4 * 5 + 3], [2, 7, 0x80 | 53]);
        assert_eq!(tile.runs[4 * 5 + 3..4 * 5 + 5], [0, 0]);
        assert_eq!(axes.tile([2, 0], steps, room).unwrap(), None);
    }
}
