//! The output of the front end for one packet: features with depth, in the pixels of one ideal camera.
//!
//! Whatever the lens and the mounting of the stereo pair, everything after the front end works in the pixels of one
//! [`RectifiedCamera`]: an ideal pinhole (for stereo, the rectified left camera), whose right counterpart is `baseline`
//! metres along +x. Raw pixels are kept for drawing only.

use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;

/// A 256-bit binary descriptor.
pub type Descriptor = [u8; 32];

/// The ideal pinhole camera that frames are expressed in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectifiedCamera {
    /// Focal length in pixels along x.
    pub fx: f64,
    /// Focal length in pixels along y.
    pub fy: f64,
    /// Principal point x in pixels.
    pub cx: f64,
    /// Principal point y in pixels.
    pub cy: f64,
    /// Baseline times `fx` in pixel metres: `disparity = baseline_fx / depth`. For RGB-D the baseline is that of a
    /// virtual projector; for mono it is zero.
    pub baseline_fx: f64,
    /// Bounds of rectified pixels: `[min_x, min_y, max_x, max_y]`.
    pub bounds: [f64; 4],
    /// Depth in metres up to which a single view gives an accurate point ("close" points).
    pub close_depth: f64,
    /// Pose of the rectified camera in the rig's body frame.
    pub body_from_camera: Se3,
}

impl RectifiedCamera {
    /// True for stereo and RGB-D: depth is measured, so that the map is metric from the first frame.
    pub fn has_depth(&self) -> bool {
        self.baseline_fx > 0.0
    }

    /// Pose of the body for a pose of the camera. In a map without metric scale the lever arm between the two is
    /// unknown in map units: there the body is placed at the camera, with the body's own orientation.
    pub fn world_from_body(&self, world_from_camera: &Se3, metric: bool) -> Se3 {
        let mut camera_from_body = self.body_from_camera.inverse();
        if !metric {
            camera_from_body.translation = Vec3::zeros();
        }
        *world_from_camera * camera_from_body
    }

    /// Rectified pixel `[x, y, right_x]` of a point in the camera frame; `None` behind the camera.
    #[inline]
    pub fn project(&self, p: &Vec3) -> Option<[f64; 3]> {
        if p.z <= 1e-6 {
            return None;
        }
        let inv = 1.0 / p.z;
        let u = self.fx * p.x * inv + self.cx;
        Some([u, self.fy * p.y * inv + self.cy, u - self.baseline_fx * inv])
    }

    /// The point in the camera frame of a rectified pixel at a depth in metres.
    #[inline]
    pub fn unproject(&self, px: [f32; 2], depth: f64) -> Vec3 {
        Vec3::new(
            (px[0] as f64 - self.cx) / self.fx * depth,
            (px[1] as f64 - self.cy) / self.fy * depth,
            depth,
        )
    }

    /// True when a rectified pixel lies inside the bounds.
    pub fn contains(&self, u: f64, v: f64) -> bool {
        let [x0, y0, x1, y1] = self.bounds;
        u >= x0 && u < x1 && v >= y0 && v < y1
    }
}

/// Parameters of the scale pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Octaves {
    /// Number of levels.
    pub levels: usize,
    /// Ratio between neighbouring levels (1.2).
    pub factor: f64,
}

impl Octaves {
    /// Size of one pixel of `level` in pixels of the full image.
    #[inline]
    pub fn scale(&self, level: u8) -> f64 {
        self.factor.powi(level as i32)
    }

    /// The level at which a point last seen between `min_distance` and `max_distance` appears at `distance`.
    #[inline]
    pub fn predict(&self, max_distance: f64, distance: f64) -> u8 {
        let level = (max_distance / distance).ln() / self.factor.ln();
        level.ceil().clamp(0.0, (self.levels - 1) as f64) as u8
    }
}

/// Features of one frame as a struct of arrays: every vector has the same length; immutable once extracted.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Time of exposure.
    pub stamp: Stamp,
    /// Pixels in the raw (distorted) image.
    pub raw: Vec<[f32; 2]>,
    /// Rectified pixels of the [`RectifiedCamera`].
    pub px: Vec<[f32; 2]>,
    /// Pyramid level.
    pub octave: Vec<u8>,
    /// Orientation in radians, -pi to pi, in the image.
    pub angle: Vec<f32>,
    /// Descriptors.
    pub descriptors: Vec<Descriptor>,
    /// Rectified x in the right image (virtual for RGB-D); NaN without a match.
    pub right_x: Vec<f32>,
    /// Depth along the camera's z axis in metres; NaN without a measurement or (stereo) where the point is too far
    /// away.
    pub depth: Vec<f32>,
    /// How the pixels were corrected for a rolling shutter; `None` for a global one, and where that was not kept.
    pub rolling: Option<Rolling>,
    grid: Grid,
}

/// How the pixels of a frame were corrected for a rolling shutter.
#[derive(Clone, Debug, PartialEq)]
pub struct Rolling {
    /// The readout time that they were corrected with, seconds.
    pub readout_s: f64,
    /// By how many pixels each feature moves for each second of readout.
    pub slopes: Vec<[f32; 2]>,
}

