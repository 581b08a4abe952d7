//! Model scores: truncated symmetric transfer errors, comparable between homography and fundamental matrix.
//!
//! Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system" (2015), equations 2 and 3.

use cairn_geometry::Mat3;

/// 95 % quantile of chi-square with one degree of freedom (distance to a line).
pub(super) const CHI2_1: f64 = 3.84;
/// 95 % quantile of chi-square with two degrees of freedom (distance to a point); also the score of a perfect match.
pub(super) const CHI2_2: f64 = 5.99;

/// A match: first x and y, second x and y. Scores expect units in which the standard deviation is one.
pub(super) type Match = [f64; 4];

/// Score of a fundamental matrix, `second' * F * first = 0`.
pub(super) fn fundamental(f: &Mat3, matches: &[Match]) -> f64 {
    matches.iter().map(|m| line_distances(f, m).map(|d| benefit(d, CHI2_1)).iter().sum::<f64>()).sum()
}

/// Number of matches within the threshold of both epipolar lines.
pub(super) fn fundamental_inliers(f: &Mat3, matches: &[Match]) -> usize {
    matches.iter().filter(|m| line_distances(f, m).iter().all(|&d| d < CHI2_1)).count()
}

/// Score of a homography, `second ~ H * first`, with its inverse.
pub(super) fn homography(h: &Mat3, inverse: &Mat3, matches: &[Match]) -> f64 {
    matches
        .iter()
        .map(|&[x, y, u, v]| {
            benefit(transfer(h, [x, y], [u, v]), CHI2_2) + benefit(transfer(inverse, [u, v], [x, y]), CHI2_2)
        })
        .sum()
}

/// Squared distances of the second point to the epipolar line of the first, and of the first to that of the second.
#[inline(always)]
pub(super) fn line_distances(f: &Mat3, &[x, y, u, v]: &Match) -> [f64; 2] {
    let a = f.m11 * x + f.m12 * y + f.m13;
    let b = f.m21 * x + f.m22 * y + f.m23;
    let c = f.m31 * x + f.m32 * y + f.m33;
    let e = u * a + v * b + c;
    let p = f.m11 * u + f.m21 * v + f.m31;
    let q = f.m12 * u + f.m22 * v + f.m32;
    let e2 = e * e;
    [e2 / (a * a + b * b), e2 / (p * p + q * q)]
}

#[inline(always)]
fn transfer(h: &Mat3, [x, y]: [f64; 2], [u, v]: [f64; 2]) -> f64 {
    let w = h.m31 * x + h.m32 * y + h.m33;
    let px = (h.m11 * x + h.m12 * y + h.m13) / w;
    let py = (h.m21 * x + h.m22 * y + h.m23) / w;
    (px - u) * (px - u) + (py - v) * (py - v)
}

/// Score of one squared distance: `CHI2_2 - d2` below the bound, zero above it (or for NaN).
#[inline(always)]
fn benefit(d2: f64, bound: f64) -> f64 {
    if d2 < bound { CHI2_2 - d2 } else { 0.0 }
}
