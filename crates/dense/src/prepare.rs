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
    /// Depth noise model; pixels are weighted by the inverse variance, and by how their surface stands to the ray.
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
    /// Rows of pixels, see [`pack`].
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
        let rows = vec![0; ROWS * (camera.width + 2 * REACH)];
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
        self.prepare_packed_as(image, true)
    }

    /// [`Self::prepare_packed`] for an occupancy grid, which asks whether there is a depth, not what it weighs: weights do not follow the
    /// slant of the surface, which saves a quarter of the time.
    ///
    /// # Errors
    /// As [`Self::prepare_packed`].
    pub fn prepare_packed_for_occupancy(&mut self, image: &PackedDepth) -> Result<&DepthFrame, DenseError> {
        self.prepare_packed_as(image, false)
    }

    fn prepare_packed_as(&mut self, image: &PackedDepth, slanted: bool) -> Result<&DepthFrame, DenseError> {
        self.check("depth", image.size())?;
        let rows = if self.remap.is_empty() { image.rows()? } else { None };
        let Some(mut packed) = rows else { return self.prepare_units(image.unpack()?.data()) };
        let words = Words::new(&self.config);
        let scale = self.metres_per_unit as f32;
        let mut by_number = self.by_number.take().unwrap_or_else(|| Box::new([0; 1 << 16]));
        by_number.iter_mut().zip(packed.values()).for_each(|(pixel, v)| *pixel = words.of(v.metres(scale)));
        let packing = Packing { config: &self.config, camera: &self.frame.camera, slanted };
        let (table, packed) = (&*by_number, &mut packed);
        let (rows, pixels) = (&mut self.rows[..], &mut self.frame.pixels[..]);
        let backend = self.backend;
        let valid = dispatch!(backend, from_packed(packing: Packing, packed: &mut Rows, table: &[u32; 1 << 16], rows: &mut [u32], pixels: &mut [u32], backend: Backend) -> Option<usize>);
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
        let packing = Packing { config: &self.config, camera: &self.frame.camera, slanted: true };
        let scale = self.metres_per_unit as f32;
        let (remap, rows) = (&self.remap[..], &mut self.rows[..]);
        let pixels = &mut self.frame.pixels[..];
        let valid = dispatch!(self.backend, from_units(packing: Packing, scale: f32, data: &[u16], remap: &[u32], rows: &mut [u32], pixels: &mut [u32]) -> usize);
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
        let packing = Packing { config: &self.config, camera: &self.frame.camera, slanted: true };
        let data = image.data();
        let (remap, rows) = (&self.remap[..], &mut self.rows[..]);
        let pixels = &mut self.frame.pixels[..];
        let valid = dispatch!(self.backend, from_metres(packing: Packing, data: &[f32], remap: &[u32], rows: &mut [u32], pixels: &mut [u32]) -> usize);
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
    /// 31 times the least variance.
    greatest: f32,
}

/// What images of one surface differ by beside their noise, in metres: their poses and the sensor's lens.
const BETWEEN_M: f32 = 0.003;

impl Words {
    #[inline(always)]
    fn new(config: &DepthConfig) -> Self {
        let noise = &config.noise;
        let floor = noise.floor_m as f32;
        Self {
            range: [config.nearest_m as f32, config.farthest_m as f32],
            floor,
            greatest: 31.0 * (BETWEEN_M * BETWEEN_M + floor * floor),
            growth: noise.growth as f32,
            from: noise.nearest_m as f32,
        }
    }

    /// The pixel of a depth, with its weight; [`NONE`] for one out of range.
    #[inline(always)]
    fn of(&self, z: f32) -> u32 {
        let past = z - self.from;
        let sigma = self.floor + self.growth * (past * past);
        // Weights go down to 1/31 of the greatest; adding 2^23 rounds and leaves the integer in the lowest bits.
        let weight = (self.greatest / (BETWEEN_M * BETWEEN_M + sigma * sigma)).max(1.0) + 8_388_608.0;
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
    packing: Packing,
    scale: f32,
    data: &[u16],
    remap: &[u32],
    rows: &mut [u32],
    pixels: &mut [u32],
) -> usize {
    let source = ImageRows { words: Words::new(packing.config), scale, data, remap };
    pack(packing, rows, pixels, source).unwrap_or(0)
}

#[inline(always)]
fn from_metres(packing: Packing, data: &[f32], remap: &[u32], rows: &mut [u32], pixels: &mut [u32]) -> usize {
    let source = ImageRows { words: Words::new(packing.config), scale: 1.0, data, remap };
    pack(packing, rows, pixels, source).unwrap_or(0)
}

#[inline(always)]
fn from_packed(
    packing: Packing,
    packed: &mut Rows,
    table: &[u32; 1 << 16],
    rows: &mut [u32],
    pixels: &mut [u32],
    backend: Backend,
) -> Option<usize> {
    let valid = pack(packing, rows, pixels, PackedRows { packed: &mut *packed, table, backend })?;
    packed.end().map(|()| valid)
}

/// How pixels are packed.
#[derive(Clone, Copy)]
struct Packing<'a> {
    config: &'a DepthConfig,
    camera: &'a Camera,
    /// Whether weights follow the slant of the surface.
    slanted: bool,
}

