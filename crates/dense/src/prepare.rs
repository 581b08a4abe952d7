//! From a sensor's depth image to a [`DepthFrame`]: unit, range, lens, edges, noise.

use crate::backend::dispatch;
use crate::frame::DepthFrame;
use crate::pixel::{WEIGHT_BITS, depth_of};
use crate::pyramid::{DepthPyramid, greater};
use crate::submap::{PackedDepth, PackedGray, Rows, broken};
use crate::{Backend, DenseError, DepthNoise};
use cairn_geometry::Vec2;
use cairn_sensor::{Camera, DepthImage, Distortion, GrayImage, Image};

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
    /// Three rows of pixels, see [`pack`].
    rows: Vec<u32>,
    /// The pixel of each number of the packed image that was prepared last, see [`Rows`].
    by_number: Option<Box<[u32; 1 << 16]>>,
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
        let rows = vec![0; 3 * (camera.width + 2)];
        let pixels = vec![0; camera.width * camera.height];
        let frame = DepthFrame { camera: pinhole, pixels, pyramid: DepthPyramid::default(), valid: 0 };
        Ok(Self {
            config,
            source: camera,
            metres_per_unit,
            remap,
            rows,
            by_number: None,
            frame,
            backend: Backend::best(),
        })
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
        self.check("depth", [image.width(), image.height()])?;
        self.prepare_units(image.data())
    }

    /// [`Self::prepare`] of a packed image: faster than to unpack it before, since no image is made of it.
    ///
    /// # Errors
    /// As [`Self::prepare`]; bytes that do not decode to an image.
    pub fn prepare_packed(&mut self, image: &PackedDepth) -> Result<&DepthFrame, DenseError> {
        self.check("depth", image.size())?;
        let rows = if self.remap.is_empty() { image.rows()? } else { None };
        let Some(mut packed) = rows else { return self.prepare_units(image.unpack()?.data()) };
        let words = Words::new(&self.config);
        let scale = self.metres_per_unit as f32;
        let mut by_number = self.by_number.take().unwrap_or_else(|| Box::new([0; 1 << 16]));
        by_number.iter_mut().zip(packed.values()).for_each(|(pixel, v)| *pixel = words.of(v.metres(scale)));
        let (config, table, packed) = (&self.config, &*by_number, &mut packed);
        let (rows, pixels) = (&mut self.rows[..], &mut self.frame.pixels[..]);
        let backend = self.backend;
        let valid = dispatch!(backend, from_packed(config: &DepthConfig, packed: &mut Rows, table: &[u32; 1 << 16], rows: &mut [u32], pixels: &mut [u32], backend: Backend) -> Option<usize>);
        self.by_number = Some(by_number);
        let least = self.least_valid();
        match valid {
            Some(valid) if valid >= least => Ok(self.finish(valid)),
            Some(_) => self.prepare_units(image.unpack()?.data()),
            None => {
                // Half of it is here: of no image that there is.
                self.frame.pixels.fill(0);
                self.finish(0);
                Err(broken())
            }
        }
    }

    fn prepare_units(&mut self, data: &[u16]) -> Result<&DepthFrame, DenseError> {
        let (config, scale) = (&self.config, self.metres_per_unit as f32);
        let (remap, rows, pixels) = (&self.remap[..], &mut self.rows[..], &mut self.frame.pixels[..]);
        let valid = dispatch!(self.backend, from_units(config: &DepthConfig, scale: f32, data: &[u16], remap: &[u32], rows: &mut [u32], pixels: &mut [u32]) -> usize);
        self.finish_or_refuse(valid, data, |v| f32::from(v) * scale)
    }

    /// The colours of a frame's pixels, from a gray image that shows the same pixels as the sensor's depth.
    ///
    /// # Errors
    /// An image of another size.
    pub fn colours(&self, gray: &GrayImage) -> Result<Image<[u8; 3]>, DenseError> {
        self.remapped(gray, |v| [v; 3])
    }

    /// The shades of a frame's pixels, from such an image.
    ///
    /// # Errors
    /// An image of another size.
    pub fn shades(&self, gray: &GrayImage) -> Result<GrayImage, DenseError> {
        self.remapped(gray, |v| v)
    }

    fn remapped<T: Copy + Default>(
        &self,
        gray: &GrayImage,
        of: impl Fn(u8) -> T,
    ) -> Result<Image<T>, DenseError> {
        self.check("colour", [gray.width(), gray.height()])?;
        let data = gray.data();
        let pixels = match self.remap.is_empty() {
            true => data.iter().map(|&v| of(v)).collect(),
            // Where the pinhole sees nothing there is no depth either.
            false => self.remap.iter().map(|&i| of(data.get(i as usize).copied().unwrap_or(0))).collect(),
        };
        Ok(Image::from_vec(gray.width(), gray.height(), pixels).unwrap_or_else(|| Image::new(0, 0)))
    }

    /// [`Self::colours`] of a packed image, where there is one.
    pub(crate) fn colours_packed(
        &self,
        gray: Option<&PackedGray>,
    ) -> Result<Option<Image<[u8; 3]>>, DenseError> {
        gray.map(|gray| self.colours(&gray.unpack()?)).transpose()
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
        self.check("depth", [image.width(), image.height()])?;
        let (config, data) = (&self.config, image.data());
        let (remap, rows, pixels) = (&self.remap[..], &mut self.rows[..], &mut self.frame.pixels[..]);
        let valid = dispatch!(self.backend, from_metres(config: &DepthConfig, data: &[f32], remap: &[u32], rows: &mut [u32], pixels: &mut [u32]) -> usize);
        self.finish_or_refuse(valid, data, |v| if v.is_finite() { v } else { 0.0 })
    }

    /// The frame of what was packed; refused with fewer than enough valid pixels.
    fn finish_or_refuse<T: Copy>(
        &mut self,
        valid: usize,
        data: &[T],
        metres: impl Fn(T) -> f32,
    ) -> Result<&DepthFrame, DenseError> {
        if valid < self.least_valid() {
            return Err(self.no_depth(valid, data.iter().map(|&v| metres(v))));
        }
        Ok(self.finish(valid))
    }

    /// With fewer valid pixels a frame is refused.
    fn least_valid(&self) -> usize {
        (self.source.width * self.source.height / LEAST_VALID).max(1)
    }

    fn finish(&mut self, valid: usize) -> &DepthFrame {
        let Camera { width, height, .. } = self.source;
        self.frame.valid = valid;
        self.frame.pyramid.build(&self.frame.pixels, width, height, self.backend);
        &self.frame
    }

    /// Refuses an image of another size.
    fn check(&self, what: &'static str, [width, height]: [usize; 2]) -> Result<(), DenseError> {
        let (expected_width, expected_height) = (self.source.width, self.source.height);
        if (width, height) == (expected_width, expected_height) {
            return Ok(());
        }
        Err(DenseError::Size { what, width, height, expected_width, expected_height })
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

/// What a pixel of an image says.
trait Measured: Copy {
    /// Metres, with `scale` metres a unit; 0 for none.
    fn metres(self, scale: f32) -> f32;
}

impl Measured for u16 {
    #[inline(always)]
    fn metres(self, scale: f32) -> f32 {
        // 65535 means no depth, however short the unit.
        if self == u16::MAX { 0.0 } else { f32::from(self) * scale }
    }
}

impl Measured for f32 {
    #[inline(always)]
    fn metres(self, _: f32) -> f32 {
        self
    }
}

/// From metres to pixels with a weight.
#[derive(Clone, Copy)]
struct Words {
    range: [f32; 2],
    floor: f32,
    growth: f32,
    from: f32,
}

impl Words {
    #[inline(always)]
    fn new(config: &DepthConfig) -> Self {
        let noise = &config.noise;
        Self {
            range: [config.nearest_m as f32, config.farthest_m as f32],
            floor: noise.floor_m as f32,
            growth: noise.growth as f32,
            from: noise.nearest_m as f32,
        }
    }

    /// The pixel of a depth, with its weight; [`NONE`] for one out of range.
    #[inline(always)]
    fn of(&self, z: f32) -> u32 {
        let past = z - self.from;
        let ratio = self.floor / (self.floor + self.growth * (past * past));
        // Weights go down to 1/31 of the greatest; adding 2^23 rounds and leaves the integer in the lowest bits.
        let weight = (31.0 * (ratio * ratio)).max(1.0) + 8_388_608.0;
        let pixel = (z.to_bits() & !WEIGHT_BITS) | (weight.to_bits() & WEIGHT_BITS);
        // False for NaN.
        if (z >= self.range[0]) & (z <= self.range[1]) { pixel } else { NONE }
    }
}

/// A pixel without depth while edges are looked for: greater than any other as a number without a sign, less than any with one.
const NONE: u32 = 1 << 31;

/// Gives the pixels of an image row by row.
trait RowSource {
    /// The next row, which is the `y`-th; `None` where there is none.
    fn next_row(&mut self, y: usize, out: &mut [u32]) -> Option<()>;
}

struct ImageRows<'a, T> {
    words: Words,
    scale: f32,
    data: &'a [T],
    remap: &'a [u32],
}

