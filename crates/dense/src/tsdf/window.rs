//! Blocks that the surface of a depth image may touch: a window of bits around the camera, one bit per block.

use crate::backend::dispatch;
use crate::block::{BlockKey, KEY_LIMIT, SIDE};
use crate::frame::DepthFrame;
use crate::{Backend, DenseError};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Camera;
use nalgebra::Vector3;

/// Limit of blocks along a side: beyond it the range is too far for this voxel size.
const MOST_BLOCKS: i32 = 640;

/// Rays of an image in units of blocks, relative to the window's low corner.
struct Rays {
    centre: Vector3<f32>,
    /// The ray with depth 1 through the principal point, and its increments per pixel.
    axis: Vector3<f32>,
    by_u: Vector3<f32>,
    by_v: Vector3<f32>,
    /// Extent of a pixel at depth 1 along each axis.
    pixel: Vector3<f32>,
    cx: f32,
    cy: f32,
    band_m: f32,
    pieces_by_m: f32,
    /// Squares that are deeper, or wider (pixels times depth), are divided: fewer blocks are then marked in vain. Doing it twice as
    /// often takes longer than those blocks do.
    deepest_m: f32,
    widest: f32,
}

impl Rays {
    fn new(camera: &Camera, volume_from_camera: &Se3, low: [i32; 3], block_m: f32, band_m: f32) -> Self {
        let r = volume_from_camera.rotation.matrix();
        let to_blocks = |v: Vec3| (v / f64::from(block_m)).map(|v| v as f32);
        let by_u = to_blocks(r * Vec3::new(1.0 / camera.fx, 0.0, 0.0));
        let by_v = to_blocks(r * Vec3::new(0.0, 1.0 / camera.fy, 0.0));
        let low = Vector3::from(low.map(|v| f64::from(v) * f64::from(block_m)));
        Self {
            centre: to_blocks(volume_from_camera.translation - low),
            axis: to_blocks(r * Vec3::z()),
            by_u,
            by_v,
            pixel: by_u.abs() + by_v.abs(),
            cx: camera.cx as f32,
            cy: camera.cy as f32,
            band_m,
            pieces_by_m: 1.0 / (0.75 * block_m),
            deepest_m: 2.0 * band_m,
            widest: block_m * camera.fx as f32,
        }
    }
}

/// The bits, reused from frame to frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Window {
    low: [i32; 3],
    size: [usize; 3],
    /// Words per row of blocks along x.
    words: usize,
    bits: Vec<u64>,
}

impl Window {
    /// Marks every block that holds a point within `band_m` of the surface, along the optical axis, and a few more.
    ///
    /// # Errors
    /// A pose out of range; a window that is too large for blocks of this size.
    pub fn mark(
        &mut self,
        frame: &DepthFrame,
        volume_from_camera: &Se3,
        voxel_m: f64,
        band_m: f64,
        backend: Backend,
    ) -> Result<(), DenseError> {
        let block_m = (SIDE as f64 * voxel_m) as f32;
        self.cover(frame, volume_from_camera, voxel_m, band_m)?;
        let camera = frame.camera();
        let rays = &Rays::new(camera, volume_from_camera, self.low, block_m, band_m as f32);
        // Larger squares would be too wide even at the least depth.
        let least = frame.range_m().map_or(0.0, |r| r.0);
        let mut level = 1;
        while level < 4 && (2 << level) as f32 * least <= rays.widest {
            level += 1;
        }
        let this = self;
        dispatch!(backend, mark_all(this: &mut Window, frame: &DepthFrame, rays: &Rays, level: usize) -> ());
        Ok(())
    }

    /// Marks the bounding boxes of the pieces of a square's frustum between `near - band` and `far + band`.
    #[inline(always)]
    fn mark_piece(&mut self, rays: &Rays, level: usize, x: usize, y: usize, near: f32, far: f32) {
        let size = (1 << level) as f32;
        let middle = |i: usize| i as f32 * size + 0.5 * (size - 1.0);
        let ray = rays.axis + rays.by_u * (middle(x) - rays.cx) + rays.by_v * (middle(y) - rays.cy);
        let (from, to) = (near - rays.band_m, far + rays.band_m);
        let side = rays.pixel * (0.5 * size * to);
        // Two or more pieces fit a slanted ray more tightly than one.
        let pieces = 1 + ((to - from) * rays.pieces_by_m) as i32;
        let spread = 0.5 * (to - from) / pieces as f32;
        let extent = ray.abs() * spread + side;
        let step = ray * (2.0 * spread);
        let mut at = rays.centre + ray * (from + spread);
        for _ in 0..pieces {
            self.mark_box([at.x, at.y, at.z], [extent.x, extent.y, extent.z]);
            at += step;
        }
    }

