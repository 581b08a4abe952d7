//! Points matched to the features of one frame, and their normal equations by the camera pose, many matches at a time.
//!
//! Matches are kept in blocks of eight, each quantity of the eight beside each other, and every sum has eight parts, which are added
//! at the end in one order: so the compiler can compute the eight at once, and the bits are the same on every machine.

use crate::reprojection::View;
use crate::{CHI2_2, CHI2_3, DenseNormal, Pinhole, Pixel};
use cairn_geometry::{Se3, Vec3};
use nalgebra::{SMatrix, SVector};

/// A landmark matched to a feature.
#[derive(Clone, Copy, Debug)]
pub struct PointMatch {
    /// Position of the landmark in the world, metres.
    pub point: Vec3,
    /// Measured pixel of the feature.
    pub pixel: Pixel,
    /// Inverse variance of the pixel, 1/px^2.
    pub weight: f64,
}

impl PointMatch {
    /// The bound of its squared whitened residual.
    pub(crate) fn bound(&self) -> f64 {
        if self.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 }
    }
}

/// Matches of a block.
const LANES: usize = 8;
/// One quantity of each match of a block.
type Lanes = [f64; LANES];

/// Eight matches.
#[derive(Clone, Copy, Default)]
struct Block {
    point: [Lanes; 3],
    pixel: [Lanes; 2],
    /// Measured x in the right image less x; zero where there is none.
    right: Lanes,
    /// One where there is a right image, else zero.
    has_right: Lanes,
    bound: Lanes,
    /// Zero for matches that do not count.
    weight: Lanes,
}

/// Matches, ready for [`MatchedPoints::normal_equations`].
pub(crate) struct MatchedPoints {
    blocks: Vec<Block>,
}

/// Sums of a block: the entries of the Hessian that are not zero by the form of the rows, those of the gradient, the cost.
const SUMS: usize = 28;

impl MatchedPoints {
    /// All matches count.
    pub fn new(matches: &[PointMatch]) -> Self {
        let block = |eight: &[PointMatch]| {
            let mut block = Block::default();
            for (l, m) in eight.iter().enumerate() {
                (0..3).for_each(|k| block.point[k][l] = m.point[k]);
                (0..2).for_each(|k| block.pixel[k][l] = m.pixel[k]);
                if !m.pixel[2].is_nan() {
                    (block.right[l], block.has_right[l]) = (m.pixel[2] - m.pixel[0], 1.0);
                }
                (block.bound[l], block.weight[l]) = (m.bound(), m.weight);
            }
            block
        };
        Self { blocks: matches.chunks(LANES).map(block).collect() }
    }

    /// From now on only these of the matches count.
    pub fn count_only(&mut self, matches: &[PointMatch], counted: &[bool]) {
        let blocks = self.blocks.iter_mut().zip(matches.chunks(LANES).zip(counted.chunks(LANES)));
        for (block, (matches, counted)) in blocks {
            for (l, (m, counts)) in matches.iter().zip(counted).enumerate() {
                block.weight[l] = if *counts { m.weight } else { 0.0 };
            }
        }
    }

    /// The normal equations of the matches that count, without damping, with Huber's loss or the plain square. Points behind
    /// the camera are left out.
    pub fn normal_equations(&self, camera: &Pinhole, pose: &Se3, robust: bool) -> DenseNormal<6> {
        let view = View::new(pose);
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512vl") {
            #[allow(unsafe_code)]
            // SAFETY: AVX-512 F and VL are available.
            return unsafe { sum_avx512(&self.blocks, camera, &view, robust) };
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            #[allow(unsafe_code)]
            // SAFETY: AVX2 is available.
            return unsafe { sum_avx2(&self.blocks, camera, &view, robust) };
        }
        sum(&self.blocks, camera, &view, robust)
    }
}

/// [`sum`] compiled for AVX-512: the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl")]
fn sum_avx512(blocks: &[Block], camera: &Pinhole, view: &View, robust: bool) -> DenseNormal<6> {
    sum(blocks, camera, view, robust)
}

/// [`sum`] compiled for AVX2: the same bits.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn sum_avx2(blocks: &[Block], camera: &Pinhole, view: &View, robust: bool) -> DenseNormal<6> {
    sum(blocks, camera, view, robust)
}

