//! Stereo matching of features: which right feature belongs to a left one, and the disparity to a fraction of a pixel.
//!
//! Candidates lie in a band of rows of the rectified pair and are compared by descriptor. The disparity is then found
//! by aligning a patch of the raw left pyramid level with the raw right one along the epipolar line (Lucas and Kanade
//! 1981, one unknown), the right patch being warped by the local affine map between the two images, and gain and
//! offset of the exposure being free. No image is ever rectified.

mod patch;
mod sample;
#[cfg(target_arch = "x86_64")]
mod sample_avx2;
mod seeds;
mod warp;

use crate::orb::{Backend, hamming};
use crate::rectify::Rectifier;
use crate::{Descriptor, Octaves};
use cairn_sensor::GrayImage;
use patch::{AREA, Fit, PADDED, Patch, Template, dot, energy};
use sample::sample;
use seeds::DisparitySeeds;
use warp::Warp;

/// Steps of the alignment, at most.
const STEPS: usize = 6;
/// Step in pixels of the level after which no other is made; what is left is a small part of it.
const SETTLED: f32 = 0.05;
/// Correlation after one step below which an alignment is given up.
const HOPELESS: f32 = 0.5;

/// What is asked of the stereo matcher.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StereoConfig {
    /// Bits in which descriptors of one point may differ.
    pub max_hamming: u32,
    /// Half the band of rows searched, in pixels of the feature's level.
    pub row_tolerance: f64,
    /// Nearest depth sought, in baselines.
    pub min_depth_baselines: f64,
    /// Disparity in pixels below which a point counts as infinitely far and gets no depth, only a right x.
    pub min_disparity: f64,
    /// Depth up to which a point is "close", in baselines.
    pub close_baselines: f64,
    /// Pixels of the level that the alignment may move the match.
    pub max_shift: f64,
    /// Least correlation (zero-mean, normalised) of the aligned patches.
    pub min_correlation: f32,
    /// Matches whose unexplained share of contrast (one minus correlation) is more than this many times the median
    /// are dropped.
    pub max_over_median: f32,
    /// Largest standard deviation of the disparity in pixels of the level, told from residual and texture.
    pub max_sigma: f32,
    /// Least correlation of a match at the disparity of a neighbour, for features without a match of their own; above one
    /// turns such matches off.
    pub borrow_correlation: f32,
}

impl Default for StereoConfig {
    fn default() -> Self {
        Self {
            max_hamming: 75,
            row_tolerance: 2.0,
            min_depth_baselines: 1.0,
            min_disparity: 0.3,
            close_baselines: 40.0,
            max_shift: 2.5,
            min_correlation: 0.8,
            max_over_median: 8.0,
            max_sigma: 0.3,
            borrow_correlation: 0.95,
        }
    }
}

/// Features of one side with its pyramid.
#[derive(Clone, Copy)]
pub(crate) struct Side<'a> {
    /// Pixels of the camera's own image.
    pub raw: &'a [[f32; 2]],
    /// Rectified pixels; NaN where there are none.
    pub px: &'a [[f32; 2]],
    /// Pyramid level.
    pub octave: &'a [u8],
    /// Descriptors.
    pub descriptors: &'a [Descriptor],
    /// Levels of the camera's own image, finest first.
    pub levels: &'a [GrayImage],
}

/// Matches stereo features; reuse it from frame to frame, for its buffers.
#[derive(Clone, Debug)]
pub(crate) struct StereoMatcher {
    config: StereoConfig,
    left: Rectifier,
    right: Rectifier,
    octaves: Octaves,
    /// Baseline times focal length, pixel metres.
    baseline_fx: f64,
    /// Right features by rectified row: start of each row in `order`.
    starts: Vec<u32>,
    order: Vec<InRow>,
    found: Vec<Found>,
    seeds: DisparitySeeds,
    backend: Backend,
}

/// A right feature in its row.
#[derive(Clone, Copy, Debug, Default)]
struct InRow {
    px: [f32; 2],
    octave: u8,
    index: u32,
}

#[derive(Clone, Copy, Debug)]
struct Found {
    left: u32,
    disparity: f32,
    correlation: f32,
}

/// Correlation of the left patch with a right one, of which it explains `gain` times its own contrast.
fn correlation(gain: f32, fit: &Fit, patch: &Patch) -> f32 {
    (gain * gain * fit.contrast_energy / energy(*patch).max(1e-6)).sqrt()
}

/// What the alignment of one match found.
#[derive(Clone, Copy, Debug)]
struct Aligned {
    disparity: f64,
    correlation: f32,
}