    /// Sets size and position so that all points of the image, and the band behind them, fit.
    fn cover(
        &mut self,
        frame: &DepthFrame,
        volume_from_camera: &Se3,
        voxel_m: f64,
        band_m: f64,
    ) -> Result<(), DenseError> {
        let camera = frame.camera();
        let far = frame.range_m().map_or(0.0, |r| f64::from(r.1)) + band_m;
        let (mut low, mut high) = (volume_from_camera.translation, volume_from_camera.translation);
        for [u, v] in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
            let edge = |s: f64, n: usize| if s < 0.0 { -1.0 } else { n as f64 };
            let x = (edge(u, camera.width) - camera.cx) / camera.fx;
            let y = (edge(v, camera.height) - camera.cy) / camera.fy;
            let corner = *volume_from_camera * (Vec3::new(x, y, 1.0) * far);
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let block_m = SIDE as f64 * voxel_m;
        let limit = f64::from(KEY_LIMIT);
        if !low.iter().chain(high.iter()).all(|v| (v / block_m).abs() < limit) {
            return Err(DenseError::Pose(format!(
                "camera at {:?} m is out of range",
                volume_from_camera.translation
            )));
        }
        for i in 0..3 {
            // The band also widens the boxes sideways: two blocks of margin.
            self.low[i] = (low[i] / block_m).floor() as i32 - 2;
            let blocks = (high[i] / block_m).floor() as i32 + 3 - self.low[i];
            if blocks > MOST_BLOCKS {
                let why = format!(
                    "{:.1} m of depth at voxels of {voxel_m} m: drop far depths or take larger voxels",
                    far
                );
                return Err(DenseError::Config(why));
            }
            self.size[i] = blocks as usize;
        }
        self.words = self.size[0].div_ceil(64);
        self.bits.clear();
        self.bits.resize(self.words * self.size[1] * self.size[2], 0);
        Ok(())
    }

    #[inline(always)]
    fn mark_box(&mut self, at: [f32; 3], extent: [f32; 3]) {
        // Positions in the window are not negative and below 2^22: adding 2^23 leaves the integer part in the lowest
        // bits. Exact integers may come out one too low, which only marks one block too many.
        let whole = |v: f32| (v + (8_388_608.0 - 0.5)).to_bits() & 0x7f_ffff;
        let low: [u32; 3] = std::array::from_fn(|i| whole(at[i] - extent[i]));
        let high: [u32; 3] = std::array::from_fn(|i| whole(at[i] + extent[i]).min(self.size[i] as u32 - 1));
        let (x0, x1) = (low[0] as usize, high[0] as usize);
        for z in low[2] as usize..=high[2] as usize {
            for y in low[1] as usize..=high[1] as usize {
                let row = (z * self.size[1] + y) * self.words;
                if x0 / 64 == x1 / 64 {
                    self.bits[row + x0 / 64] |= (u64::MAX << (x0 % 64)) & (u64::MAX >> (63 - x1 % 64));
                } else {
                    (x0..=x1).for_each(|x| self.bits[row + x / 64] |= 1 << (x % 64));
                }
            }
        }
    }

    /// The marked blocks, ordered by z, y, x.
    pub fn keys(&self, out: &mut Vec<BlockKey>) {
        out.clear();
        for (row, words) in self.bits.chunks_exact(self.words).enumerate() {
            let (y, z) =
                ((row % self.size[1]) as i32 + self.low[1], (row / self.size[1]) as i32 + self.low[2]);
            for (i, &word) in words.iter().enumerate() {
                let mut rest = word;
                while rest != 0 {
                    let x = (i * 64) as i32 + rest.trailing_zeros() as i32 + self.low[0];
                    out.push(BlockKey([x, y, z]));
                    rest &= rest - 1;
                }
            }
        }
    }
}

/// Marks around every square of a level; where the depths in one differ much, or it is far away and wide, around its quarters one by
/// one.
#[inline(always)]
fn mark_all(window: &mut Window, frame: &DepthFrame, rays: &Rays, level: usize) {
    let top = frame.pyramid.level(level);
    // Depth-first over quarters: at most three wait on each level below the first.
    let mut waiting = [(0, 0, 0); 16];
    for i in 0..top.width * top.height {
        waiting[0] = (level, i % top.width, i / top.width);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (level, x, y) = waiting[count];
            let squares = frame.pyramid.level(level);
            let (near, far) = (squares.least[y * squares.width + x], squares.greatest[y * squares.width + x]);
            if far <= 0.0 {
                continue;
            }
            let is_wide = level > 1 && (1 << level) as f32 * far > rays.widest;
            if far - near <= rays.deepest_m && !is_wide {
                window.mark_piece(rays, level, x, y, near, far);
            } else if level == 1 {
                // Of four pixels: those in front, and those behind.
                window.mark_piece(rays, level, x, y, near, near);
                window.mark_piece(rays, level, x, y, far, far);
            } else {
                let finer = frame.pyramid.level(level - 1);
                for v in 2 * y..(2 * y + 2).min(finer.height) {
                    for u in 2 * x..(2 * x + 2).min(finer.width) {
                        waiting[count] = (level - 1, u, v);
                        count += 1;
                    }
                }
            }
        }
    }
}
