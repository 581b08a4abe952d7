//! A truncated signed distance field in sparse blocks, fused from depth images with known poses.

mod bits;
mod kernel;
#[cfg(target_arch = "x86_64")]
mod kernel_x86;
mod window;

pub(crate) use bits::Bits;
pub(crate) use kernel::{Colours, Planes, STEPS};
pub(crate) use window::Window;

use crate::backend::dispatch;
use crate::block::{BlockKey, BlockTable, Pages};
use crate::colour_image::ColourImage;
use crate::frame::DepthFrame;
use crate::project::Projection;
use crate::{Backend, DenseError};
use cairn_geometry::Se3;
use kernel::{Addition, Pass};

/// Configuration of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TsdfConfig {
    /// Edge of a voxel in metres, 0.005 to 0.2.
    pub voxel_m: f64,
    /// Truncation distance in voxels, 2 to 16.
    pub band_voxels: f64,
    /// Whether voxels keep colours.
    pub colour: bool,
}

impl Default for TsdfConfig {
    fn default() -> Self {
        Self { voxel_m: 0.02, band_voxels: 4.0, colour: false }
    }
}

/// Limit of images fused into one field: the integer sums then stay far from overflow.
const MOST_IMAGES: usize = 60_000;

/// A sparse field; positions are in its own frame, in metres. The voxel with index `i` has its centre at `(i + 0.5) *
/// voxel_m`.
#[derive(Clone)]
pub struct TsdfVolume {
    config: TsdfConfig,
    backend: Backend,
    table: BlockTable,
    /// Key of each slot; `None` where it is free.
    keys: Vec<Option<BlockKey>>,
    planes: Pages<Planes>,
    /// By slot, where it is in use: its voxels that were seen, and those behind the surface.
    bits: Vec<Bits>,
    colours: Pages<Colours>,
    /// For each slot, the revision of its last change.
    changed: Vec<u64>,
    revision: u64,
    images: usize,
    /// The lowest and the highest block that there may be, where it is bounded.
    within: Option<[[i32; 3]; 2]>,
    window: Window,
    touched: Vec<BlockKey>,
}

/// Statistics of fusing an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fused {
    /// Blocks visited.
    pub looked_at: usize,
    /// Blocks that hold a voxel within the truncation distance of the image's surface.
    pub changed: usize,
    /// Blocks created.
    pub created: usize,
    /// Blocks removed because nothing is left in them.
    pub removed: usize,
}

impl TsdfVolume {
    /// Creates an empty field.
    ///
    /// # Errors
    /// A config value out of range.
    pub fn new(config: TsdfConfig) -> Result<Self, DenseError> {
        if !(0.005..=0.2).contains(&config.voxel_m) || !(2.0..=16.0).contains(&config.band_voxels) {
            let why = format!(
                "voxels of {} m (0.005 to 0.2), a band of {} voxels (2 to 16)",
                config.voxel_m, config.band_voxels
            );
            return Err(DenseError::Config(why));
        }
        Ok(Self {
            config,
            backend: Backend::best(),
            table: BlockTable::default(),
            keys: Vec::new(),
            planes: Pages::default(),
            bits: Vec::new(),
            colours: Pages::default(),
            changed: Vec::new(),
            revision: 0,
            images: 0,
            within: None,
            window: Window::default(),
            touched: Vec::new(),
        })
    }

