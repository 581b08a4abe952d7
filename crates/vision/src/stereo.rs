//! Stereo matching of features: which right feature belongs to a left one, and the disparity to a fraction of a pixel.
//!
//! Candidates lie in a band of rows of the rectified pair and are compared by descriptor. The disparity is then found
//! by aligning a patch of the raw left pyramid level with the raw right one along the epipolar line (Lucas and Kanade
//! 1981, one unknown), the right patch being warped by the local affine map between the two images, and gain and
//! offset of the exposure being free. No image is ever rectified.

use crate::orb::hamming;
use crate::rectify::Rectifier;
use crate::{Descriptor, Octaves};
use cairn_geometry::Vec2;
use cairn_sensor::GrayImage;
use nalgebra::Matrix2;

/// Half the side of the aligned patch in pixels of the level.
const RADIUS: i32 = 5;
const SIDE: usize = 2 * RADIUS as usize + 1;
const AREA: usize = SIDE * SIDE;
/// Steps of the alignment, at most.
const STEPS: usize = 6;

/// What is asked of the stereo matcher.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StereoSetting {
    /// Bits in which descriptors of one point may differ.
    pub max_hamming: u32,
    /// Half the band of rows searched, in pixels of the feature's level.
    pub row_tolerance: f64,
    /// Nearest depth sought, in baselines.
    pub min_depth_baselines: f64,
    /// Disparity in pixels below which a point counts as infinitely far and gets no depth.
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
}

impl Default for StereoSetting {
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
    setting: StereoSetting,
    left: Rectifier,
    right: Rectifier,
    octaves: Octaves,
    /// Baseline times focal length, pixel metres.
    baseline_fx: f64,
    /// Right features by rectified row: start of each row in `order`.
    starts: Vec<u32>,
    order: Vec<u32>,
    found: Vec<Found>,
}

#[derive(Clone, Copy, Debug)]
struct Found {
    left: u32,
    disparity: f32,
    correlation: f32,
}

/// What the alignment of one match found.
#[derive(Clone, Copy, Debug)]
struct Aligned {
    disparity: f64,
    correlation: f32,
}

impl StereoMatcher {
    pub(crate) fn new(
        setting: StereoSetting,
        left: Rectifier,
        right: Rectifier,
        octaves: Octaves,
        baseline_fx: f64,
    ) -> Self {
        let (starts, order, found) = (Vec::new(), Vec::new(), Vec::new());
        Self { setting, left, right, octaves, baseline_fx, starts, order, found }
    }

    /// Maps raw left pixels.
    pub(crate) fn left(&self) -> &Rectifier {
        &self.left
    }

    /// Maps raw right pixels.
    pub(crate) fn right(&self) -> &Rectifier {
        &self.right
    }

    /// Writes the rectified right x and the depth of each left feature, NaN where there is none.
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
            if let Some(a) = self.align(&left, i, &right, start) {
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
            right_x[i] = left.px[i][0] - f.disparity;
            depth[i] = (self.baseline_fx / f.disparity as f64) as f32;
        }
        self.found = found;
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
        self.order.resize(self.starts[self.starts.len() - 1] as usize, 0);
        // Filling moves each start to the end of its row, which is the start of the next: shifted back below.
        for (j, p) in right.px.iter().enumerate().filter(|(_, p)| p[1].is_finite()) {
            let slot = &mut self.starts[bucket(p[1])];
            self.order[*slot as usize] = j as u32;
            *slot += 1;
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
        Some(first as i32)
    }

    /// The right feature nearest in descriptor among those in the band of rows, of neighbouring levels, at a possible disparity.
    fn best_candidate(&self, left: &Side, i: usize, right: &Side, first_row: i32) -> Option<usize> {
        let s = &self.setting;
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
        for &j in &self.order[self.starts[from as usize] as usize..self.starts[to as usize] as usize] {
            let j = j as usize;
            let p = right.px[j];
            let disparity = u - p[0];
            if disparity < -slack
                || disparity > max_disparity
                || (p[1] - v).abs() > tolerance
                || right.octave[j].abs_diff(octave) > 1
            {
                continue;
            }
            let distance = hamming(&left.descriptors[i], &right.descriptors[j]);
            if distance < best.0 {
                best = (distance, j);
            }
        }
        (best.1 != usize::MAX).then_some(best.1)
    }

    fn max_disparity(&self) -> f64 {
        // disparity = baseline * fx / (baselines * baseline)
        self.left.focal_x() / self.setting.min_depth_baselines
    }

