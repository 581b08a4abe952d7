//! Portable version of [`super::fast`] and [`super::fast_score`], and what every version shares: the corner, the cell
//! and the circle.

use cairn_sensor::GrayImage;

/// A corner on one pyramid level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) x: u16,
    pub(super) y: u16,
    /// FAST score.
    pub(super) score: u8,
}

/// Side of a cell in pixels; vector code processes this many columns at once.
pub(super) const CELL: usize = 32;

/// The circle of radius three, clockwise from the top.
pub(super) const CIRCLE: [[isize; 2]; 16] = [
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
];

/// See [`super::fast_score::score_row`].
pub(super) fn score_row(image: &GrayImage, y: usize, x0: usize, thresholds: &[u8], out: &mut [u8]) {
    for (cell, &threshold) in thresholds.iter().enumerate() {
        for half in 0..CELL / LANES {
            let x = x0 + cell * CELL + half * LANES;
            // Columns beyond the row are skipped.
            if x + 3 < image.width() {
                out[x..x + LANES].copy_from_slice(&score_block(image, x, y, threshold).0);
            }
        }
    }
}

/// Scores, without threshold, of five pixels in a row.
pub(super) fn five_scores(image: &GrayImage, x: usize, y: usize) -> [u8; 5] {
    let block = score_block(image, x, y, 0).0;
    std::array::from_fn(|i| block[i])
}

/// See `peaks` in [`super::fast`].
pub(super) fn peaks(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>) {
    let [above, here, below] = rows;
    for start in (x0..x1).step_by(LANES) {
        // Nearly all pixels are no corners.
        if here[start..start + LANES].iter().fold(0, |any, &s| any | s) == 0 {
            continue;
        }
        for x in start..(start + LANES).min(x1) {
            let s = here[x];
            let before = above[x - 1].max(above[x]).max(above[x + 1]).max(here[x - 1]);
            let after = below[x - 1].max(below[x]).max(below[x + 1]).max(here[x + 1]);
            if s > before && s >= after {
                out.push(Corner { x: x as u16, y: y as u16, score: s });
            }
        }
    }
}

/// Pixels processed together; compilers vectorise the loops over them.
const LANES: usize = 16;

#[derive(Clone, Copy)]
struct Lanes([u8; LANES]);

impl Lanes {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(u8, u8) -> u8) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.with(other, u8::min)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.with(other, u8::max)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.with(other, u8::saturating_sub)
    }

    #[inline(always)]
    fn any_above(self, threshold: u8) -> bool {
        self.0.iter().fold(false, |any, &v| any | (v > threshold))
    }
}

/// Scores of [`LANES`] pixels in a row.
fn score_block(image: &GrayImage, x: usize, y: usize, threshold: u8) -> Lanes {
    let (w, data) = (image.width() as isize, image.data());
    let at = |dx: isize, dy: isize| {
        // As much as any point of the circle needs of its row: one check of the bounds for each row.
        let start = (y * image.width() + x - 3).wrapping_add_signed(dy * w);
        let row = &data[start..start + LANES + 6];
        let mut lanes = [0; LANES];
        lanes.copy_from_slice(&row[3usize.wrapping_add_signed(dx)..][..LANES]);
        Lanes(lanes)
    };
    let ring = |k: usize| at(CIRCLE[k][0], CIRCLE[k][1]);
    let centre = at(0, 0);
    // Nine contiguous pixels contain two adjacent ones of the four compass points and two of the four diagonals: both
    // bound the score.
    let bound = |first: usize| {
        let [a, b, c, d] = [0, 4, 8, 12].map(|k| ring(first + k));
        let most = a.max(c).min(b.max(d));
        let least = a.min(c).max(b.min(d));
        most.minus(centre).max(centre.minus(least))
    };
    let compass = bound(0);
    if !compass.any_above(threshold) || !compass.min(bound(2)).any_above(threshold) {
        return Lanes([0; LANES]);
    }
    let p: [Lanes; 16] = std::array::from_fn(ring);
    // Runs of two, four and eight from every odd position, then the two arcs of nine that share each run of eight.
    let runs = |within: fn(Lanes, Lanes) -> Lanes, across: fn(Lanes, Lanes) -> Lanes| {
        let two: [Lanes; 8] = std::array::from_fn(|i| within(p[2 * i + 1], p[(2 * i + 2) & 15]));
        let four: [Lanes; 8] = std::array::from_fn(|i| within(two[i], two[(i + 1) & 7]));
        let nine =
            |i: usize| within(within(four[i], four[(i + 2) & 7]), across(p[2 * i], p[(2 * i + 9) & 15]));
        (1..8).fold(nine(0), |best, i| across(best, nine(i)))
    };
    let score = runs(Lanes::min, Lanes::max).minus(centre).max(centre.minus(runs(Lanes::max, Lanes::min)));
    Lanes(score.0.map(|s| if s > threshold { s } else { 0 }))
}