    /// The same with these instructions, when the processor has them.
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.backend = if backend.available() { backend } else { Backend::Scalar };
        self
    }

    /// The same with revisions from this one on.
    pub(crate) fn continuing(mut self, revision: u64) -> Self {
        self.revision = revision;
        self
    }

    /// The same with no block outside of a box, from its lowest to its highest.
    pub(crate) fn within(mut self, low: [i32; 3], high: [i32; 3]) -> Self {
        self.within = Some([low, high]);
        self
    }

    /// Bytes of a block.
    pub(crate) fn block_bytes(config: &TsdfConfig) -> usize {
        let colours = if config.colour { size_of::<Colours>() } else { 0 };
        size_of::<Planes>() + size_of::<Bits>() + colours
    }

    /// The configuration.
    pub fn config(&self) -> &TsdfConfig {
        &self.config
    }

    /// Truncation distance in metres.
    pub fn band_m(&self) -> f64 {
        self.config.voxel_m * self.config.band_voxels
    }

    /// Fuses an image; `colour` has the frame's size and shows the same pixels.
    ///
    /// # Errors
    /// A pose that is not finite or out of range, a colour image of another size, a field that is full.
    pub fn integrate(
        &mut self,
        frame: &DepthFrame,
        colour: Option<&ColourImage>,
        volume_from_camera: &Se3,
    ) -> Result<Fused, DenseError> {
        if self.images >= MOST_IMAGES {
            return Err(DenseError::Config(format!("{MOST_IMAGES} images are in this field: begin another")));
        }
        let fused = self.pass(frame, colour, volume_from_camera, 1)?;
        self.images += 1;
        Ok(fused)
    }

    /// Removes an image that was fused with exactly this pose and without colours: the result is as if it had never been fused.
    ///
    /// # Errors
    /// As [`Self::integrate`].
    pub fn remove(&mut self, frame: &DepthFrame, volume_from_camera: &Se3) -> Result<Fused, DenseError> {
        let fused = self.pass(frame, None, volume_from_camera, -1)?;
        self.images = self.images.saturating_sub(1);
        Ok(fused)
    }

    fn pass(
        &mut self,
        frame: &DepthFrame,
        colour: Option<&ColourImage>,
        pose: &Se3,
        sign: i32,
    ) -> Result<Fused, DenseError> {
        if !pose.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        let colours = self.words(frame, colour)?;
        let (voxel, band) = (self.config.voxel_m, self.band_m());
        self.window.mark(frame, pose, voxel, band, self.backend)?;
        let mut touched = std::mem::take(&mut self.touched);
        self.window.keys(&mut touched);
        if let Some([low, high]) = self.within {
            touched.retain(|key| (0..3).all(|k| (low[k]..=high[k]).contains(&key.0[k])));
        }
        self.revision += 1;
        let projection = Projection::new(frame, pose, voxel);
        let offsets = projection.offsets();
        let pass = Pass {
            pixels: &frame.pixels,
            colours,
            width: frame.width(),
            height: frame.height(),
            offsets: &offsets,
            band_m: band as f32,
            scale: (f64::from(STEPS) / band) as f32,
            sign,
        };
        let (mut fused, mut addition) = (Fused::default(), Box::default());
        for &key in &touched {
            fused.looked_at += 1;
            self.fuse_block(key, projection.origin(key), &pass, &mut addition, &mut fused);
        }
        self.touched = touched;
        Ok(fused)
    }

    fn fuse_block(
        &mut self,
        key: BlockKey,
        origin: [f32; 3],
        pass: &Pass,
        addition: &mut Addition,
        fused: &mut Fused,
    ) {
        let known = self.table.get(&key).copied();
        match known {
            // Asked for while the image is looked at.
            Some(slot) => self.planes.at(slot).fetch_all(),
            None if pass.sign < 0 => return,
            None => {}
        }
        // A block without a voxel near the surface is left unchanged, whether it exists or not: the sums must not depend
        // on the order of images.
        if !find_addition(self.backend, addition, origin, pass) {
            return;
        }
        fused.changed += 1;
        let slot = known.unwrap_or_else(|| {
            fused.created += 1;
            self.create(key)
        });
        let (planes, bits) = (self.planes.at_mut(slot), &mut self.bits[slot as usize]);
        add(self.backend, planes, bits, addition);
        if !pass.colours.is_empty() {
            add_colours(self.backend, self.colours.at_mut(slot), addition, pass);
        }
        self.changed[slot as usize] = self.revision;
        if pass.sign < 0 && self.planes.at(slot).weight.iter().all(|&w| w == 0) {
            fused.removed += 1;
            self.free(key, slot);
        }
    }

    /// A slot for a block that does not exist yet.
    fn create(&mut self, key: BlockKey) -> u32 {
        let slot = self.planes.take();
        if self.config.colour {
            let same = self.colours.take();
            debug_assert_eq!(same, slot, "planes and colours are taken and given back together");
        }
        if self.changed.len() <= slot as usize {
            self.changed.resize(slot as usize + 1, 0);
            self.bits.resize(slot as usize + 1, Bits::default());
            self.keys.resize(slot as usize + 1, None);
        }
        self.table.insert(key, slot);
        self.keys[slot as usize] = Some(key);
        slot
    }

    fn free(&mut self, key: BlockKey, slot: u32) {
        self.table.remove(&key);
        self.keys[slot as usize] = None;
        self.planes.give_back(slot);
        if self.config.colour {
            self.colours.give_back(slot);
        }
    }

    /// The words of a colour image where colours are kept; empty without.
    fn words<'a>(
        &self,
        frame: &DepthFrame,
        colour: Option<&'a ColourImage>,
    ) -> Result<&'a [u32], DenseError> {
        let Some(colour) = colour.filter(|_| self.config.colour) else { return Ok(&[]) };
        if (colour.width(), colour.height()) != (frame.width(), frame.height()) {
            return Err(DenseError::Size {
                what: "colour",
                width: colour.width(),
                height: colour.height(),
                expected_width: frame.width(),
                expected_height: frame.height(),
            });
        }
        Ok(colour.words())
    }

    /// Share of the blocks around an image's surface that already exist, 0 to 1.
    ///
    /// # Errors
    /// A pose that is not finite or out of range.
    pub fn overlap(&mut self, frame: &DepthFrame, volume_from_camera: &Se3) -> Result<f64, DenseError> {
        if !volume_from_camera.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        self.window.mark(frame, volume_from_camera, self.config.voxel_m, self.band_m(), self.backend)?;
        self.window.keys(&mut self.touched);
        let known = self.touched.iter().filter(|key| self.table.contains_key(key)).count();
        Ok(known as f64 / self.touched.len().max(1) as f64)
    }

    /// Blocks in use.
    pub fn blocks(&self) -> usize {
        self.table.len()
    }

    /// Bytes of all planes, tables included.
    pub fn bytes(&self) -> usize {
        self.planes.bytes()
            + self.colours.bytes()
            + self.table.capacity() * 17
            + self.keys.capacity() * 24
            + self.bits.capacity() * size_of::<Bits>()
    }

    /// Revision: incremented by every image fused or removed.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Keys of the blocks changed after a revision, in a fixed order; all blocks for revision 0.
    pub fn changed_since(&self, revision: u64) -> impl Iterator<Item = BlockKey> + '_ {
        let since = self.keys.iter().zip(&self.changed).filter(move |(_, at)| **at > revision);
        since.filter_map(|(key, _)| *key)
    }

    /// Revision of the last change of a slot.
    pub(crate) fn changed_at(&self, slot: u32) -> u64 {
        self.changed[slot as usize]
    }

    /// Blocks and their slots, in a fixed order.
    pub(crate) fn slots(&self) -> impl Iterator<Item = (BlockKey, u32)> + '_ {
        self.keys.iter().enumerate().filter_map(|(slot, key)| key.map(|k| (k, slot as u32)))
    }

    /// Slot of a block.
    pub(crate) fn slot(&self, key: BlockKey) -> Option<u32> {
        self.table.get(&key).copied()
    }

    /// Distances and weights of a slot.
    pub(crate) fn planes(&self, slot: u32) -> &Planes {
        self.planes.at(slot)
    }

    /// Which voxels of a slot were seen, and which lie behind the surface.
    pub(crate) fn bits(&self, slot: u32) -> &Bits {
        &self.bits[slot as usize]
    }

    /// Colours of a slot; `None` without colours.
    pub(crate) fn colours(&self, slot: u32) -> Option<&Colours> {
        self.config.colour.then(|| self.colours.at(slot))
    }

    /// Distance in metres and weight of a voxel by its index; `None` where nothing was seen.
    pub fn voxel(&self, voxel: [i32; 3]) -> Option<(f64, i32)> {
        let (key, i) = BlockKey::of_voxel(voxel);
        let planes = self.planes(self.slot(key)?);
        let weight = planes.weight[i];
        let steps = f64::from(planes.sum[i]) / f64::from(weight);
        (weight > 0).then(|| (steps * self.band_m() / f64::from(STEPS), weight))
    }
}

