//! What one depth image adds to one block: the innermost loop of the TSDF, in plain Rust.
//!
//! Curless and Levoy, "A volumetric method for building complex models from range images" (SIGGRAPH 1996), eq. 1-4,
//! with distances along the optical axis as in Newcombe et al., "KinectFusion" (ISMAR 2011), eq. 6-9. Integer sums
//! are kept instead of a running mean: they do not depend on the order of the images, and an image can be removed
//! again exactly.

use crate::block::VOXELS;
use crate::pixel::{depth_of, weight_of};
use crate::project::Offsets;
use crate::view::NEAREST_M;

/// Resolution of a distance: the truncation distance is divided into this many steps.
pub const STEPS: i32 = 1024;

/// Distances and weights of a block's voxels.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Planes {
    /// Sum of weight times distance, in [`STEPS`] of the truncation distance.
    pub sum: [i32; VOXELS],
    /// Sum of weights.
    pub weight: [i32; VOXELS],
}

impl Default for Planes {
    fn default() -> Self {
        Self { sum: [0; VOXELS], weight: [0; VOXELS] }
    }
}

/// Sums of red, green, blue, and how many colours were added, of a block's voxels.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Colours {
    /// One plane each: red, green, blue, count.
    pub planes: [[i32; VOXELS]; 4],
}

impl Default for Colours {
    fn default() -> Self {
        Self { planes: [[0; VOXELS]; 4] }
    }
}

/// Inputs shared by all blocks of one image.
pub struct Pass<'a> {
    /// Prepared pixels, see [`crate::frame`].
    pub pixels: &'a [u32],
    /// Red, green and blue from the lowest byte, pixel by pixel; empty without colour.
    pub colours: &'a [u32],
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Homogeneous pixels of the voxels relative to the first one, see [`Offsets`].
    pub offsets: &'a Offsets,
    /// Truncation distance in metres.
    pub band_m: f32,
    /// [`STEPS`] over the truncation distance.
    pub scale: f32,
    /// 1 to fuse the image, -1 to remove it.
    pub sign: i32,
}

/// What an image adds to a block: found before anything is written, since many blocks near the surface get nothing.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Addition {
    /// Weight times distance of each voxel; 0 where nothing is added.
    pub sum: [i32; VOXELS],
    /// Weight of each voxel.
    pub weight: [i32; VOXELS],
    /// The pixel of each voxel within the truncation distance, else [`NO_PIXEL`]; anything without colour.
    pub pixel: [u32; VOXELS],
}

/// No pixel colours this voxel.
pub const NO_PIXEL: u32 = u32::MAX;

impl Default for Addition {
    fn default() -> Self {
        Self { sum: [0; VOXELS], weight: [0; VOXELS], pixel: [NO_PIXEL; VOXELS] }
    }
}

/// Finds what the image adds to the block whose first voxel projects to the homogeneous `origin`; true when some voxel
/// lies within the truncation distance of the surface.
pub fn find_addition(out: &mut Addition, origin: [f32; 3], pass: &Pass) -> bool {
    let mut in_band = false;
    let (width, height) = (pass.width as f32, pass.height as f32);
    let has_colour = !pass.colours.is_empty();
    for i in 0..VOXELS {
        (out.sum[i], out.weight[i]) = (0, 0);
        if has_colour {
            out.pixel[i] = NO_PIXEL;
        }
        let z = origin[2] + pass.offsets.z[i];
        let inverse = 1.0 / z;
        let u = (origin[0] + pass.offsets.u[i]) * inverse;
        let v = (origin[1] + pass.offsets.v[i]) * inverse;
        if !(z >= NEAREST_M && u >= 0.0 && v >= 0.0 && u < width && v < height) {
            continue;
        }
        let at = v as usize * pass.width + u as usize;
        let pixel = pass.pixels[at];
        let weight = weight_of(pixel) as i32;
        let distance = depth_of(pixel) - z;
        if weight == 0 || distance < -pass.band_m {
            continue;
        }
        let near = distance < pass.band_m;
        in_band |= near;
        // Rounded by truncation; the number is never negative.
        let steps = ((distance * pass.scale).min(STEPS as f32) + (STEPS as f32 + 0.5)) as i32 - STEPS;
        let weight = weight * pass.sign;
        (out.sum[i], out.weight[i]) = (weight * steps, weight);
        if has_colour && near {
            out.pixel[i] = at as u32;
        }
    }
    in_band
}

impl Planes {
    /// Asks for distances and weights from a voxel on, so that they are near when they are read.
    #[inline(always)]
    pub fn fetch(&self, from: usize) {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{_MM_HINT_T1, _mm_prefetch};
            let (sum, weight) = (&self.sum[from], &self.weight[from]);
            #[allow(unsafe_code)]
            // SAFETY: a hint; nothing is read or written.
            unsafe {
                _mm_prefetch::<_MM_HINT_T1>(std::ptr::from_ref(sum).cast());
                _mm_prefetch::<_MM_HINT_T1>(std::ptr::from_ref(weight).cast());
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = from;
    }

    /// The same for all voxels.
    pub fn fetch_all(&self) {
        (0..VOXELS).step_by(16).for_each(|i| self.fetch(i));
    }

    /// Adds what an image says.
    #[inline(always)]
    pub fn add(&mut self, addition: &Addition) {
        for i in 0..VOXELS {
            self.sum[i] += addition.sum[i];
            self.weight[i] += addition.weight[i];
        }
    }
}

impl Colours {
    /// Adds the colours of the voxels within the truncation distance.
    pub fn add(&mut self, addition: &Addition, pass: &Pass) {
        for i in (0..VOXELS).filter(|&i| addition.pixel[i] != NO_PIXEL) {
            let c = pass.colours[addition.pixel[i] as usize];
            for (k, plane) in self.planes[..3].iter_mut().enumerate() {
                plane[i] += ((c >> (8 * k)) & 255) as i32 * pass.sign;
            }
            self.planes[3][i] += pass.sign;
        }
    }
}