/// Rows that are looked at together, and share the slant of one of them.
const STRIP: usize = 4;
/// Rows that are kept: those of a strip, the one above it, and the one below.
const ROWS: usize = 8;
/// Pixels on each side that the slope of a surface is found from.
const REACH: usize = 2;

/// Drops the edges of an image, which comes row by row, weights what is left by its slant, and counts it; `None` where a row does not
/// come. `rows` holds [`ROWS`] rows with [`REACH`] pixels of border at both ends.
#[inline(always)]
fn pack(packing: Packing, rows: &mut [u32], pixels: &mut [u32], mut source: impl RowSource) -> Option<usize> {
    let Packing { config, slanted, .. } = packing;
    let stride = rows.len() / ROWS;
    let width = stride - 2 * REACH;
    let height = pixels.len() / width;
    let mut slants = vec![1.0; width];
    rows.fill(NONE);
    let (mut valid, mut read) = (0, 0);
    for strip in (0..height).step_by(STRIP) {
        while read <= strip + STRIP {
            let row = &mut rows[read % ROWS * stride..][..stride][REACH..REACH + width];
            if read < height {
                source.next_row(read, row)?;
            } else {
                row.fill(NONE);
            }
            read += 1;
        }
        let row = |y: usize| &rows[y % ROWS * stride..][..stride];
        // The second of its rows, so that the one above the strip and its last are those that are needed.
        let of = strip + 1;
        if slanted {
            slant_row(packing, of, [of + ROWS - REACH, of, of + REACH].map(row), &mut slants);
        }
        for y in strip..(strip + STRIP).min(height) {
            let around = [y + ROWS - 1, y, y + 1].map(row);
            let out = &mut pixels[y * width..][..width];
            valid += if slanted {
                pack_row::<true>(config, around, &slants, out)
            } else {
                pack_row::<false>(config, around, &slants, out)
            };
        }
    }
    Some(valid)
}

/// A pixel with so much of its weight, at least 1.
#[inline(always)]
fn times(pixel: u32, slant: f32) -> u32 {
    // Adding 2^23 rounds and leaves the integer in the lowest bits.
    let weight = greater((pixel & WEIGHT_BITS) as i32 as f32 * slant, 1.0) + 8_388_608.0;
    (pixel & !WEIGHT_BITS) | (weight.to_bits() & WEIGHT_BITS)
}

/// What the weights of a row's pixels are multiplied by, 1 at most.
///
/// What images differ by across a surface moves its depth by one over the product of its normal with the ray (of length 1 along the
/// optical axis): a depth has so much more variance where its surface is seen at a slant. Curless and Levoy (1996) weight by the cosine.
#[inline(always)]
fn slant_row(packing: Packing, y: usize, [above, here, below]: [&[u32]; 3], out: &mut [f32]) {
    let Packing { config, camera, .. } = packing;
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    let width = out.len();
    let (before, after, here) = (&here[..width], &here[2 * REACH..][..width], &here[REACH..][..width]);
    let (above, below) = (&above[REACH..][..width], &below[REACH..][..width]);
    let v = y as f32 - cy;
    for x in 0..width {
        let z = depth_of(here[x]);
        let edge = REACH as f32 * greater(share * z, least);
        let by_u = slope(z - depth_of(before[x]), depth_of(after[x]) - z, edge);
        let by_v = slope(z - depth_of(above[x]), depth_of(below[x]) - z, edge);
        // The normal is (fx dz/du, fy dz/dv, -z - u dz/du - v dz/dv); times the ray it is -z.
        let normal = [fx * by_u, fy * by_v, z + (x as f32 - cx) * by_u + v * by_v];
        let square = normal.iter().map(|n| n * n).sum::<f32>();
        out[x] = if here[x] != NONE && z * z < square { z * z / square } else { 1.0 };
    }
}