impl<T: Measured> RowSource for ImageRows<'_, T> {
    #[inline(always)]
    fn next_row(&mut self, y: usize, out: &mut [u32]) -> Option<()> {
        let Self { words, scale, data, remap } = *self;
        let width = out.len();
        if remap.is_empty() {
            for (o, v) in out.iter_mut().zip(&data[y * width..]) {
                *o = words.of(v.metres(scale));
            }
        } else {
            for (o, &i) in out.iter_mut().zip(&remap[y * width..]) {
                *o = data.get(i as usize).map_or(NONE, |v| words.of(v.metres(scale)));
            }
        }
        Some(())
    }
}

struct PackedRows<'a, 'b> {
    packed: &'a mut Rows<'b>,
    table: &'a [u32; 1 << 16],
    backend: Backend,
}

impl RowSource for PackedRows<'_, '_> {
    #[inline(always)]
    fn next_row(&mut self, _: usize, out: &mut [u32]) -> Option<()> {
        self.packed.next(self.backend)?;
        self.packed.pixels(self.backend, out, self.table, NONE);
        Some(())
    }
}

#[inline(always)]
fn from_units(
    config: &DepthConfig,
    scale: f32,
    data: &[u16],
    remap: &[u32],
    rows: &mut [u32],
    pixels: &mut [u32],
) -> usize {
    let source = ImageRows { words: Words::new(config), scale, data, remap };
    pack(config, rows, pixels, source).unwrap_or(0)
}

