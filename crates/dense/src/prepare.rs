//! From a sensor's depth image to a [`DepthFrame`]: unit, range, lens, edges, noise.

use crate::backend::dispatch;
use crate::frame::DepthFrame;
use crate::pixel::WEIGHT_BITS;
use crate::pyramid::DepthPyramid;
use crate::{Backend, DenseError, DepthNoise};
use cairn_geometry::Vec2;
use cairn_sensor::{Camera, DepthImage, Distortion, Image};

/// How depth images are interpreted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthConfig {
    /// Nearer depths are dropped, in metres.
    pub nearest_m: f64,
    /// Farther depths are dropped, in metres.
    pub farthest_m: f64,
    /// A pixel is an edge, and dropped, when a neighbour's depth differs by more than this fraction of its own
    /// depth...
    pub edge_share: f64,
    /// ...and by more than this many metres.
    pub edge_m: f64,
    /// Depth noise model; pixels are weighted by the inverse variance.
    pub noise: DepthNoise,
}

impl Default for DepthConfig {
    fn default() -> Self {
        Self { nearest_m: 0.3, farthest_m: 5.0, edge_share: 0.05, edge_m: 0.04, noise: DepthNoise::default() }
    }
}

/// With a smaller share of valid pixels than one in this many, the frame is refused.
const LEAST_VALID: usize = 500;

/// Prepares depth frames; holds the tables of one camera.
#[derive(Clone, Debug)]
pub struct DepthPreparer {
    config: DepthConfig,
    source: Camera,
    metres_per_unit: f64,
    /// For each pixel of the pinhole the pixel of the image, or `u32::MAX`; empty when the two cameras are the same.
    remap: Vec<u32>,
    /// Depths in metres, 0 for none, with a border of one pixel.
    metres: Vec<f32>,
    frame: DepthFrame,
    backend: Backend,
}

impl DepthPreparer {
    /// A preparer for the images of one camera, in units of `metres_per_unit`. For a lens that distorts, frames are
    /// those of the pinhole with the same focal lengths and centre.
    ///
    /// # Errors
    /// An invalid camera or config.
    pub fn new(config: DepthConfig, camera: Camera, metres_per_unit: f64) -> Result<Self, DenseError> {
        camera.validate().map_err(|e| DenseError::Camera(e.to_string()))?;
        if !(metres_per_unit.is_finite() && metres_per_unit > 0.0) {
            return Err(DenseError::Camera(format!("{metres_per_unit} metres per unit")));
        }
        let DepthConfig { nearest_m, farthest_m, edge_share, edge_m, noise } = config;
        if !(nearest_m >= 0.05 && farthest_m > nearest_m && farthest_m <= 100.0) {
            let why = format!("depths from {nearest_m} to {farthest_m} m; 0.05 to 100 are possible");
            return Err(DenseError::Config(why));
        }
        if !(edge_share > 0.0 && edge_m > 0.0 && noise.floor_m > 0.0 && noise.growth >= 0.0) {
            return Err(DenseError::Config(format!("edge {edge_share}, {edge_m} m, noise {noise:?}")));
        }
        let pinhole = Camera { distortion: Distortion::None, ..camera };
        let remap = if camera.distortion == Distortion::None { Vec::new() } else { remap(&camera, &pinhole) };
        let metres = vec![0.0; (camera.width + 2) * (camera.height + 2)];
        let pixels = vec![0; camera.width * camera.height];
        let frame = DepthFrame { camera: pinhole, pixels, pyramid: DepthPyramid::default(), valid: 0 };
        Ok(Self { config, source: camera, metres_per_unit, remap, metres, frame, backend: Backend::best() })
    }

    /// The same with these instructions, when the processor has them.
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.backend = if backend.available() { backend } else { Backend::Scalar };
        self
    }

    /// The pinhole of the frames.
    pub fn camera(&self) -> &Camera {
        &self.frame.camera
    }

    /// The sensor's camera, with its lens, and the metres of a unit of its images.
    pub fn source(&self) -> (Camera, f64) {
        (self.source, self.metres_per_unit)
    }

    /// A frame from an image in the sensor's units; 0 and 65535 mean no depth. The next call overwrites it: clone it
    /// to keep it.
    ///
    /// # Errors
    /// An image of another size; too few pixels with a depth in range.
    pub fn prepare(&mut self, image: &DepthImage) -> Result<&DepthFrame, DenseError> {
        self.check(image)?;
        let (config, scale) = (self.config, self.metres_per_unit as f32);
        let (data, width, remap, metres) =
            (image.data(), image.width(), &self.remap[..], &mut self.metres[..]);
        dispatch!(self.backend, units_to_metres(config: DepthConfig, scale: f32, data: &[u16], width: usize, remap: &[u32], metres: &mut [f32]) -> ());
        self.fill(image, |v| f32::from(v) * scale)
    }

    /// The frame that was prepared last; without any depth before the first.
    pub fn frame(&self) -> &DepthFrame {
        &self.frame
    }

    /// A frame from an image in metres; 0, negative numbers, NaN and infinity mean no depth.
    ///
    /// # Errors
    /// An image of another size; too few pixels with a depth in range.
    pub fn prepare_metres(&mut self, image: &Image<f32>) -> Result<&DepthFrame, DenseError> {
        self.check(image)?;
        to_metres(&self.config, image.data(), image.width(), &self.remap, &mut self.metres, |v: f32| v);
        self.fill(image, |v| if v.is_finite() { v } else { 0.0 })
    }

    fn fill<T: Copy + Default>(
        &mut self,
        image: &Image<T>,
        metres: impl Fn(T) -> f32,
    ) -> Result<&DepthFrame, DenseError> {
        let (width, pixels) = (self.source.width, self.source.width * self.source.height);
        let (config, from, to) = (&self.config, &self.metres[..], &mut self.frame.pixels[..]);
        let valid = dispatch!(self.backend, pack(config: &DepthConfig, from: &[f32], width: usize, to: &mut [u32]) -> usize);
        if valid < (pixels / LEAST_VALID).max(1) {
            return Err(self.no_depth(valid, image.data().iter().map(|&v| metres(v))));
        }
        self.frame.valid = valid;
        self.frame.pyramid.build(&self.frame.pixels, width, self.source.height, self.backend);
        Ok(&self.frame)
    }

    /// Refuses an image of another size.
    fn check<T: Copy + Default>(&self, image: &Image<T>) -> Result<(), DenseError> {
        let (expected_width, expected_height) = (self.source.width, self.source.height);
        let (width, height) = (image.width(), image.height());
        if (width, height) == (expected_width, expected_height) {
            return Ok(());
        }
        Err(DenseError::Size { what: "depth", width, height, expected_width, expected_height })
    }

    fn no_depth(&self, valid: usize, all: impl Iterator<Item = f32>) -> DenseError {
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for z in all.filter(|&z| z > 0.0) {
            (nearest, farthest) = (nearest.min(z), farthest.max(z));
        }
        let hint = if farthest == 0.0 {
            "is the sensor covered?"
        } else if f64::from(farthest) < self.config.nearest_m {
            "all is too near: is the unit right (metres per unit a thousand times too small)?"
        } else if f64::from(nearest) > self.config.farthest_m {
            "all is too far: is the unit right (metres per unit a thousand times too great)?"
        } else {
            "hardly anything is in range"
        };
        let nearest_m = if nearest.is_finite() { f64::from(nearest) } else { 0.0 };
        DenseError::NoDepth {
            valid,
            pixels: self.source.width * self.source.height,
            nearest_m,
            farthest_m: f64::from(farthest),
            hint,
        }
    }
}

