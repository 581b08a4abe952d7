//! Distance and gradient between voxel centres, by trilinear interpolation.

use crate::block::{BlockKey, SIDE};
use crate::grid::BlockGrid;
use crate::tsdf::TsdfVolume;

/// Distance, in steps of the truncation distance, and its gradient in steps per voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    pub steps: f32,
    pub gradient: [f32; 3],
}

/// Samples a field that does not change meanwhile.
pub(crate) struct Sampler<'a> {
    volume: &'a TsdfVolume,
    grid: BlockGrid<'a>,
    by_voxel: f32,
}

impl<'a> Sampler<'a> {
    pub fn new(volume: &'a TsdfVolume) -> Self {
        let by_voxel = (1.0 / volume.config().voxel_m) as f32;
        Self { volume, grid: BlockGrid::new(volume), by_voxel }
    }

    /// Slot of the block that holds a point.
    #[inline(always)]
    pub fn slot(&self, key: BlockKey) -> Option<u32> {
        self.grid.slot(key)
    }

    /// Sum and weight of one voxel of a slot.
    #[inline(always)]
    pub fn voxel(&self, slot: u32, index: usize) -> (i32, i32) {
        let planes = self.volume.planes(slot);
        (planes.sum[index & 511], planes.weight[index & 511])
    }

    /// Samples at a point in metres; `None` where one of the eight voxels around it was not seen.
    #[inline]
    pub fn at(&self, p: [f32; 3]) -> Option<Sample> {
        let at = p.map(|v| v * self.by_voxel - 0.5);
        let low = at.map(floor);
        let part: [f32; 3] = std::array::from_fn(|i| at[i] - low[i] as f32);
        let d = self.corners(low)?;
        Some(interpolate(&d, part))
    }

    /// The eight voxels from `low` on; x varies fastest.
    #[inline(always)]
    fn corners(&self, low: [i32; 3]) -> Option<[f32; 8]> {
        let mut out = [0.0; 8];
        let local = low.map(|v| (v & 7) as usize);
        let key = BlockKey(low.map(|v| v >> 3));
        if local.iter().all(|&l| l + 1 < SIDE) {
            let planes = self.volume.planes(self.grid.slot(key)?);
            let first = crate::block::index(local);
            for (i, o) in out.iter_mut().enumerate() {
                let index = (first + (i & 1) + SIDE * (i >> 1 & 1) + SIDE * SIDE * (i >> 2)) & 511;
                let weight = planes.weight[index];
                if weight <= 0 {
                    return None;
                }
                *o = planes.sum[index] as f32 / weight as f32;
            }
            return Some(out);
        }
        for (i, o) in out.iter_mut().enumerate() {
            let (key, index) = BlockKey::of_voxel([
                low[0] + (i & 1) as i32,
                low[1] + (i >> 1 & 1) as i32,
                low[2] + (i >> 2) as i32,
            ]);
            let (sum, weight) = self.voxel(self.grid.slot(key)?, index);
            if weight <= 0 {
                return None;
            }
            *o = sum as f32 / weight as f32;
        }
        Some(out)
    }
}

/// Distance and gradient at a place between the eight corners of a cell; x varies fastest.
#[inline(always)]
pub(crate) fn interpolate(d: &[f32; 8], [x, y, z]: [f32; 3]) -> Sample {
    // Interpolates along x, then y, then z; the differences on the way give the gradient.
    let along_x = |i: usize| d[i] + (d[i + 1] - d[i]) * x;
    let c = [along_x(0), along_x(2), along_x(4), along_x(6)];
    let near = c[0] + (c[1] - c[0]) * y;
    let far = c[2] + (c[3] - c[2]) * y;
    let step_x = |i: usize| d[i + 1] - d[i];
    let gx_near = step_x(0) + (step_x(2) - step_x(0)) * y;
    let gx_far = step_x(4) + (step_x(6) - step_x(4)) * y;
    let gy = (c[1] - c[0]) + ((c[3] - c[2]) - (c[1] - c[0])) * z;
    Sample { steps: near + (far - near) * z, gradient: [gx_near + (gx_far - gx_near) * z, gy, far - near] }
}

/// Rounds down; without an instruction for it, the standard library's is a function call.
#[inline(always)]
pub(crate) fn floor(v: f32) -> i32 {
    let whole = v as i32;
    whole - i32::from((whole as f32) > v)
}
