//! FAST scores in portable Rust: of a row, and of the neighbourhood of a corner. See [`super::fast`].

use super::Backend;
use super::fast::CELL;
use cairn_sensor::GrayImage;

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

/// Scores of a row from column `x0`, [`CELL`] columns per threshold. All columns must be at least three from every
/// edge, except that the last cell may extend beyond the row. `out` is indexed by column.
pub(super) fn score_row(
    image: &GrayImage,
    y: usize,
    x0: usize,
    thresholds: &[u8],
    out: &mut [u8],
    backend: Backend,
) {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::fast_avx512::score_row(image, y, x0, thresholds, out),
        Backend::Avx2 => return super::fast_avx2::score_row(image, y, x0, thresholds, out),
        Backend::Scalar => {}
    }
    let _ = backend;
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

/// Scores, without threshold, of the 5 x 5 pixels around a pixel at least [`super::BORDER`] from the edge, row by row.
pub(super) fn scores_around(image: &GrayImage, x: usize, y: usize, backend: Backend) -> [[u8; 5]; 5] {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx512 {
        return super::fast_avx512::scores_around(image, x, y);
    }
    let mut out = [[0; 5]; 5];
    for (v, out) in out.iter_mut().enumerate() {
        let y = y + v - 2;
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx2 {
            *out = super::fast_avx2::five_scores(image, x - 2, y);
            continue;
        }
        let _ = backend;
        let block = score_block(image, x - 2, y, 0).0;
        out.copy_from_slice(&block[..5]);
    }
    out
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
        self.0.iter().fold(0, |m, &v| m.max(v)) > threshold
    }
}

/// Scores of [`LANES`] pixels in a row.
fn score_block(image: &GrayImage, x: usize, y: usize, threshold: u8) -> Lanes {
    let (w, data) = (image.width() as isize, image.data());
    let at = |dx: isize, dy: isize| {
        let start = (y * image.width() + x).wrapping_add_signed(dy * w + dx);
        let mut lanes = [0; LANES];
        lanes.copy_from_slice(&data[start..start + LANES]);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Directly from the definition: the greatest threshold, plus one, at which nine contiguous pixels pass.
    fn by_definition(image: &GrayImage, x: usize, y: usize) -> u8 {
        let centre = image.at(x, y) as i32;
        let ring = CIRCLE
            .map(|[dx, dy]| image.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy)) as i32 - centre);
        let is_corner = |t: i32| {
            (0..16).any(|k| (0..9).all(|i| ring[(k + i) & 15] > t) || (0..9).all(|i| ring[(k + i) & 15] < -t))
        };
        (0..255).take_while(|&t| is_corner(t)).count() as u8
    }

    #[test]
    fn scores_match_the_definition() {
        let (w, h) = (70, 40);
        let mut state = 3u32;
        let mut next = |i: usize| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            // Noise on blocks, so that many pixels are corners.
            (((i % w / 5 + i / w / 5) % 2) as u32 * 150 + (state >> 24) % 90) as u8
        };
        let image = GrayImage::from_vec(w, h, (0..w * h).map(&mut next).collect()).unwrap();
        let (mut corners, mut row) = (0, vec![0; w + 64]);
        for backend in Backend::every() {
            for y in 16..24 {
                score_row(&image, y, 16, &[0, 0], &mut row, backend);
                for x in 16..w - 16 {
                    let expected = by_definition(&image, x, y);
                    assert_eq!(row[x], expected, "{x} {y}");
                    assert_eq!(scores_around(&image, x, y, backend)[2][2], expected);
                    corners += (expected > 0) as usize;
                }
            }
        }
        assert!(corners > 60, "{corners}");
    }
}
