//! From a sensor's depth image to a [`DepthFrame`]: unit, range, lens, edges, noise.

mod pack;

use crate::backend::dispatch;
use crate::colour_image::ColourImage;
use crate::frame::DepthFrame;
use crate::pyramid::DepthPyramid;
use crate::submap::{PackedDepth, PackedGray, broken};
use crate::{Backend, DenseError, DepthNoise};
use cairn_geometry::Vec2;
use cairn_sensor::{Camera, DepthImage, Distortion, GrayImage, Image};
use pack::{Measured, Packing, REACH, ROWS, Words, from_metres, from_packed, from_units};

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
    /// Standard deviation of what images of one surface differ by beside their noise, in metres: their poses and the sensor's lens. It
    /// makes what is near weigh less beside what is far.
    pub between_m: f64,
}

impl Default for DepthConfig {
    fn default() -> Self {
        Self {
            nearest_m: 0.3,
            farthest_m: 5.0,
            edge_share: 0.05,
            edge_m: 0.04,
            noise: DepthNoise::default(),
            between_m: 0.003,
        }
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
    /// The pixel of each number of the packed image that was prepared last, see [`crate::submap::Rows`].
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
        let DepthConfig { nearest_m, farthest_m, edge_share, edge_m, noise, between_m } = config;
        if !(nearest_m >= 0.05 && farthest_m > nearest_m && farthest_m <= 100.0) {
            let why = format!("depths from {nearest_m} to {farthest_m} m; 0.05 to 100 are possible");
            return Err(DenseError::Config(why));
        }
        if !(edge_share > 0.0 && edge_m > 0.0 && noise.floor_m > 0.0 && noise.growth >= 0.0) {
            return Err(DenseError::Config(format!("edge {edge_share}, {edge_m} m, noise {noise:?}")));
        }
        if !(0.0..=1.0).contains(&between_m) {
            return Err(DenseError::Config(format!("{between_m} m between images; 0 to 1 are possible")));
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
        let packing = Packing { config: &self.config, slanted };
        let (table, packed) = (&*by_number, &mut packed);
        let (rows, frame) = (&mut self.rows[..], &mut self.frame);
        let backend = self.backend;
        let valid = dispatch!(backend, from_packed(packing: Packing, packed: &mut crate::submap::Rows, table: &[u32; 1 << 16], rows: &mut [u32], frame: &mut DepthFrame, backend: Backend) -> Option<usize>);
        self.by_number = Some(by_number);
        let least = self.least_valid();
        match valid {
            Some(valid) if valid >= least => {
                self.frame.valid = valid;
                Ok(&self.frame)
            }
            Some(_) => self.prepare_units(image.unpack()?.data()),
            None => {
                // Half of it is here: of no image that there is.
                let DepthFrame { camera, pixels, pyramid, valid } = &mut self.frame;
                pixels.fill(0);
                pyramid.build(pixels, camera.width, camera.height, backend);
                *valid = 0;
                Err(broken())
            }
        }
    }

    fn prepare_units(&mut self, data: &[u16]) -> Result<&DepthFrame, DenseError> {
        let packing = Packing { config: &self.config, slanted: true };
        let scale = self.metres_per_unit as f32;
        let (remap, rows) = (&self.remap[..], &mut self.rows[..]);
        let frame = &mut self.frame;
        let valid = dispatch!(self.backend, from_units(packing: Packing, scale: f32, data: &[u16], remap: &[u32], rows: &mut [u32], frame: &mut DepthFrame) -> usize);
        self.finish_or_refuse(valid, data, |v| f32::from(v) * scale)
    }

    /// The colours of a frame's pixels, from a gray image that shows the same pixels as the sensor's depth.
    ///
    /// # Errors
    /// An image of another size.
    pub fn colours(&self, gray: &GrayImage) -> Result<ColourImage, DenseError> {
        let mut out = ColourImage::default();
        self.remap(gray, &mut out.0, |v| u32::from(v) * 0x01_01_01)?;
        Ok(out)
    }

    /// The shades of a frame's pixels, from such an image.
    ///
    /// # Errors
    /// An image of another size.
    pub fn shades(&self, gray: &GrayImage) -> Result<GrayImage, DenseError> {
        let mut out = GrayImage::new(0, 0);
        self.remap(gray, &mut out, |v| v)?;
        Ok(out)
    }

    /// [`Self::colours`] of a packed image, where there is one, in place of what is there.
    pub(crate) fn colours_packed<'a>(
        &self,
        gray: Option<&PackedGray>,
        out: &'a mut ColourImage,
    ) -> Result<Option<&'a ColourImage>, DenseError> {
        let Some(gray) = gray else { return Ok(None) };
        self.remap(&gray.unpack()?, &mut out.0, |v| u32::from(v) * 0x01_01_01)?;
        Ok(Some(out))
    }

    fn remap<T: Copy + Default>(
        &self,
        gray: &GrayImage,
        out: &mut Image<T>,
        of: impl Fn(u8) -> T,
    ) -> Result<(), DenseError> {
        self.check("colour", [gray.width(), gray.height()])?;
        let data = gray.data();
        out.resize(gray.width(), gray.height());
        match self.remap.is_empty() {
            true => out.data_mut().iter_mut().zip(data).for_each(|(out, v)| *out = of(*v)),
            // Where the pinhole sees nothing there is no depth either.
            false => out
                .data_mut()
                .iter_mut()
                .zip(&self.remap)
                .for_each(|(out, &i)| *out = of(data.get(i as usize).copied().unwrap_or(0))),
        }
        Ok(())
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
        let packing = Packing { config: &self.config, slanted: true };
        let data = image.data();
        let (remap, rows) = (&self.remap[..], &mut self.rows[..]);
        let frame = &mut self.frame;
        let valid = dispatch!(self.backend, from_metres(packing: Packing, data: &[f32], remap: &[u32], rows: &mut [u32], frame: &mut DepthFrame) -> usize);
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
        self.frame.valid = valid;
        Ok(&self.frame)
    }

    /// With fewer valid pixels a frame is refused.
    fn least_valid(&self) -> usize {
        (self.source.width * self.source.height / LEAST_VALID).max(1)
    }

    /// Refuses an image of another size.
    pub(crate) fn check(&self, what: &'static str, [width, height]: [usize; 2]) -> Result<(), DenseError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::WEIGHT_BITS;

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