impl StereoMatcher {
    pub(crate) fn new(
        config: StereoConfig,
        left: Rectifier,
        right: Rectifier,
        octaves: Octaves,
        baseline_fx: f64,
    ) -> Self {
        let (starts, order, found) = (Vec::new(), Vec::new(), Vec::new());
        Self {
            config,
            left,
            right,
            octaves,
            baseline_fx,
            starts,
            order,
            found,
            seeds: DisparitySeeds::default(),
            backend: Backend::detect(),
        }
    }

    /// Maps raw left pixels.
    pub(crate) fn left(&self) -> &Rectifier {
        &self.left
    }

    /// Maps raw right pixels.
    pub(crate) fn right(&self) -> &Rectifier {
        &self.right
    }

    /// Writes the rectified right x and the depth of each left feature, NaN where there is none; what is nearly infinitely
    /// far has the first alone.
    pub(crate) fn run(&mut self, left: Side, right: Side, right_x: &mut Vec<f32>, depth: &mut Vec<f32>) {
        right_x.clear();
        right_x.resize(left.px.len(), f32::NAN);
        depth.clear();
        depth.resize(left.px.len(), f32::NAN);
        let Some(first_row) = self.sort_rows(&right) else { return };
        let mut found = std::mem::take(&mut self.found);
        found.clear();
        for i in 0..left.px.len() {
            let Some(j) = self.best_candidate(&left, i, &right, first_row) else { continue };
            let start = (left.px[i][0] - right.px[j][0]) as f64;
            let template = self.template(&left, i);
            if let Some(a) = template.and_then(|t| self.align(&left, i, &t, &right, start)) {
                found.push(Found {
                    left: i as u32,
                    disparity: a.disparity as f32,
                    correlation: a.correlation,
                });
            }
        }
        let gate = self.gate(&found);
        for f in found.iter().filter(|f| f.correlation >= gate) {
            let i = f.left as usize;
            (right_x[i], depth[i]) = self.measured(left.px[i][0], f.disparity as f64);
        }
        self.found = found;
        if self.config.borrow_correlation <= 1.0 {
            let gate = gate.max(self.config.borrow_correlation);
            self.borrow(&left, &right, gate, right_x, depth);
        }
    }

    /// The right x and the depth of a match. Of what is too far for a depth the right x stays: who kept only disparities that
    /// noise made large enough would see the far world too near.
    fn measured(&self, left_x: f32, disparity: f64) -> (f32, f32) {
        let depth =
            if disparity < self.config.min_disparity { f64::NAN } else { self.baseline_fx / disparity };
        (left_x - disparity as f32, depth as f32)
    }

    /// Second pass: features without a match of their own try the disparities of matched features near them.
    fn borrow(&mut self, left: &Side, right: &Side, gate: f32, right_x: &mut [f32], depth: &mut [f32]) {
        let mut seeds = std::mem::take(&mut self.seeds);
        seeds.fill(left.px, &self.found, depth);
        for i in 0..left.px.len() {
            // Those that the first pass matched; what this pass adds is not lent.
            if right_x[i].is_finite() {
                continue;
            }
            let Some(template) = self.template(left, i) else { continue };
            let scale = self.octaves.scale(left.octave[i]) as f32;
            for disparity in seeds.near(left.px[i], scale) {
                let aligned = self.align(left, i, &template, right, disparity as f64);
                if let Some(a) = aligned.filter(|a| a.correlation >= gate) {
                    (right_x[i], depth[i]) = self.measured(left.px[i][0], a.disparity);
                    break;
                }
            }
        }
        self.seeds = seeds;
    }