/// For each pixel of the pinhole the nearest pixel of the camera with the lens.
fn remap(source: &Camera, pinhole: &Camera) -> Vec<u32> {
    let mut table = Vec::with_capacity(source.width * source.height);
    for y in 0..pinhole.height {
        for x in 0..pinhole.width {
            let ray = pinhole.unproject(&Vec2::new(x as f64, y as f64));
            let px = ray.and_then(|r| source.project(&r)).map(|p| p.map(f64::round));
            let px = px.filter(|p| source.contains(p));
            table.push(px.map_or(u32::MAX, |p| (p.y as usize * source.width + p.x as usize) as u32));
        }
    }
    table
}

#[inline(always)]
fn units_to_metres(
    config: DepthConfig,
    scale: f32,
    data: &[u16],
    width: usize,
    remap: &[u32],
    metres: &mut [f32],
) {
    // 65535 means no depth, however short the unit.
    to_metres(
        &config,
        data,
        width,
        remap,
        metres,
        |v| if v == u16::MAX { 0.0 } else { f32::from(v) * scale },
    );
}

/// Depths in range into an image with a border of one pixel, 0 for none.
#[inline(always)]
fn to_metres<T: Copy>(
    config: &DepthConfig,
    data: &[T],
    width: usize,
    remap: &[u32],
    out: &mut [f32],
    metres: impl Fn(T) -> f32,
) {
    let [near, far] = [config.nearest_m as f32, config.farthest_m as f32];
    // False for NaN.
    let in_range = |z: f32| if (z >= near) & (z <= far) { z } else { 0.0 };
    for y in 0..data.len() / width {
        let out = &mut out[(y + 1) * (width + 2) + 1..][..width];
        if remap.is_empty() {
            data[y * width..(y + 1) * width].iter().zip(out).for_each(|(&v, o)| *o = in_range(metres(v)));
        } else {
            let from = &remap[y * width..(y + 1) * width];
            for (&i, o) in from.iter().zip(out) {
                *o = data.get(i as usize).map_or(0.0, |&v| in_range(metres(v)));
            }
        }
    }
}

#[inline(always)]
fn pack(config: &DepthConfig, metres: &[f32], width: usize, pixels: &mut [u32]) -> usize {
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let noise = &config.noise;
    let [floor, growth, from] = [noise.floor_m as f32, noise.growth as f32, noise.nearest_m as f32];
    let stride = width + 2;
    let mut valid = 0;
    for (y, out) in pixels.chunks_exact_mut(width).enumerate() {
        let row = |y: usize| &metres[y * stride..(y + 1) * stride];
        let (up, here, down) = (&row(y)[1..], row(y + 1), &row(y + 2)[1..]);
        let (left, right, here) = (&here[..width], &here[2..][..width], &here[1..][..width]);
        let (up, down, out) = (&up[..width], &down[..width], &mut out[..width]);
        let mut count = 0;
        for x in 0..width {
            let z = here[x];
            let limit = (share * z).max(least);
            // A neighbour without depth does not make an edge.
            let far = |n: f32| (n > 0.0) & ((n - z).abs() > limit);
            let edge = far(left[x]) | far(right[x]) | far(up[x]) | far(down[x]);
            let past = z - from;
            let ratio = floor / (floor + growth * (past * past));
            // Weights go down to 1/31 of the greatest; adding 2^23 rounds and leaves the integer in the lowest bits.
            let weight = (31.0 * (ratio * ratio)).max(1.0) + 8_388_608.0;
            let keep = (z > 0.0) & !edge;
            let pixel = (z.to_bits() & !WEIGHT_BITS) | (weight.to_bits() & WEIGHT_BITS);
            out[x] = if keep { pixel } else { 0 };
            count += u32::from(keep);
        }
        valid += count as usize;
    }
    valid
}