/// Columns and rows of the lookup grid over the bounds of the rectified image.
const GRID: [usize; 2] = [64, 48];

/// Features that are collected before they are visited.
const COLLECTED: usize = 256;

#[derive(Clone, Debug, Default)]
struct Grid {
    bounds: [f32; 4],
    /// Start of each cell in `items`; one more entry than cells.
    starts: Vec<u16>,
    items: Vec<u16>,
}

impl Frame {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.px.len()
    }

    /// True when the frame has no features.
    pub fn is_empty(&self) -> bool {
        self.px.is_empty()
    }

    /// The pixel of feature `i` had it been corrected with another readout time, and that in the right image.
    pub fn pixel_with(&self, i: usize, readout_s: f64) -> [f64; 3] {
        let [u, v] = self.px[i].map(f64::from);
        let right = f64::from(self.right_x[i]);
        let Some(rolling) = &self.rolling else { return [u, v, right] };
        let [du, dv] = rolling.slopes[i].map(|s| f64::from(s) * (readout_s - rolling.readout_s));
        [u + du, v + dv, right + du]
    }

    /// True when feature `i` has a measured depth.
    pub fn has_depth(&self, i: usize) -> bool {
        self.depth[i] > 0.0
    }

    /// Builds the lookup grid; call once, after all features (at most 65,535) are set.
    pub fn index(&mut self, camera: &RectifiedCamera) {
        self.index_in(camera.bounds.map(|b| b as f32));
    }

    /// The bounds of the lookup grid: `[min_x, min_y, max_x, max_y]`, all zero before there is one.
    pub fn bounds(&self) -> [f32; 4] {
        self.grid.bounds
    }

    /// As [`Frame::index`], within [`Frame::bounds`] of an earlier grid of the same features.
    pub fn index_in(&mut self, bounds: [f32; 4]) {
        let cells = GRID[0] * GRID[1];
        let mut starts = vec![0u16; cells + 1];
        let cell_of: Vec<usize> = self.px.iter().map(|p| cell(&bounds, p[0], p[1])).collect();
        for &c in &cell_of {
            starts[c + 1] += 1;
        }
        for c in 0..cells {
            starts[c + 1] += starts[c];
        }
        let mut next = starts.clone();
        let mut items = vec![0u16; self.px.len()];
        for (i, &c) in cell_of.iter().enumerate() {
            items[next[c] as usize] = i as u16;
            next[c] += 1;
        }
        self.grid = Grid { bounds, starts, items };
    }

    /// Calls `visit` with each feature in a square window of half side `radius` around a rectified pixel, in a fixed
    /// order.
    pub fn near(&self, u: f32, v: f32, radius: f32, mut visit: impl FnMut(usize)) {
        self.near_in(u, v, radius, [0, u8::MAX], &mut visit);
    }

    /// As [`Frame::near`], only the features of these pyramid levels, first and last.
    pub(crate) fn near_in(
        &self,
        u: f32,
        v: f32,
        radius: f32,
        octaves: [u8; 2],
        mut visit: impl FnMut(usize),
    ) {
        if self.grid.starts.is_empty() {
            return;
        }
        // Which features of a cell are inside follows no pattern that a processor could foresee: they are collected without
        // branches first.
        let (mut inside, mut count) = ([0u16; COLLECTED], 0);
        let (x0, y0) = coordinates(&self.grid.bounds, u - radius, v - radius);
        let (x1, y1) = coordinates(&self.grid.bounds, u + radius, v + radius);
        for y in y0..=y1 {
            let row = y * GRID[0];
            let (from, to) = (self.grid.starts[row + x0] as usize, self.grid.starts[row + x1 + 1] as usize);
            for items in self.grid.items[from..to].chunks(COLLECTED) {
                if count + items.len() > COLLECTED {
                    inside[..count].iter().for_each(|i| visit(*i as usize));
                    count = 0;
                }
                for &i in items {
                    let (p, octave) = (self.px[i as usize], self.octave[i as usize]);
                    let is_near = ((p[0] - u).abs() < radius) & ((p[1] - v).abs() < radius);
                    inside[count] = i;
                    count += usize::from(is_near & (octave >= octaves[0]) & (octave <= octaves[1]));
                }
            }
        }
        inside[..count].iter().for_each(|i| visit(*i as usize));
    }
}

#[inline]
fn coordinates(b: &[f32; 4], x: f32, y: f32) -> (usize, usize) {
    let gx = (x - b[0]) / (b[2] - b[0]) * GRID[0] as f32;
    let gy = (y - b[1]) / (b[3] - b[1]) * GRID[1] as f32;
    ((gx.max(0.0) as usize).min(GRID[0] - 1), (gy.max(0.0) as usize).min(GRID[1] - 1))
}

fn cell(b: &[f32; 4], x: f32, y: f32) -> usize {
    let (gx, gy) = coordinates(b, x, y);
    gy * GRID[0] + gx
}
