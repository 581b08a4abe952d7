//! A large symmetric matrix in square tiles, with postponed low-rank subtractions that are done tile by tile.
//!
//! Postponing changes that affect only far landmarks keeps an update local (Guivant and Nebot, "Optimization of the
//! simultaneous localization and map-building algorithm for real-time implementation", 2001; Knight, Davison, Reid,
//! "Towards constant time SLAM using postponement", 2001). The value of an entry is the stored value minus the
//! subtractions still pending for its tile; reading takes both into account.

use nalgebra::DMatrix;

/// Edge of a tile: 32 kB per tile, so that three of them stay in the fast caches.
const EDGE: usize = 64;

/// The pending subtraction of `left * right^T`; as many rows as the matrix had, padded with zeros to whole tiles.
#[derive(Clone, Debug)]
struct Owed {
    left: DMatrix<f64>,
    right: DMatrix<f64>,
}

#[derive(Clone, Debug)]
struct Tile {
    values: DMatrix<f64>,
    /// Number of subtractions applied to it, out of all since the beginning.
    seen: usize,
}

/// The matrix: lower triangle of tiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tiles {
    /// Tile `(i, j)`, `j <= i`, at `i (i + 1) / 2 + j`.
    tiles: Vec<Tile>,
    rows: usize,
    owed: Vec<Owed>,
    /// Number of subtractions that were applied to every tile and removed from `owed`.
    settled: usize,
    /// Next tile to work on.
    next: usize,
}

impl Tiles {
    /// Number of rows that there is room for.
    pub fn room(&self) -> usize {
        self.rows * EDGE
    }

    /// Makes room for `n` rows.
    pub fn reserve(&mut self, n: usize) {
        let seen = self.settled + self.owed.len();
        while self.room() < n {
            for _ in 0..=self.rows {
                self.tiles.push(Tile { values: DMatrix::zeros(EDGE, EDGE), seen });
            }
            self.rows += 1;
        }
    }

    /// One entry.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        let (row, column) = (row.max(column), row.min(column));
        let tile = &self.tiles[index(row / EDGE, column / EDGE)];
        let owed = self.owed[tile.seen - self.settled..].iter();
        let owed = owed.filter(|o| row < o.left.nrows()).map(|o| dot(&o.left, row, &o.right, column));
        tile.values[(row % EDGE, column % EDGE)] - owed.sum::<f64>()
    }

    /// The rows with these indices over all columns `0..n`, returned as columns.
    pub fn rows(&self, numbers: &[usize], n: usize) -> DMatrix<f64> {
        let mut found = DMatrix::zeros(n, numbers.len());
        for (k, &number) in numbers.iter().enumerate() {
            for c in 0..n {
                let (row, column) = (number.max(c), number.min(c));
                let tile = &self.tiles[index(row / EDGE, column / EDGE)];
                found[(c, k)] = tile.values[(row % EDGE, column % EDGE)];
            }
        }
        for (k, owed) in self.owed.iter().enumerate() {
            let place: Vec<usize> = (0..numbers.len()).filter(|i| numbers[*i] < owed.left.nrows()).collect();
            let own = owed.left.select_rows(&place.iter().map(|i| numbers[*i]).collect::<Vec<_>>());
            let share = &owed.right * own.transpose();
            for (i, &to) in place.iter().enumerate() {
                for c in 0..n.min(share.nrows()) {
                    let (row, column) = (numbers[to].max(c), numbers[to].min(c));
                    if self.tiles[index(row / EDGE, column / EDGE)].seen <= self.settled + k {
                        found[(c, to)] -= share[(c, i)];
                    }
                }
            }
        }
        found
    }

    /// Overwrites the rows (and columns) with these indices: `values` holds them as columns over all of `0..n`.
    ///
    /// Every entry of these rows is replaced, so no subtraction is pending for them any more.
    pub fn write(&mut self, numbers: &[usize], values: &DMatrix<f64>) {
        for (k, &number) in numbers.iter().enumerate() {
            for c in 0..values.nrows() {
                let (row, column) = (number.max(c), number.min(c));
                self.tiles[index(row / EDGE, column / EDGE)].values[(row % EDGE, column % EDGE)] =
                    values[(c, k)];
            }
            for owed in self.owed.iter_mut().filter(|o| number < o.left.nrows()) {
                owed.left.row_mut(number).fill(0.0);
                owed.right.row_mut(number).fill(0.0);
            }
        }
    }

    /// Subtracts `left * right^T`, which must be symmetric; applied later, or when read.
    pub fn subtract(&mut self, left: DMatrix<f64>, right: DMatrix<f64>) {
        let n = left.nrows().div_ceil(EDGE) * EDGE;
        let (left, right) = (left.resize_vertically(n, 0.0), right.resize_vertically(n, 0.0));
        self.owed.push(Owed { left, right });
    }

    /// Number of pairs of a tile and a subtraction that are still pending.
    pub fn backlog(&self) -> usize {
        self.tiles.len() * self.owed.len()
    }

    /// Applies the pending subtractions to this many tiles.
    pub fn settle(&mut self, tiles: usize) {
        for _ in 0..tiles {
            if self.owed.is_empty() {
                return;
            }
            self.settle_next();
        }
    }

    fn settle_next(&mut self) {
        if self.next >= self.tiles.len() {
            self.next = 0;
            let least = self.tiles.iter().map(|t| t.seen).min().unwrap_or(self.settled);
            self.owed.drain(..least - self.settled);
            self.settled = least;
            return;
        }
        let (i, j) = place(self.next);
        let tile = &mut self.tiles[self.next];
        for owed in &self.owed[tile.seen - self.settled..] {
            if (i + 1) * EDGE <= owed.left.nrows() {
                let left = owed.left.rows(i * EDGE, EDGE);
                let right = owed.right.rows(j * EDGE, EDGE);
                tile.values.gemm(-1.0, &left, &right.transpose(), 1.0);
            }
        }
        tile.seen = self.settled + self.owed.len();
        self.next += 1;
    }
}

