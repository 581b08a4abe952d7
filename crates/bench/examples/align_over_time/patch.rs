//! Alignment of a patch of an earlier image with a later one: two unknowns (shift in x and y), inverse compositional (Baker
//! and Matthews 2004), with the gain and offset of the exposure free.

use cairn_sensor::GrayImage;
use nalgebra::{Matrix2, Vector2};

/// How a patch is aligned.
#[derive(Clone, Copy, Debug)]
pub struct Alignment {
    /// Side of the patch in pixels of its level.
    pub side: usize,
    /// True when the contrast may change too, not only the brightness.
    pub gain: bool,
    /// Largest shift in pixels of the level.
    pub max_shift: f64,
    /// Smallest zero-mean normalised correlation.
    pub min_correlation: f64,
}

/// Largest number of steps.
const STEPS: usize = 12;
/// Step in pixels of the level at which the alignment has converged.
const CONVERGED: f64 = 0.02;
/// Largest standard deviation of the shift, in pixels of the level.
const MAX_SIGMA: f64 = 0.3;

/// The patch of the earlier image, centred on a position between its pixels.
struct Template {
    /// Offsets of the pixels from the position.
    at: Vec<Vector2<f64>>,
    contrast: Vec<f64>,
    slope: Vec<Vector2<f64>>,
    energy: f64,
    inverse_hessian: Matrix2<f64>,
}

fn less_mean(v: &mut [f64]) {
    let mean = v.iter().sum::<f64>() / v.len() as f64;
    v.iter_mut().for_each(|x| *x -= mean);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Template {
    fn cut(image: &GrayImage, centre: [f64; 2], how: &Alignment) -> Option<Self> {
        let n = how.side;
        let [x0, y0] = centre.map(|c| (c - 0.5 * (n as f64 - 1.0)).round());
        if x0 < 1.0 || y0 < 1.0 || x0 as usize + n + 1 > image.width() || y0 as usize + n + 1 > image.height()
        {
            return None;
        }
        let (mut at, mut contrast, mut gx, mut gy) = (vec![], vec![], vec![], vec![]);
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
            let (x, y) = (x0 as usize + i, y0 as usize + j);
            at.push(Vector2::new(x as f64 - centre[0], y as f64 - centre[1]));
            let value = |x: usize, y: usize| f64::from(image.at(x, y));
            contrast.push(value(x, y));
            gx.push(0.5 * (value(x + 1, y) - value(x - 1, y)));
            gy.push(0.5 * (value(x, y + 1) - value(x, y - 1)));
        }
        less_mean(&mut contrast);
        let energy = dot(&contrast, &contrast);
        if energy < (n * n) as f64 {
            return None;
        }
        for g in [&mut gx, &mut gy] {
            less_mean(g);
            if how.gain {
                let along = dot(g, &contrast) / energy;
                g.iter_mut().zip(&contrast).for_each(|(g, c)| *g -= along * c);
            }
        }
        let slope: Vec<_> = gx.iter().zip(&gy).map(|(x, y)| Vector2::new(*x, *y)).collect();
        let hessian: Matrix2<f64> = slope.iter().map(|s| s * s.transpose()).sum();
        let inverse_hessian = hessian.try_inverse()?;
        Some(Self { at, contrast, slope, energy, inverse_hessian })
    }
}

fn bilinear(image: &GrayImage, p: Vector2<f64>) -> Option<f64> {
    let (x, y) = (p.x.floor(), p.y.floor());
    if x < 0.0 || y < 0.0 || x as usize + 1 >= image.width() || y as usize + 1 >= image.height() {
        return None;
    }
    let (fx, fy) = (p.x - x, p.y - y);
    let (x, y) = (x as usize, y as usize);
    let value = |x: usize, y: usize| f64::from(image.at(x, y));
    let top = value(x, y) * (1.0 - fx) + value(x + 1, y) * fx;
    let bottom = value(x, y + 1) * (1.0 - fx) + value(x + 1, y + 1) * fx;
    Some(top * (1.0 - fy) + bottom * fy)
}

/// A patch of `from` around a position, and where it may be in `to`; positions in pixels of the levels.
pub struct Pair<'a> {
    /// The level of the earlier image.
    pub from: &'a GrayImage,
    /// The position there.
    pub at: [f64; 2],
    /// The level of the later image.
    pub to: &'a GrayImage,
    /// The position found there.
    pub found: [f64; 2],
    /// Matrix from small offsets in `from` to offsets in `to`.
    pub affine: Matrix2<f64>,
    /// Offsets of any size, where more than the matrix is known.
    pub warp: Option<&'a dyn Fn(Vector2<f64>) -> Option<Vector2<f64>>>,
}

/// Where the patch fits best, in pixels of the level of `to`; `None` where it does not fit.
pub fn align(pair: &Pair, how: &Alignment) -> Option<[f64; 2]> {
    let t = Template::cut(pair.from, pair.at, how)?;
    let start = Vector2::new(pair.found[0], pair.found[1]);
    let moved = |o: &Vector2<f64>| pair.warp.map_or(Some(pair.affine * o), |warp| warp(*o));
    let offsets = t.at.iter().map(moved).collect::<Option<Vec<_>>>()?;
    let mut shift = Vector2::zeros();
    for _ in 0..STEPS {
        let mut patch =
            offsets.iter().map(|o| bilinear(pair.to, start + shift + o)).collect::<Option<Vec<f64>>>()?;
        less_mean(&mut patch);
        let along = dot(&t.contrast, &patch) / t.energy;
        if along < 0.1 {
            return None;
        }
        let gain = if how.gain { along } else { 1.0 };
        let residual: Vec<f64> = patch.iter().zip(&t.contrast).map(|(p, c)| p / gain - c).collect();
        let gradient: Vector2<f64> = residual.iter().zip(&t.slope).map(|(r, s)| s * *r).sum();
        let mut step = -(pair.affine * (t.inverse_hessian * gradient));
        let length = step.norm();
        if length > 1.5 {
            step *= 1.5 / length;
        }
        shift += step;
        if shift.norm() > how.max_shift {
            return None;
        }
        if length < CONVERGED {
            let correlation = along * (t.energy / dot(&patch, &patch).max(1e-9)).sqrt();
            let variance = dot(&residual, &residual) / (residual.len() as f64 - 4.0);
            let spread = t.inverse_hessian.symmetric_eigenvalues().max() * variance;
            let good = correlation >= how.min_correlation && spread.sqrt() <= MAX_SIGMA;
            return good.then(|| [start.x + shift.x, start.y + shift.y]);
        }
    }
    None
}
