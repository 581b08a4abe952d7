//! Stereo matching of features with sub-pixel disparity.
//!
//! Candidates are the right features in a band of rows of the rectified pair and are compared by descriptor. The
//! disparity is then refined by aligning a patch of the raw left pyramid level with the raw right one along the
//! epipolar line (Lucas and Kanade 1981, one unknown). The right patch is warped by the local affine map between the
//! two images, and the gain and offset of the exposure are free. Images are never rectified.

mod lattice;
mod patch;
mod sample;
#[cfg(target_arch = "x86_64")]
mod sample_avx2;
mod seeds;
mod warp;

use crate::orb::{Backend, hamming};
use crate::parallel::in_halves;
use crate::rectify::Rectifier;
use crate::{Descriptor, Octaves};
use cairn_sensor::GrayImage;
use cairn_settings::Settings;
use patch::{AREA, Fit, PADDED, Patch, Template, dot, energy};
use sample::sample;
use seeds::DisparitySeeds;
use warp::Warp;

/// Maximum number of alignment iterations.
const STEPS: usize = 6;
/// Convergence threshold: step in pixels of the level; the remaining error is a small fraction of it.
const CONVERGED_STEP: f32 = 0.05;
/// Correlation after one iteration below which an alignment is abandoned.
const MIN_FIRST_CORRELATION: f32 = 0.5;

/// Configuration of the stereo matcher.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct StereoConfig {
    /// Largest Hamming distance between the descriptors of one point, of 256 bits.
    #[setting(default = 75, range = 0..=256)]
    pub max_hamming: u32,
    /// Half height of the searched band of rows, in pixels of the feature's level.
    #[setting(default = 2.0, range = 0.5..=100.0)]
    pub row_tolerance: f64,
    /// Smallest depth searched, in baselines.
    #[setting(default = 1.0, range = 0.1..=100.0)]
    pub min_depth_baselines: f64,
    /// Disparity in pixels below which a point is treated as infinitely far: it gets a right x, but no depth.
    #[setting(default = 0.3, range = 0.0..=100.0)]
    pub min_disparity: f64,
    /// Depth up to which a point is close (well located from one view), in baselines.
    #[setting(default = 40.0, range = 1.0..=1e4)]
    pub close_baselines: f64,
    /// Largest shift of a match by the sub-pixel alignment, in pixels of the level.
    #[setting(default = 2.5, range = 0.1..=20.0)]
    pub max_shift: f64,
    /// Minimum zero-mean normalised cross-correlation of the aligned patches.
    #[setting(default = 0.8, range = -1.0..=1.0)]
    pub min_correlation: f32,
    /// Matches for which one minus the correlation exceeds this many times the median are dropped.
    #[setting(default = 8.0, range = 1.0..=1e4)]
    pub max_over_median: f32,
    /// Maximum standard deviation of the disparity in pixels of the level, estimated from residual and texture.
    #[setting(default = 0.3, range = 1e-3..=100.0)]
    pub max_sigma: f32,
    /// Minimum correlation of a match at the disparity of a neighbour, tried for features without a match of their
    /// own; a value above one disables such matches.
    #[setting(default = 0.95, range = -1.0..=2.0)]
    pub borrow_correlation: f32,
}

/// Features and pyramid of one camera of the pair.
#[derive(Clone, Copy)]
pub(crate) struct Side<'a> {
    /// Pixels in the raw image.
    pub raw: &'a [[f32; 2]],
    /// Rectified pixels; NaN outside the rectified view.
    pub px: &'a [[f32; 2]],
    /// Pyramid level.
    pub octave: &'a [u8],
    /// Descriptors.
    pub descriptors: &'a [Descriptor],
    /// Pyramid levels of the raw image, finest first.
    pub levels: &'a [GrayImage],
}

/// Matches stereo features; reuse one from frame to frame to reuse its buffers.
#[derive(Clone, Debug)]
pub(crate) struct StereoMatcher {
    config: StereoConfig,
    left: Rectifier,
    right: Rectifier,
    octaves: Octaves,
    /// Baseline times focal length in pixel metres.
    baseline_fx: f64,
    /// Start of each rectified row in `order`.
    starts: Vec<u32>,
    /// Right features sorted by rectified row.
    order: Vec<RowFeature>,
    seeds: DisparitySeeds,
    backend: Backend,
}

/// A right feature, sorted by row.
#[derive(Clone, Copy, Debug, Default)]
struct RowFeature {
    px: [f32; 2],
    octave: u8,
    index: u32,
}