#[inline(always)]
fn sum(blocks: &[Block], camera: &Pinhole, view: &View, robust: bool) -> DenseNormal<6> {
    let mut sums = [[0.0f64; LANES]; SUMS];
    for block in blocks {
        if robust {
            add::<true>(block, camera, view, &mut sums);
        } else {
            add::<false>(block, camera, view, &mut sums);
        }
    }
    let total = sums.map(|s| ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])));
    let mut entries = total.iter();
    let mut hessian = SMatrix::<f64, 6, 6>::zeros();
    for i in 0..6 {
        for j in i..6 {
            let entry = entries.next().copied().unwrap_or_default();
            (hessian[(i, j)], hessian[(j, i)]) = (entry, entry);
        }
    }
    DenseNormal { hessian, gradient: SVector::from_fn(|i, _| total[21 + i]), cost: total[27] }
}

/// Adds the parts of a block to the sums: the upper triangle of the Hessian row by row, the gradient, the cost.
///
/// The rows of the Jacobian, as in [`Pinhole::reproject`]: `u` does not depend on the position along y, `v` not on that along x, the
/// disparity on the depth alone.
#[inline(always)]
fn add<const ROBUST: bool>(block: &Block, camera: &Pinhole, view: &View, sums: &mut [Lanes; SUMS]) {
    let [r0, r1, r2] = view.rows();
    let [tx, ty, tz] = view.centre();
    for l in 0..LANES {
        let (px, py, pz) = (block.point[0][l] - tx, block.point[1][l] - ty, block.point[2][l] - tz);
        let x = r0[0] * px + r0[1] * py + r0[2] * pz;
        let y = r1[0] * px + r1[1] * py + r1[2] * pz;
        let depth = r2[0] * px + r2[1] * py + r2[2] * pz;
        let ahead = depth >= 1e-3;
        let z = if ahead { depth } else { 1.0 };
        let weight = if ahead { block.weight[l] } else { 0.0 };
        let inv = 1.0 / z;
        let inv2 = inv * inv;
        // Residuals: measured less predicted.
        let eu = block.pixel[0][l] - (camera.fx * x * inv + camera.cx);
        let ev = block.pixel[1][l] - (camera.fy * y * inv + camera.cy);
        let er = block.right[l] + block.has_right[l] * (camera.baseline_fx * inv);
        let chi2 = (eu * eu + ev * ev + er * er) * weight;
        // Huber's loss and its slope.
        let far = ROBUST && chi2 > block.bound[l];
        let (delta, r) = (block.bound[l].sqrt(), chi2.sqrt());
        let loss = if far { 2.0 * delta * r - block.bound[l] } else { chi2 };
        let slope = if far { delta / r } else { 1.0 };
        let w = slope * weight;
        // Jacobians: `u` by (x, z, and the rotation), `v` by (y, z, rotation), the disparity by (z, rotation x, y).
        let (a, c) = (-camera.fx * inv, camera.fx * x * inv2);
        let u = [-a, -c, -c * y, c * x - a * z, a * y];
        let (b, c) = (-camera.fy * inv, camera.fy * y * inv2);
        let v = [-b, -c, b * z - c * y, c * x, -b * x];
        let d = -block.has_right[l] * camera.baseline_fx * inv2;
        let s = [-d, -d * y, d * x];
        let (wu, wv, ws) = (u.map(|k| k * w), v.map(|k| k * w), s.map(|k| k * w));
        let entries = [
            wu[0] * u[0],
            0.0,
            wu[0] * u[1],
            wu[0] * u[2],
            wu[0] * u[3],
            wu[0] * u[4],
            wv[0] * v[0],
            wv[0] * v[1],
            wv[0] * v[2],
            wv[0] * v[3],
            wv[0] * v[4],
            wu[1] * u[1] + wv[1] * v[1] + ws[0] * s[0],
            wu[1] * u[2] + wv[1] * v[2] + ws[0] * s[1],
            wu[1] * u[3] + wv[1] * v[3] + ws[0] * s[2],
            wu[1] * u[4] + wv[1] * v[4],
            wu[2] * u[2] + wv[2] * v[2] + ws[1] * s[1],
            wu[2] * u[3] + wv[2] * v[3] + ws[1] * s[2],
            wu[2] * u[4] + wv[2] * v[4],
            wu[3] * u[3] + wv[3] * v[3] + ws[2] * s[2],
            wu[3] * u[4] + wv[3] * v[4],
            wu[4] * u[4] + wv[4] * v[4],
            wu[0] * eu,
            wv[0] * ev,
            wu[1] * eu + wv[1] * ev + ws[0] * er,
            wu[2] * eu + wv[2] * ev + ws[1] * er,
            wu[3] * eu + wv[3] * ev + ws[2] * er,
            wu[4] * eu + wv[4] * ev,
            0.5 * loss,
        ];
        for k in 0..SUMS {
            sums[k][l] += entries[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::huber;
    use cairn_geometry::So3;

    const CAMERA: Pinhole = Pinhole { fx: 500.0, fy: 490.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };

    fn pose() -> Se3 {
        Se3::new(So3::exp(&Vec3::new(0.1, 0.4, -0.2)), Vec3::new(0.5, -0.3, 0.2))
    }

    /// Some are behind the camera, some have no right x, some are far off, some do not count.
    fn matches() -> (Vec<PointMatch>, Vec<bool>) {
        let at = |i: usize| {
            let a = i as f64;
            let q = Vec3::new((a * 0.7).sin() * 2.0, (a * 1.3).cos() * 1.5, 4.0 + (a * 0.37).sin() * 5.0);
            let right = if i.is_multiple_of(3) { f64::NAN } else { 290.0 + a };
            PointMatch { point: pose() * q, pixel: [320.0 + a, 200.0, right], weight: 1.0 / (1.0 + a) }
        };
        ((0..97).map(at).collect(), (0..97).map(|i| i % 7 > 0).collect())
    }

    fn counted() -> MatchedPoints {
        let (matches, counts) = matches();
        let mut points = MatchedPoints::new(&matches);
        points.count_only(&matches, &counts);
        points
    }

    #[test]
    fn sums_are_those_of_the_reprojection_residuals() {
        let (matches, counts) = matches();
        for robust in [false, true] {
            let mut expected =
                DenseNormal { hessian: SMatrix::zeros(), gradient: SVector::zeros(), cost: 0.0 };
            for (m, _) in matches.iter().zip(&counts).filter(|(_, counts)| **counts) {
                let Some(l) = CAMERA.reproject(&pose(), &m.point, &m.pixel) else { continue };
                let chi2 = l.residual.iter().map(|r| r * r).sum::<f64>() * m.weight;
                let (loss, slope) = if robust { huber(chi2, m.bound()) } else { (chi2, 1.0) };
                expected.cost += 0.5 * loss;
                for (row, r) in l.by_pose.iter().zip(&l.residual) {
                    let row = SVector::<f64, 6>::from(*row);
                    expected.hessian += row * row.transpose() * (slope * m.weight);
                    expected.gradient += row * (slope * m.weight * r);
                }
            }
            let found = counted().normal_equations(&CAMERA, &pose(), robust);
            let close = |a: f64, b: f64, size: f64| (a - b).abs() < 1e-12 * size;
            assert!(close(found.cost, expected.cost, expected.cost), "{} {}", found.cost, expected.cost);
            let size = expected.hessian.amax();
            assert!(found.hessian.iter().zip(&expected.hessian).all(|(a, b)| close(*a, *b, size)));
            let size = expected.gradient.amax();
            assert!(found.gradient.iter().zip(&expected.gradient).all(|(a, b)| close(*a, *b, size)));
            assert!(found.hessian.determinant() > 0.0);
        }
    }

    #[test]
    fn vector_code_gives_the_same_bits() {
        for robust in [false, true] {
            let points = counted();
            let scalar = sum(&points.blocks, &CAMERA, &View::new(&pose()), robust);
            let found = points.normal_equations(&CAMERA, &pose(), robust);
            assert_eq!(scalar.hessian.map(f64::to_bits), found.hessian.map(f64::to_bits));
            assert_eq!(scalar.gradient.map(f64::to_bits), found.gradient.map(f64::to_bits));
            assert_eq!(scalar.cost.to_bits(), found.cost.to_bits());
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx2") {
                #[allow(unsafe_code)]
                // SAFETY: AVX2 is available.
                let avx2 = unsafe { sum_avx2(&points.blocks, &CAMERA, &View::new(&pose()), robust) };
                assert_eq!(scalar.hessian.map(f64::to_bits), avx2.hessian.map(f64::to_bits));
            }
        }
    }
}