fn index(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// Row and column of a tile, by its index.
fn place(index: usize) -> (usize, usize) {
    let mut i = (((8 * index + 1) as f64).sqrt() as usize).saturating_sub(1) / 2;
    while (i + 1) * (i + 2) / 2 <= index {
        i += 1;
    }
    while i * (i + 1) / 2 > index {
        i -= 1;
    }
    (i, index - i * (i + 1) / 2)
}

fn dot(a: &DMatrix<f64>, row: usize, b: &DMatrix<f64>, column: usize) -> f64 {
    (0..a.ncols()).map(|k| a[(row, k)] * b[(column, k)]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(k: usize) -> f64 {
        ((k * 37 + 11) as f64 * 0.731).sin()
    }

    #[test]
    fn places_are_indices_undone() {
        for k in 0..20_000 {
            let (i, j) = place(k);
            assert!(j <= i && index(i, j) == k);
        }
    }

    #[test]
    fn what_is_owed_is_seen_before_and_after_it_is_settled() {
        let n = 150;
        let mut expected = DMatrix::from_fn(n, n, |i, j| number(i.max(j) * 200 + i.min(j)));
        let mut tiles = Tiles::default();
        tiles.reserve(n);
        tiles.write(&(0..n).collect::<Vec<_>>(), &expected);
        let check = |tiles: &Tiles, expected: &DMatrix<f64>| {
            for (i, j) in [(0, 0), (149, 3), (70, 70), (64, 63), (3, 149), (100, 20)] {
                assert!((tiles.at(i, j) - expected[(i, j)]).abs() < 1e-11);
            }
            let numbers = [149, 2, 64];
            let rows = tiles.rows(&numbers, expected.nrows());
            for (k, r) in numbers.iter().enumerate() {
                assert!((rows.column(k) - expected.column(*r)).norm() < 1e-10);
            }
        };
        for round in 0..12 {
            let right = DMatrix::from_fn(n, 5, |i, j| number(i * 5 + j + round));
            let core = DMatrix::from_fn(5, 5, |i, j| number(i.max(j) * 7 + i.min(j) + round));
            let left = &right * core;
            expected -= &left * right.transpose();
            tiles.subtract(left, right);
            check(&tiles, &expected);
            tiles.settle(round % 4);
            check(&tiles, &expected);
            // A few rows are overwritten.
            let numbers = [round, 2, 140];
            for r in numbers {
                for c in 0..n {
                    let v = number(r * 3 + c + round) + number(c * 3 + r + round);
                    (expected[(r, c)], expected[(c, r)]) = (v, v);
                }
            }
            let given = DMatrix::from_fn(n, 3, |c, k| expected[(numbers[k], c)]);
            tiles.write(&numbers, &given);
            check(&tiles, &expected);
            if round == 6 {
                tiles.reserve(260);
            }
        }
        tiles.settle(1000);
        assert_eq!(tiles.backlog(), 0);
        check(&tiles, &expected);
    }
}