/// An accepted match of a left feature.
#[derive(Clone, Copy, Debug)]
struct StereoMatch {
    left: u32,
    disparity: f32,
    correlation: f32,
}

/// A match at the disparity of a neighbour.
#[derive(Clone, Copy, Debug)]
struct BorrowedMatch {
    left: u32,
    disparity: f64,
}

/// Correlation of the left patch with a right patch, given the least-squares `gain` between their contrasts.
fn correlation(gain: f32, fit: &Fit, patch: &Patch) -> f32 {
    (gain * gain * fit.contrast_energy / energy(*patch).max(1e-6)).sqrt()
}

/// Result of the alignment of one match.
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
        let (starts, order) = (Vec::new(), Vec::new());
        Self {
            config,
            left,
            right,
            octaves,
            baseline_fx,
            starts,
            order,
            seeds: DisparitySeeds::default(),
            backend: Backend::detect(),
        }
    }

    /// Rectifier of the left camera.
    pub(crate) fn left(&self) -> &Rectifier {
        &self.left
    }

    /// Rectifier of the right camera.
    pub(crate) fn right(&self) -> &Rectifier {
        &self.right
    }

    /// Writes the rectified right x and the depth of each left feature, NaN without a match; points that are
    /// practically at infinity get only a right x. With two threads each takes half of the features; the result is the
    /// same.
    pub(crate) fn run(
        &mut self,
        left: Side,
        right: Side,
        two_threads: bool,
        right_x: &mut Vec<f32>,
        depth: &mut Vec<f32>,
    ) {
        right_x.clear();
        right_x.resize(left.px.len(), f32::NAN);
        depth.clear();
        depth.resize(left.px.len(), f32::NAN);
        let Some(first_row) = self.sort_rows(&right) else { return };
        let this = &*self;
        let found = in_halves(left.px.len(), two_threads, |range| {
            range.filter_map(|i| this.match_feature(&left, i, &right, first_row)).collect()
        });
        let correlation_gate = self.correlation_gate(&found);
        for f in found.iter().filter(|f| f.correlation >= correlation_gate) {
            let i = f.left as usize;
            (right_x[i], depth[i]) = self.right_x_and_depth(left.px[i][0], f.disparity as f64);
        }
        if self.config.borrow_correlation <= 1.0 {
            let matched = found.iter().filter(|f| depth[f.left as usize] > 0.0);
            self.seeds.fill(matched.map(|f| (left.px[f.left as usize], f.disparity)));
            let correlation_gate = correlation_gate.max(self.config.borrow_correlation);
            let this = &*self;
            let matched = &*right_x;
            let borrowed = in_halves(left.px.len(), two_threads, |range| {
                // Those matched by the first pass are left out. Matches of this pass are not used as seeds.
                let open = range.filter(|i| !matched[*i].is_finite());
                open.filter_map(|i| this.match_as_neighbours(&left, i, &right, correlation_gate)).collect()
            });
            for m in borrowed {
                let i = m.left as usize;
                (right_x[i], depth[i]) = self.right_x_and_depth(left.px[i][0], m.disparity);
            }
        }
    }

    /// First pass: the match of a left feature with the right feature of the nearest descriptor.
    fn match_feature(&self, left: &Side, i: usize, right: &Side, first_row: i32) -> Option<StereoMatch> {
        let j = self.best_candidate(left, i, right, first_row)?;
        let start = (left.px[i][0] - right.px[j][0]) as f64;
        let a = self.align(left, i, &self.template(left, i)?, right, start)?;
        Some(StereoMatch { left: i as u32, disparity: a.disparity as f32, correlation: a.correlation })
    }

    /// The right x and the depth of a match. Points too far away for a depth keep their right x: keeping only
    /// disparities that noise made large enough would bias distant points towards the camera.
    fn right_x_and_depth(&self, left_x: f32, disparity: f64) -> (f32, f32) {
        let depth =
            if disparity < self.config.min_disparity { f64::NAN } else { self.baseline_fx / disparity };
        (left_x - disparity as f32, depth as f32)
    }

    /// Second pass: a feature without a match of its own tries the disparities of matched neighbours.
    fn match_as_neighbours(
        &self,
        left: &Side,
        i: usize,
        right: &Side,
        correlation_gate: f32,
    ) -> Option<BorrowedMatch> {
        let template = self.template(left, i)?;
        let scale = self.octaves.scale(left.octave[i]) as f32;
        self.seeds.near(left.px[i], scale).find_map(|disparity| {
            let aligned = self.align(left, i, &template, right, disparity as f64);
            let aligned = aligned.filter(|a| a.correlation >= correlation_gate)?;
            Some(BorrowedMatch { left: i as u32, disparity: aligned.disparity })
        })
    }

    /// Sorts the right features into buckets by row; returns the row of the first bucket, `None` without features.
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
        self.order.resize(self.starts[self.starts.len() - 1] as usize, RowFeature::default());
        // Filling moves each start to the end of its row, which is the start of the next: shifted back below.
        for (j, p) in right.px.iter().enumerate().filter(|(_, p)| p[1].is_finite()) {
            let slot = &mut self.starts[bucket(p[1])];
            self.order[*slot as usize] = RowFeature { px: *p, octave: right.octave[j], index: j as u32 };
            *slot += 1;
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        Some(first as i32)
    }

    /// The right feature with the nearest descriptor, among those in the band of rows, on neighbouring levels and at a
    /// valid disparity.
    fn best_candidate(&self, left: &Side, i: usize, right: &Side, first_row: i32) -> Option<usize> {
        let s = &self.config;
        let [u, v] = left.px[i];
        let octave = left.octave[i];
        let tolerance = (s.row_tolerance * self.octaves.scale(octave)) as f32;
        // Margin for the shift of the alignment.
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

    /// The pixel nearest to a left feature on its level: patches are centred there, so that they need no interpolation.
    fn centre(&self, left: &Side, i: usize) -> [f64; 2] {
        let scale = self.octaves.scale(left.octave[i]);
        left.raw[i].map(|c| ((c as f64 + 0.5) / scale - 0.5).round())
    }

    /// The patch around a left feature.
    fn template(&self, left: &Side, i: usize) -> Option<Template> {
        Template::cut(left.levels.get(left.octave[i] as usize)?, self.centre(left, i))
    }

    /// Aligns the patch of left feature `i` along the epipolar line, starting from a disparity in rectified pixels.
    fn align(&self, left: &Side, i: usize, template: &Template, right: &Side, start: f64) -> Option<Aligned> {
        let level = left.octave[i];
        let r_image = right.levels.get(level as usize)?;
        let scale = self.octaves.scale(level);
        let centre = self.centre(left, i);
        let warp = Warp::new(&self.left, &self.right, centre, scale, start)?;
        let fit = template.prepare(warp.direction_left)?;
        let mut shift = 0.0; // of the disparity, in pixels of the level
        let mut patch = [0.0; PADDED];
        let mut gain = 0.0;
        let mut converged = false;
        for done in 0..STEPS {
            sample(r_image, warp.at(shift), &warp.affine, &mut patch, self.backend)?;
            gain = dot(&fit.contrast, &patch) / fit.contrast_energy;
            // After one step, patches of the same point already correlate; others are abandoned early.
            if gain < 0.1 || done == 1 && correlation(gain, &fit, &patch) < MIN_FIRST_CORRELATION {
                return None;
            }
            let step = (-dot(&fit.slope, &patch) / (gain * fit.slope_energy)).clamp(-1.5, 1.5);
            shift += step as f64;
            if shift.abs() > self.config.max_shift {
                return None;
            }
            if step.abs() < CONVERGED_STEP {
                converged = true;
                break;
            }
        }
        if !converged {
            return None;
        }
        let disparity = start + shift * scale;
        // Noise makes disparities of points at infinity negative.
        let least = -3.0 * f64::from(self.config.max_sigma) * scale;
        if disparity < least || disparity > self.max_disparity() {
            return None;
        }
        // The residual: the part of the right patch that the left one does not explain.
        let energy = energy(patch);
        let explained = gain * gain * fit.contrast_energy;
        let correlation = (explained / energy.max(1e-6)).sqrt();
        let residual = (energy - explained).max(0.0) / (AREA - 3) as f32;
        let sigma = (residual / fit.slope_energy).sqrt() / gain;
        let s = &self.config;
        (correlation >= s.min_correlation && sigma <= s.max_sigma)
            .then_some(Aligned { disparity, correlation })
    }

    /// The correlation below which a match is an outlier compared with the other matches.
    fn correlation_gate(&self, found: &[StereoMatch]) -> f32 {
        if found.len() < 8 {
            return 0.0;
        }
        let mut rest: Vec<f32> = found.iter().map(|f| 1.0 - f.correlation).collect();
        let middle = rest.len() / 2;
        let (_, median, _) = rest.select_nth_unstable_by(middle, f32::total_cmp);
        1.0 - *median * self.config.max_over_median
    }
}