/// Change of depth a pixel, from those to the pixels at [`REACH`] on both sides: the lesser, since an edge lies on one side; none where
/// both sides are edges or have no depth.
#[inline(always)]
fn slope(before: f32, after: f32, edge: f32) -> f32 {
    let lesser = if before.abs() < after.abs() { before } else { after };
    if lesser.abs() <= edge { lesser * (1.0 / REACH as f32) } else { 0.0 }
}

#[inline(always)]
fn pack_row<const SLANTED: bool>(
    config: &DepthConfig,
    [up, here, down]: [&[u32]; 3],
    slants: &[f32],
    out: &mut [u32],
) -> usize {
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let width = out.len();
    let (left, right) = (&here[REACH - 1..][..width], &here[REACH + 1..][..width]);
    let [here, up, down] = [here, up, down].map(|row| &row[REACH..][..width]);
    let slants = &slants[..width];
    let mut count = 0;
    for x in 0..width {
        let z = depth_of(here[x]);
        // A neighbour without depth is neither of them, and makes no edge. Weights follow depths: of equal depths they are equal.
        let around = [left[x], right[x], up[x], down[x]];
        let nearest = around.iter().fold(here[x], |nearest, &n| nearest.min(n));
        let farthest = around.iter().fold(here[x] as i32, |farthest, &n| farthest.max(n as i32));
        let jump = greater(z - depth_of(nearest), depth_of(farthest as u32) - z);
        let keep = (here[x] != NONE) & (jump <= greater(share * z, least));
        let pixel = if SLANTED { times(here[x], slants[x]) } else { here[x] };
        out[x] = if keep { pixel } else { 0 };
        count += u32::from(keep);
    }
    count as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::weight_of;

    /// Pixels of a plane through (0, 0, 2) weigh as much less as the square of the cosine says; beside an edge, too.
    #[test]
    fn what_is_seen_at_a_slant_weighs_less() {
        let camera = Camera::pinhole(64, 48, 60.0, 60.0, 31.5, 23.5);
        let mut preparer = DepthPreparer::new(DepthConfig::default(), camera, 0.001).expect("a camera");
        let noise = DepthConfig::default().noise;
        let mut seen = [0, 0];
        for normal in [[0.0, 0.0, 1.0f64], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [0.6, 0.6, 0.53]] {
            let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
            let ray = |i: usize| [((i % 64) as f64 - 31.5) / 60.0, ((i / 64) as f64 - 23.5) / 60.0, 1.0];
            let along = |i: usize| (0..3).map(|k| ray(i)[k] * normal[k]).sum::<f64>();
            // The right half is a wall far behind it.
            let depth = |i: usize| if i % 64 < 32 { (2.0 * normal[2] / along(i)) as f32 } else { 4.5 };
            let image = Image::from_vec(64, 48, (0..64 * 48).map(depth).collect()).expect("all pixels");
            let frame = preparer.prepare_metres(&image).expect("depth");
            // The borders' slopes are those of one side.
            for i in (0..64 * 48).filter(|i| i % 64 < 32) {
                let (pixel, z) = (frame.pixels[i], f64::from(depth(i)));
                if weight_of(pixel) == 0 {
                    continue;
                }
                let variance = |sigma: f64| f64::from(BETWEEN_M).powi(2) + sigma * sigma;
                let slant = along(i) / length;
                let head_on = 31.0 * variance(noise.floor_m) / variance(noise.sigma_m(z));
                let (expected, found) = (head_on * (slant * slant).min(1.0), f64::from(weight_of(pixel)));
                // Rounded twice; the slope over two pixels is that of a chord, and of one row for four.
                let off = (found - expected.max(1.0)).abs();
                assert!(off <= 1.01 + 0.15 * expected, "{normal:?} {i}: {found} {expected}");
                seen[0] += 1;
                seen[1] += usize::from(expected < 0.5 * head_on && head_on > 6.0);
            }
        }
        assert!(seen[0] > 3000 && seen[1] > 500, "{seen:?}");
    }

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
                let depths =
                    |frame: &DepthFrame| frame.pixels.iter().map(|p| p & !WEIGHT_BITS).collect::<Vec<_>>();
                let shape = preparer.prepare_packed_for_occupancy(&PackedDepth::pack(&image)).expect("depth");
                assert!(depths(shape) == depths(plain) && shape.valid() == plain.valid(), "{backend:?}");
            }
        }
        let broken = PackedDepth::from_bytes(37, 21, vec![0; 9].into());
        assert!(matches!(preparer.prepare_packed(&broken), Err(DenseError::Saved(_))));
        let small = PackedDepth::pack(&DepthImage::new(8, 8));
        assert!(matches!(preparer.prepare_packed(&small), Err(DenseError::Size { .. })));
    }
}