fn find_addition(backend: Backend, out: &mut Addition, origin: [f32; 3], pass: &Pass) -> bool {
    debug_assert_eq!(pass.pixels.len(), pass.width * pass.height);
    match backend {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        // SAFETY: a backend is only set when it is available; frames hold width * height pixels.
        Backend::Avx512 => unsafe { kernel_x86::find_addition_avx512(out, origin, pass) },
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        // SAFETY: as above.
        Backend::Avx2 => unsafe { kernel_x86::find_addition_avx2(out, origin, pass) },
        _ => kernel::find_addition(out, origin, pass),
    }
}

fn add(backend: Backend, planes: &mut Planes, bits: &mut Bits, addition: &Addition) {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx512 {
        #[allow(unsafe_code)]
        // SAFETY: a backend is only set when it is available.
        return unsafe { kernel_x86::add_avx512(planes, bits, addition) };
    }
    dispatch!(backend, add_plainly(planes: &mut Planes, bits: &mut Bits, addition: &Addition) -> ());
}

#[inline(always)]
fn add_plainly(planes: &mut Planes, bits: &mut Bits, addition: &Addition) {
    planes.add(addition);
    bits.read(planes);
}

fn add_colours(backend: Backend, colours: &mut Colours, addition: &Addition, pass: &Pass) {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx512 {
        debug_assert_eq!(pass.colours.len(), pass.pixels.len());
        #[allow(unsafe_code)]
        // SAFETY: a backend is only set when it is available; the pixels were those of this pass.
        return unsafe { kernel_x86::colour_avx512(colours, addition, pass) };
    }
    let _ = backend;
    colours.add(addition, pass);
}