#[inline(always)]
fn from_metres(
    config: &DepthConfig,
    data: &[f32],
    remap: &[u32],
    rows: &mut [u32],
    pixels: &mut [u32],
) -> usize {
    let source = ImageRows { words: Words::new(config), scale: 1.0, data, remap };
    pack(config, rows, pixels, source).unwrap_or(0)
}

#[inline(always)]
fn from_packed(
    config: &DepthConfig,
    packed: &mut Rows,
    table: &[u32; 1 << 16],
    rows: &mut [u32],
    pixels: &mut [u32],
    backend: Backend,
) -> Option<usize> {
    let valid = pack(config, rows, pixels, PackedRows { packed: &mut *packed, table, backend })?;
    packed.end().map(|()| valid)
}

/// Drops the edges of an image, which comes row by row, and counts the valid pixels; `None` where a row does not come. `rows` holds
/// three rows with a pixel of border at both ends: the row above the one that is looked at, that row, and the one below.
#[inline(always)]
fn pack(
    config: &DepthConfig,
    rows: &mut [u32],
    pixels: &mut [u32],
    mut source: impl RowSource,
) -> Option<usize> {
    let stride = rows.len() / 3;
    let width = stride - 2;
    let height = pixels.len() / width;
    rows.fill(NONE);
    let mut valid = 0;
    for y in 0..=height {
        let below = &mut rows[y % 3 * stride..][..stride][1..=width];
        if y < height {
            source.next_row(y, below)?;
        } else {
            below.fill(NONE);
        }
        if y > 0 {
            let [up, here, down] = [1, 2, 0].map(|i| (y + i) % 3 * stride);
            let rows = [&rows[up..][..stride], &rows[here..][..stride], &rows[down..][..stride]];
            valid += pack_row(config, rows, &mut pixels[(y - 1) * width..][..width]);
        }
    }
    Some(valid)
}

#[inline(always)]
fn pack_row(config: &DepthConfig, [up, here, down]: [&[u32]; 3], out: &mut [u32]) -> usize {
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let width = out.len();
    let (left, right, here) = (&here[..width], &here[2..][..width], &here[1..][..width]);
    let (up, down) = (&up[1..][..width], &down[1..][..width]);
    let mut count = 0;
    for x in 0..width {
        let z = depth_of(here[x]);
        // A neighbour without depth is neither of them, and makes no edge. Weights follow depths: of equal depths they are equal.
        let around = [left[x], right[x], up[x], down[x]];
        let nearest = around.iter().fold(here[x], |nearest, &n| nearest.min(n));
        let farthest = around.iter().fold(here[x] as i32, |farthest, &n| farthest.max(n as i32));
        let jump = greater(z - depth_of(nearest), depth_of(farthest as u32) - z);
        let keep = (here[x] != NONE) & (jump <= greater(share * z, least));
        out[x] = if keep { here[x] } else { 0 };
        count += u32::from(keep);
    }
    count as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_images_are_prepared_as_plain_ones() {
        let camera = Camera::pinhole(37, 21, 40.0, 40.0, 18.0, 10.0);
        let new = || DepthPreparer::new(DepthConfig::default(), camera, 0.001).expect("a camera");
        let (mut preparer, mut scalar) = (new(), new().with_backend(Backend::Scalar));
        for step in [1, 5, 90] {
            let pixel = |i: usize| if i % 11 == 3 { 0 } else { 900 + (i * 7919 % 60 * step) as u16 };
            let image = DepthImage::from_vec(37, 21, (0..37 * 21).map(pixel).collect()).expect("all pixels");
            let plain = scalar.prepare(&image).expect("depth");
            for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
                let mut preparer = new().with_backend(backend);
                let packed = preparer.prepare_packed(&PackedDepth::pack(&image)).expect("depth");
                assert!(packed.pixels == plain.pixels && packed.valid() == plain.valid(), "{backend:?}");
            }
        }
        let broken = PackedDepth::from_bytes(37, 21, vec![0; 9].into());
        assert!(matches!(preparer.prepare_packed(&broken), Err(DenseError::Saved(_))));
        let small = PackedDepth::pack(&DepthImage::new(8, 8));
        assert!(matches!(preparer.prepare_packed(&small), Err(DenseError::Size { .. })));
    }
}
