//! Selects the 256 binary tests of the descriptor.
//!
//! Rublee et al. 2011 (section 4.3) select greedily tests of high variance and low correlation. Here the greedy
//! selection maximises directly what these two properties are for: the descriptor distances of different corners should
//! be well separated from the distances between two views of the same corner, relative to their spread. With `u` the
//! distance of a non-matching pair and `v` of a matching pair, both sums over the selected tests, each step takes the
//! test that most increases `(E[u] - E[v]) / sqrt(Var[u] + Var[v])`. The variances account for the correlation between
//! tests.

use super::patches::{Patches, disc};
use super::scene::Rng;

/// `[x0, y0, x1, y1]` in pixels.
pub type Test = [i8; 4];

/// Outcomes of one test over all pairs: a bit is set where the two views of the pair give different results.
struct Bits {
    /// Pairs of different corners.
    different: Vec<u64>,
    /// Pairs of two views of the same corner.
    same: Vec<u64>,
}

/// The selected tests, best first: `drawn` random candidates, of which the `kept` best compete in the greedy selection.
pub fn learn(patches: &Patches, drawn: usize, kept: usize) -> Vec<Test> {
    let points = disc();
    let mut rng = Rng::new(256);
    let mut candidates: Vec<(f64, [usize; 2])> = (0..drawn)
        .map(|_| {
            let pair = loop {
                let pair = [rng.bits() as usize % points.len(), rng.bits() as usize % points.len()];
                if pair[0] != pair[1] {
                    break pair;
                }
            };
            (separation(&bits(patches, pair), patches.corners), pair)
        })
        .collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    candidates.dedup();
    candidates.truncate(kept);
    let tests: Vec<[usize; 2]> = candidates.into_iter().map(|c| c.1).collect();
    let bits: Vec<Bits> = tests.iter().map(|&t| bits(patches, t)).collect();
    let chosen = choose(&bits, patches.corners, 256);
    let test = |i: usize| {
        let [a, b] = tests[i].map(|p| points[p]);
        [a[0], a[1], b[0], b[1]]
    };
    chosen.into_iter().map(test).collect()
}

fn bits(patches: &Patches, [a, b]: [usize; 2]) -> Bits {
    let n = patches.corners;
    let [first, second] = &patches.views;
    let words = n.div_ceil(64);
    let (mut different, mut same) = (vec![0u64; words], vec![0u64; words]);
    let bit = |view: &[Vec<u8>], i: usize| view[a][i] < view[b][i];
    for i in 0..n {
        let here = bit(first, i);
        // A corner of another scene.
        let other = bit(second, (i + n / 2) % n);
        different[i / 64] |= ((here != other) as u64) << (i % 64);
        same[i / 64] |= ((here != bit(second, i)) as u64) << (i % 64);
    }
    Bits { different, same }
}

fn share(a: &[u64], b: &[u64], n: usize) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a & b).count_ones()).sum::<u32>() as f64 / n as f64
}

/// The criterion for a single test.
fn separation(bits: &Bits, n: usize) -> f64 {
    let (u, v) = (share(&bits.different, &bits.different, n), share(&bits.same, &bits.same, n));
    (u - v) / (u * (1.0 - u) + v * (1.0 - v) + 1e-9).sqrt()
}

fn choose(bits: &[Bits], n: usize, count: usize) -> Vec<usize> {
    let mean: Vec<[f64; 2]> =
        bits.iter().map(|b| [share(&b.different, &b.different, n), share(&b.same, &b.same, n)]).collect();
    let covariance = |i: usize, j: usize| {
        share(&bits[i].different, &bits[j].different, n) - mean[i][0] * mean[j][0]
            + (share(&bits[i].same, &bits[j].same, n) - mean[i][1] * mean[j][1])
    };
    // Covariance of each candidate with the sum of the tests chosen so far.
    let mut with_chosen = vec![0.0; bits.len()];
    let own: Vec<f64> = (0..bits.len()).map(|i| covariance(i, i)).collect();
    let mut chosen: Vec<usize> = vec![];
    let mut taken = vec![false; bits.len()];
    let (mut mean_gap, mut variance) = (0.0, 0.0);
    while chosen.len() < count.min(bits.len()) {
        let (mut best, mut best_value) = (0, f64::MIN);
        for i in (0..bits.len()).filter(|&i| !taken[i]) {
            let value = (mean_gap + mean[i][0] - mean[i][1])
                / (variance + own[i] + 2.0 * with_chosen[i]).max(1e-9).sqrt();
            if value > best_value {
                (best, best_value) = (i, value);
            }
        }
        taken[best] = true;
        mean_gap += mean[best][0] - mean[best][1];
        variance += own[best] + 2.0 * with_chosen[best];
        for (i, w) in with_chosen.iter_mut().enumerate() {
            *w += covariance(i, best);
        }
        chosen.push(best);
    }
    chosen
}

/// The text of the generated source file.
pub fn source(tests: &[Test]) -> String {
    let mut out = String::from(
        "//! The binary tests of the descriptor, learned from synthetic images rendered from fixed seeds. Do not edit: generated\n\
         //! by `cargo run --release -p cairn-vision --example learn_pattern`.\n\n\
         /// One test per bit: `[x0, y0, x1, y1]` in pixels from the keypoint, within a disc of radius 15.\n\
         #[rustfmt::skip]\n\
         pub(super) const PATTERN: [[i8; 4]; 256] = [\n",
    );
    for row in tests.chunks(4) {
        let row: Vec<String> = row.iter().map(|t| format!("{t:?},")).collect();
        out += &format!("    {}\n", row.join(" "));
    }
    out + "];\n"
}

/// Runs the whole selection and returns the generated source file.
pub fn regenerate() -> String {
    source(&learn(&super::patches::collect(SCENES), DRAWN, KEPT))
}

/// Number of scenes rendered.
const SCENES: u64 = 60;
/// Number of candidate tests drawn at random.
const DRAWN: usize = 12_000;
/// Number of candidates, the best by the single-test criterion, that enter the greedy selection.
const KEPT: usize = 4_000;