    /// Buckets right features by row; gives the row of the first bucket, `None` without features.
    fn sort_rows(&mut self, right: &Side) -> Option<i32> {
        let rows = || right.px.iter().map(|p| p[1]).filter(|y| y.is_finite());
        let first = rows().fold(f32::INFINITY, f32::min).floor();
        let last = rows().fold(f32::NEG_INFINITY, f32::max).floor();
        if !(first.is_finite() && last.is_finite()) {
            return None;
        }
        let bucket = |y: f32| (y.floor() - first) as usize;
        self.starts.clear();
        self.starts.resize(bucket(last) + 2, 0);
        for y in rows() {
            self.starts[bucket(y) + 1] += 1;
        }
        for r in 1..self.starts.len() {
            self.starts[r] += self.starts[r - 1];
        }
        self.order.clear();
        self.order.resize(self.starts[self.starts.len() - 1] as usize, InRow::default());
        // Filling moves each start to the end of its row, which is the start of the next: shifted back below.
        for (j, p) in right.px.iter().enumerate().filter(|(_, p)| p[1].is_finite()) {
            let slot = &mut self.starts[bucket(p[1])];
            self.order[*slot as usize] = InRow { px: *p, octave: right.octave[j], index: j as u32 };
            *slot += 1;
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        Some(first as i32)
    }

    /// The right feature nearest in descriptor among those in the band of rows, of neighbouring levels, at a possible disparity.
    fn best_candidate(&self, left: &Side, i: usize, right: &Side, first_row: i32) -> Option<usize> {
        let s = &self.config;
        let [u, v] = left.px[i];
        let octave = left.octave[i];
        let tolerance = (s.row_tolerance * self.octaves.scale(octave)) as f32;
        // Slack for what the alignment may still move.
        let slack = tolerance;
        let rows = self.starts.len() as i32 - 1;
        let from = ((v - tolerance).floor() as i32 - first_row).clamp(0, rows);
        let to = ((v + tolerance).floor() as i32 - first_row + 1).clamp(0, rows);
        let max_disparity = (self.max_disparity()) as f32 + slack;
        let mut best = (s.max_hamming + 1, usize::MAX);
        let band = self.starts[from as usize] as usize..self.starts[to as usize] as usize;
        for c in &self.order[band] {
            let disparity = u - c.px[0];
            if disparity < -slack
                || disparity > max_disparity
                || (c.px[1] - v).abs() > tolerance
                || c.octave.abs_diff(octave) > 1
            {
                continue;
            }
            let j = c.index as usize;
            let distance = hamming(&left.descriptors[i], &right.descriptors[j]);
            if distance < best.0 {
                best = (distance, j);
            }
        }
        (best.1 != usize::MAX).then_some(best.1)
    }

    fn max_disparity(&self) -> f64 {
        // disparity = baseline * fx / (baselines * baseline)
        self.left.focal_x() / self.config.min_depth_baselines
    }

    /// The whole pixel of its level nearest to a left feature: patches sit there, so that they need not be interpolated.
    fn centre(&self, left: &Side, i: usize) -> [f64; 2] {
        let scale = self.octaves.scale(left.octave[i]);
        left.raw[i].map(|c| ((c as f64 + 0.5) / scale - 0.5).round())
    }

    /// The patch around a left feature.
    fn template(&self, left: &Side, i: usize) -> Option<Template> {
        Template::cut(left.levels.get(left.octave[i] as usize)?, self.centre(left, i))
    }

    /// Aligns the patches of left feature `i` along the epipolar line, from a first disparity in rectified pixels.
    fn align(&self, left: &Side, i: usize, template: &Template, right: &Side, start: f64) -> Option<Aligned> {
        let level = left.octave[i];
        let r_image = right.levels.get(level as usize)?;
        let scale = self.octaves.scale(level);
        let centre = self.centre(left, i);
        let warp = Warp::new(&self.left, &self.right, centre, scale, start)?;
        let fit = template.prepare(&warp)?;
        let mut shift = 0.0; // of the disparity, in pixels of the level
        let mut patch = [0.0; PADDED];
        let mut gain = 0.0;
        let mut converged = false;
        for done in 0..STEPS {
            sample(r_image, warp.at(shift), &warp.affine, &mut patch, self.backend)?;
            gain = dot(&fit.contrast, &patch) / fit.contrast_energy;
            // One step brings patches of one place near enough to look alike; others are given up early.
            if gain < 0.1 || done == 1 && correlation(gain, &fit, &patch) < HOPELESS {
                return None;
            }
            let step = (-dot(&fit.slope, &patch) / (gain * fit.slope_energy)).clamp(-1.5, 1.5);
            shift += step as f64;
            if shift.abs() > self.config.max_shift {
                return None;
            }
            if step.abs() < SETTLED {
                converged = true;
                break;
            }
        }
        if !converged {
            return None;
        }
        let disparity = start + shift * scale;
        // Noise takes what is infinitely far below zero.
        let least = -3.0 * f64::from(self.config.max_sigma) * scale;
        if disparity < least || disparity > self.max_disparity() {
            return None;
        }
        // What the left patch does not explain of the right one.
        let energy = energy(patch);
        let explained = gain * gain * fit.contrast_energy;
        let correlation = (explained / energy.max(1e-6)).sqrt();
        let residual = (energy - explained).max(0.0) / (AREA - 3) as f32;
        let sigma = (residual / fit.slope_energy).sqrt() / gain;
        let s = &self.config;
        (correlation >= s.min_correlation && sigma <= s.max_sigma)
            .then_some(Aligned { disparity, correlation })
    }

    /// The correlation below which a match is an outlier among its fellows.
    fn gate(&self, found: &[Found]) -> f32 {
        if found.len() < 8 {
            return 0.0;
        }
        let mut rest: Vec<f32> = found.iter().map(|f| 1.0 - f.correlation).collect();
        let middle = rest.len() / 2;
        let (_, median, _) = rest.select_nth_unstable_by(middle, f32::total_cmp);
        1.0 - *median * self.config.max_over_median
    }
}