    /// Aligns the patches of left feature `i` along the epipolar line, from a first disparity in rectified pixels.
    fn align(&self, left: &Side, i: usize, right: &Side, start: f64) -> Option<Aligned> {
        let level = left.octave[i] as usize;
        let (l_image, r_image) = (left.levels.get(level)?, right.levels.get(level)?);
        let scale = self.octaves.scale(level as u8);
        // The patch sits on whole pixels of the left level, so that it need not be interpolated.
        let centre = left.raw[i].map(|c| ((c as f64 + 0.5) / scale - 0.5).round());
        let template = Template::cut(l_image, centre)?;
        let warp = Warp::new(&self.left, &self.right, centre, scale, start)?;
        let fit = template.prepare(&warp)?;
        let mut shift = 0.0; // of the disparity, in pixels of the level
        let mut patch = [0.0; AREA];
        let mut gain = 0.0;
        let mut converged = false;
        for _ in 0..STEPS {
            sample(r_image, warp.at(shift), &warp.affine, &mut patch)?;
            gain = dot(&fit.contrast, &patch) / fit.contrast_energy;
            if gain < 0.1 {
                return None;
            }
            let step = (-dot(&fit.slope, &patch) / (gain * fit.slope_energy)).clamp(-1.5, 1.5);
            shift += step as f64;
            if shift.abs() > self.setting.max_shift {
                return None;
            }
            if step.abs() < 0.02 {
                converged = true;
                break;
            }
        }
        if !converged {
            return None;
        }
        let disparity = start + shift * scale;
        if disparity < self.setting.min_disparity || disparity > self.max_disparity() {
            return None;
        }
        // What the left patch does not explain of the right one.
        let mean = patch.iter().sum::<f32>() / AREA as f32;
        let energy = patch.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>();
        let explained = gain * gain * fit.contrast_energy;
        let correlation = (explained / energy.max(1e-6)).sqrt();
        let residual = (energy - explained).max(0.0) / (AREA - 3) as f32;
        let sigma = (residual / fit.slope_energy).sqrt() / gain;
        let s = &self.setting;
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
        1.0 - *median * self.setting.max_over_median
    }
}

/// A left patch on whole pixels with its gradients.
struct Template {
    value: [f32; AREA],
    gradient_x: [f32; AREA],
    gradient_y: [f32; AREA],
}

/// What stays the same over the steps of one alignment.
struct Fit {
    /// The patch without its mean.
    contrast: [f32; AREA],
    contrast_energy: f32,
    /// Derivative by the shift, made orthogonal to a change of offset and of gain.
    slope: [f32; AREA],
    slope_energy: f32,
}

impl Template {
    /// Cuts the patch; `None` at the image's edge.
    fn cut(image: &GrayImage, centre: [f64; 2]) -> Option<Self> {
        let (w, h) = (image.width() as i32, image.height() as i32);
        let (cx, cy) = (centre[0] as i32, centre[1] as i32);
        let reach = RADIUS + 1;
        if cx < reach || cy < reach || cx + reach >= w || cy + reach >= h {
            return None;
        }
        let mut t = Self { value: [0.0; AREA], gradient_x: [0.0; AREA], gradient_y: [0.0; AREA] };
        for j in 0..SIDE {
            let y = (cy - RADIUS) as usize + j;
            let x = (cx - reach) as usize;
            let above = &image.row(y - 1)[x..x + SIDE + 2];
            let here = &image.row(y)[x..x + SIDE + 2];
            let below = &image.row(y + 1)[x..x + SIDE + 2];
            for i in 0..SIDE {
                let k = j * SIDE + i;
                t.value[k] = here[i + 1] as f32;
                t.gradient_x[k] = 0.5 * (here[i + 2] as f32 - here[i] as f32);
                t.gradient_y[k] = 0.5 * (below[i + 1] as f32 - above[i + 1] as f32);
            }
        }
        Some(t)
    }

    /// Derivatives along the epipolar line; `None` without contrast or without texture along it.
    fn prepare(self, warp: &Warp) -> Option<Fit> {
        let mut contrast = self.value;
        let mean = contrast.iter().sum::<f32>() / AREA as f32;
        contrast.iter_mut().for_each(|v| *v -= mean);
        let contrast_energy = dot(&contrast, &contrast);
        // A contrast of one gray level is noise.
        if contrast_energy < AREA as f32 {
            return None;
        }
        let mut slope = [0.0; AREA];
        let [dx, dy] = warp.direction_left;
        for k in 0..AREA {
            slope[k] = self.gradient_x[k] * dx + self.gradient_y[k] * dy;
        }
        let mean = slope.iter().sum::<f32>() / AREA as f32;
        let along = dot(&slope, &contrast) / contrast_energy;
        for k in 0..AREA {
            slope[k] -= mean + along * contrast[k];
        }
        let slope_energy = dot(&slope, &slope);
        (slope_energy > 1.0).then_some(Fit { contrast, contrast_energy, slope, slope_energy })
    }
}

/// The local affine map from the left level to the right one.
struct Warp {
    /// Right level position at the first disparity.
    origin: [f64; 2],
    /// Motion of the right position for one pixel (of the level) of disparity.
    direction: [f64; 2],
    /// The same motion, mapped back into the left level.
    direction_left: [f32; 2],
    /// Right offset of a left offset, row by row.
    affine: [f32; 4],
}

