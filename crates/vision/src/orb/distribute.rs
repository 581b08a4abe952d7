//! Spatial distribution: selects the corners of a level that become features.
//!
//! Every corner gets the priority `score^4 / (1 + rank)`, where `rank` is the number of stronger corners in its cell of
//! a fine grid, and those of highest priority are kept; the strongest corner of each cell of a coarse grid is always
//! kept. So a textured region gives several features before a weakly textured one gives its first, but cannot take them
//! all. Measured on real recordings (`tools/compare_orb.py`), this gives as many matches as taking the strongest
//! corners of the level, spread over a fifth more of the image; an equal share for every cell loses a quarter of the
//! matches.

use super::BORDER;
use super::fast::Corner;

/// Mean number of features per fine cell when corners are everywhere.
const PER_FINE_CELL: f64 = 2.0;
/// Mean number of features per coarse cell, of which one is guaranteed.
const PER_COARSE_CELL: f64 = 8.0;

/// Buffers of [`distribute`], reused.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    keys: Vec<u64>,
    guaranteed: Vec<u32>,
}

struct Grid {
    columns: usize,
    rows: usize,
    size: [usize; 2],
}

impl Grid {
    fn new(width: usize, height: usize, side: f64) -> Self {
        let size = [width - 2 * BORDER, height - 2 * BORDER];
        let [columns, rows] = size.map(|n| ((n as f64 / side).round() as usize).clamp(1, 255));
        Self { columns, rows, size }
    }

    fn cell(&self, c: &Corner) -> usize {
        let x = (c.x as usize - BORDER) * self.columns / self.size[0];
        let y = (c.y as usize - BORDER) * self.rows / self.size[1];
        y * self.columns + x
    }
}

/// Keeps at most `wanted` corners, distributed over the level.
pub(super) fn distribute(
    corners: &mut Vec<Corner>,
    width: usize,
    height: usize,
    wanted: usize,
    scratch: &mut Scratch,
) {
    if corners.len() <= wanted {
        return;
    }
    if wanted == 0 {
        return corners.clear();
    }
    let area = ((width - 2 * BORDER) * (height - 2 * BORDER)) as f64;
    let grid = |per_cell: f64| Grid::new(width, height, (area * per_cell / wanted as f64).sqrt());
    let (fine, coarse) = (grid(PER_FINE_CELL), grid(PER_COARSE_CELL));
    strongest(corners, &coarse, &mut scratch.guaranteed);
    // Sort by cell, then decreasing strength, then reading order.
    let key = |i: usize, c: &Corner| (fine.cell(c) as u64) << 40 | (255 - c.score as u64) << 32 | i as u64;
    let keys = &mut scratch.keys;
    keys.clear();
    keys.extend(corners.iter().enumerate().map(|(i, c)| key(i, c)));
    keys.sort_unstable();
    // Then by priority (36 bits, highest first), then reading order (28 bits).
    let (mut cell, mut rank) = (u64::MAX, 0u64);
    for k in keys.iter_mut() {
        let (this, index) = (*k >> 40, *k & 0xffff_ffff);
        rank = if this == cell { rank + 1 } else { 0 };
        cell = this;
        let corner = &corners[index as usize];
        let score = corner.score as u64;
        let priority = if scratch.guaranteed[coarse.cell(corner)] as u64 == index {
            MAX_PRIORITY - 255 + score
        } else {
            16 * score.pow(4) / (1 + rank)
        };
        *k = (MAX_PRIORITY - priority) << 28 | index;
    }
    keys.select_nth_unstable(wanted - 1);
    keys.truncate(wanted);
    // Back in reading order.
    for k in keys.iter_mut() {
        *k &= (1 << 28) - 1;
    }
    keys.sort_unstable();
    for (to, &from) in keys.iter().enumerate() {
        corners[to] = corners[from as usize];
    }
    corners.truncate(wanted);
}

/// Higher than any computed priority: 36 bits of ones.
const MAX_PRIORITY: u64 = (1 << 36) - 1;

/// Index of the strongest corner (the first of equals) of each cell.
fn strongest(corners: &[Corner], grid: &Grid, out: &mut Vec<u32>) {
    out.clear();
    out.resize(grid.columns * grid.rows, u32::MAX);
    for (i, c) in corners.iter().enumerate() {
        let best = &mut out[grid.cell(c)];
        if corners.get(*best as usize).is_none_or(|b| b.score < c.score) {
            *best = i as u32;
        }
    }
}

/// Divides `total` features among the levels: the share of a level decreases with its scale (as its side length does),
/// and what a level cannot use goes to the others.
pub(super) fn shares(available: &[usize], total: usize, factor: f64, given: &mut [usize]) {
    given.fill(0);
    let mut left = total.min(available.iter().sum());
    let weight = |l: usize| factor.powi(-(l as i32));
    while left > 0 {
        let open = |given: &[usize], l: usize| given[l] < available[l];
        let sum: f64 = (0..given.len()).filter(|&l| open(given, l)).map(weight).sum();
        let round = left;
        for l in 0..given.len() {
            if left > 0 && open(given, l) {
                // At least one, so that every round makes progress.
                let part = ((round as f64 * weight(l) / sum).floor() as usize).max(1);
                let part = part.min(available[l] - given[l]).min(left);
                given[l] += part;
                left -= part;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_use_the_whole_budget() {
        let shares = |available: &[usize], total| {
            let mut given = vec![7; available.len()];
            super::shares(available, total, 1.2, &mut given);
            given
        };
        assert_eq!(shares(&[10_000; 8], 1000).iter().sum::<usize>(), 1000);
        assert_eq!(shares(&[10_000; 8], 3), vec![1, 1, 1, 0, 0, 0, 0, 0]);
        assert_eq!(shares(&[3, 0, 5], 1000), vec![3, 0, 5]);
        let s = shares(&[20, 10_000, 10_000], 1000);
        assert_eq!((s[0], s.iter().sum::<usize>()), (20, 1000));
        assert!(s[1] > s[2]);
        assert!(shares(&[], 10).is_empty());
    }

    #[test]
    fn weak_corner_in_an_empty_region_is_kept() {
        // A thousand strong corners on the left, one weak corner on the right.
        let mut corners: Vec<Corner> =
            (0..1000).map(|i| Corner { x: 20 + i % 40, y: 20 + (i / 40) * 3, score: 200 }).collect();
        corners.push(Corner { x: 600, y: 400, score: 9 });
        let mut scratch = Scratch::default();
        distribute(&mut corners, 640, 480, 100, &mut scratch);
        assert_eq!(corners.len(), 100);
        assert!(corners.iter().any(|c| c.x == 600));
    }
}
