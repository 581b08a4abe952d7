//! Disparity seeds: matched features in a grid, so that features without a match can try the disparities of neighbours.

/// Side of a cell in rectified pixels; neighbours are searched in the 3 x 3 cells around a feature.
const CELL: f32 = 32.0;
/// Maximum number of different disparities to try.
pub(super) const MAX_SEEDS: usize = 3;

/// A grid of matched features with their disparities.
#[derive(Clone, Debug, Default)]
pub(super) struct DisparitySeeds {
    origin: [f32; 2],
    columns: usize,
    rows: usize,
    /// Start of each cell in `items`, plus one final entry.
    starts: Vec<u32>,
    /// x, y and disparity, sorted by cell.
    items: Vec<[f32; 3]>,
}

impl DisparitySeeds {
    /// Fills the grid with features that have a depth: their rectified positions and disparities.
    pub(super) fn fill(&mut self, features: impl Iterator<Item = ([f32; 2], f32)> + Clone) {
        let mut bounds = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        for [x, y] in features.clone().map(|(p, _)| p) {
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
        }
        self.starts.clear();
        self.items.clear();
        if bounds[0] > bounds[2] {
            (self.columns, self.rows) = (0, 0);
            return;
        }
        self.origin = [bounds[0], bounds[1]];
        self.columns = ((bounds[2] - bounds[0]) / CELL) as usize + 1;
        self.rows = ((bounds[3] - bounds[1]) / CELL) as usize + 1;
        let origin = self.origin;
        let columns = self.columns;
        let cell = |p: [f32; 2]| {
            ((p[1] - origin[1]) / CELL) as usize * columns + ((p[0] - origin[0]) / CELL) as usize
        };
        self.starts.resize(self.columns * self.rows + 1, 0);
        for (p, _) in features.clone() {
            self.starts[cell(p) + 1] += 1;
        }
        for c in 1..self.starts.len() {
            self.starts[c] += self.starts[c - 1];
        }
        self.items.resize(self.starts[self.starts.len() - 1] as usize, [0.0; 3]);
        // Filling moves each start to the end of its cell, which is the start of the next: shifted back below.
        for (p, disparity) in features {
            let slot = &mut self.starts[cell(p)];
            self.items[*slot as usize] = [p[0], p[1], disparity];
            *slot += 1;
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// Disparities of the nearest features, nearest first, each at least `apart` from the previous ones.
    pub(super) fn near(&self, [u, v]: [f32; 2], apart: f32) -> impl Iterator<Item = f32> {
        let mut best = [(f32::INFINITY, f32::NAN); 2 * MAX_SEEDS];
        let column = ((u - self.origin[0]) / CELL).floor() as i64;
        let row = ((v - self.origin[1]) / CELL).floor() as i64;
        let columns = (column - 1).max(0)..(column + 2).min(self.columns as i64).max(0);
        for r in (row - 1).max(0)..(row + 2).min(self.rows as i64) {
            if columns.is_empty() {
                break;
            }
            let base = r * self.columns as i64;
            let from = self.starts[(base + columns.start) as usize] as usize;
            let to = self.starts[(base + columns.end) as usize] as usize;
            for [x, y, disparity] in &self.items[from..to] {
                let mut item = ((x - u) * (x - u) + (y - v) * (y - v), *disparity);
                for slot in &mut best {
                    if item.0 < slot.0 {
                        std::mem::swap(slot, &mut item);
                    }
                }
            }
        }
        let mut chosen = [f32::NAN; MAX_SEEDS];
        let mut count = 0;
        for (_, disparity) in best {
            let new = chosen[..count].iter().all(|c: &f32| (c - disparity).abs() >= apart);
            if count < MAX_SEEDS && disparity.is_finite() && new {
                chosen[count] = disparity;
                count += 1;
            }
        }
        chosen.into_iter().take(count)
    }
}