impl Warp {
    fn new(
        left: &Rectifier,
        right: &Rectifier,
        centre: [f64; 2],
        scale: f64,
        disparity: f64,
    ) -> Option<Self> {
        let to_raw = |c: f64| (c + 0.5) * scale - 0.5;
        let to_level = |c: f64| (c + 0.5) / scale - 0.5;
        let raw = centre.map(to_raw);
        if left.is_identity() && right.is_identity() {
            return Some(Self {
                origin: [to_level(raw[0] - disparity), centre[1]],
                direction: [-1.0, 0.0],
                direction_left: [-1.0, 0.0],
                affine: [1.0, 0.0, 0.0, 1.0],
            });
        }
        let rectify = |dx: f64, dy: f64| {
            let p = left.rectify([(raw[0] + dx) as f32, (raw[1] + dy) as f32])?;
            Some(Vec2::new(p[0] as f64, p[1] as f64))
        };
        // Derivatives over the patch's own extent.
        let h = RADIUS as f64 * scale;
        let middle = rectify(0.0, 0.0)?;
        let rectified_from_left = Matrix2::from_columns(&[
            (rectify(h, 0.0)? - rectify(-h, 0.0)?) / (2.0 * h),
            (rectify(0.0, h)? - rectify(0.0, -h)?) / (2.0 * h),
        ]);
        let there = middle - Vec2::new(disparity, 0.0);
        let project = |dx: f64, dy: f64| right.raw([there.x + dx, there.y + dy]);
        let origin = project(0.0, 0.0)?;
        let right_from_rectified = Matrix2::from_columns(&[
            (project(h, 0.0)? - project(-h, 0.0)?) / (2.0 * h),
            (project(0.0, h)? - project(0.0, -h)?) / (2.0 * h),
        ]);
        let right_from_left = right_from_rectified * rectified_from_left;
        let direction = -right_from_rectified.column(0);
        let direction_left = right_from_left.try_inverse()? * direction;
        Some(Self {
            origin: [to_level(origin.x), to_level(origin.y)],
            direction: [direction.x, direction.y],
            direction_left: [direction_left.x as f32, direction_left.y as f32],
            affine: [
                right_from_left.m11 as f32,
                right_from_left.m12 as f32,
                right_from_left.m21 as f32,
                right_from_left.m22 as f32,
            ],
        })
    }

    fn at(&self, shift: f64) -> [f64; 2] {
        [self.origin[0] + shift * self.direction[0], self.origin[1] + shift * self.direction[1]]
    }
}

/// Samples the warped patch bilinearly, positions in 1/65536 pixel; `None` where it leaves the image.
fn sample(image: &GrayImage, centre: [f64; 2], affine: &[f32; 4], out: &mut [f32; AREA]) -> Option<()> {
    let fixed = |v: f64| (v * 65536.0) as i32;
    let [a, b, c, d] = affine.map(|v| fixed(v as f64));
    let reach_x = RADIUS * (a.abs() + b.abs());
    let reach_y = RADIUS * (c.abs() + d.abs());
    let (w, h) = (image.width() as i32, image.height() as i32);
    // Positions must fit 16.16 with room: levels are at most 16,000 pixels wide, warps at most fourfold.
    if !(0.0..16_000.0).contains(&centre[0]) || !(0.0..16_000.0).contains(&centre[1]) {
        return None;
    }
    let (x, y) = (fixed(centre[0]), fixed(centre[1]));
    if x < reach_x
        || y < reach_y
        || (x + reach_x) >> 16 >= w - 1
        || (y + reach_y) >> 16 >= h - 1
        || reach_x > 20 << 16
        || reach_y > 20 << 16
    {
        return None;
    }
    let data = image.data();
    let stride = w as usize;
    for j in 0..SIDE {
        let dj = j as i32 - RADIUS;
        let mut px = x - RADIUS * a + dj * b;
        let mut py = y - RADIUS * c + dj * d;
        for v in &mut out[j * SIDE..(j + 1) * SIDE] {
            let at = (py >> 16) as usize * stride + (px >> 16) as usize;
            let (fx, fy) = ((px >> 8) & 0xff, (py >> 8) & 0xff);
            let upper = &data[at..at + 2];
            let lower = &data[at + stride..at + stride + 2];
            let top = (upper[0] as i32) * (256 - fx) + upper[1] as i32 * fx;
            let bottom = (lower[0] as i32) * (256 - fx) + lower[1] as i32 * fx;
            *v = (top * (256 - fy) + bottom * fy) as f32 * (1.0 / 65536.0);
            px += a;
            py += c;
        }
    }
    Some(())
}

/// Inner product in eight fixed lanes, so that it vectorises and always rounds alike.
fn dot(a: &[f32; AREA], b: &[f32; AREA]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (x, y) in a8.iter().zip(b8) {
        for k in 0..8 {
            lanes[k] += x[k] * y[k];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    lanes.iter().sum::<f32>() + rest
}
