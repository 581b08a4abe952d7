//! One block of log-odds against one depth image, voxel by voxel.

use crate::block::VOXELS;
use crate::project::Offsets;
use crate::view::NEAREST_M;

/// Log-odds of a block's voxels: above zero occupied, below zero free, zero unknown.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Odds(pub [i8; VOXELS]);

impl Default for Odds {
    fn default() -> Self {
        Self([0; VOXELS])
    }
}

/// Evidence of an image for a voxel: nothing, ...
pub const NOTHING: u8 = 0;
/// ... that a surface lies in it, ...
pub const HIT: u8 = 1;
/// ... that it is seen through, ...
pub const FREE: u8 = 2;
/// ... that no depth is returned from there although a surface would return one.
pub const SILENT: u8 = 3;

/// Evidence of an image for each voxel of a block.
#[derive(Clone, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Evidence(pub [u8; VOXELS]);

/// Inputs shared by all blocks of one image.
pub struct Pass<'a> {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Homogeneous pixels of the voxels relative to the first one, see [`Offsets`].
    pub offsets: &'a Offsets,
    /// Half of a voxel's extent along the optical axis, in metres.
    pub half_m: f32,
    /// Depth noise: floor, growth, nearest.
    pub noise: [f32; 3],
    /// 1 for each square of eight pixels that has no depth, nor have the squares around it; else 0.
    pub silent: &'a [u32],
    /// Range in metres up to which a surface would have been seen in those squares; 0 to ignore them.
    pub silent_m: f32,
    /// Log-odds added by a hit, subtracted by a miss, and the bound of the absolute value.
    pub hit: i8,
    pub miss: i8,
    pub limit: i8,
}

/// Least depths over squares of `1 << level` pixels, no wider than a voxel where that is two pixels or more.
#[derive(Clone, Copy)]
pub struct Nearest<'a> {
    pub level: usize,
    pub width: usize,
    pub least: &'a [f32],
}

/// Evidence of the image for the block whose first voxel projects to the homogeneous `origin`; false when there is
/// none.
///
/// The least depth of the pixels around the projection of a voxel's centre decides: the voxel is hit when that depth
/// lies in it, or in front of it by at most half its size (slanted surfaces stay closed), and free when it lies in
/// front of that depth by more than twice the noise. So every pixel counts, and thin objects near by are not missed.
pub fn classify(out: &mut Evidence, origin: [f32; 3], nearest: Nearest, pass: &Pass) -> bool {
    let [w, h] = pass.size;
    let [floor, growth, from] = pass.noise;
    let tiles = w.div_ceil(8);
    let mut any = false;
    for i in 0..VOXELS {
        out.0[i] = NOTHING;
        let z = origin[2] + pass.offsets.z[i];
        let inverse = 1.0 / z;
        let u = (origin[0] + pass.offsets.u[i]) * inverse;
        let v = (origin[1] + pass.offsets.v[i]) * inverse;
        if !(z >= NEAREST_M && u >= 0.0 && v >= 0.0 && u < w as f32 && v < h as f32) {
            continue;
        }
        let (x, y) = (u as usize, v as usize);
        let least = nearest.least[(y >> nearest.level) * nearest.width + (x >> nearest.level)];
        let behind = z - least;
        let hit = behind >= -pass.half_m && behind <= 2.0 * pass.half_m;
        let measured = least < f32::INFINITY;
        let past = least - from;
        let margin = pass.half_m + 2.0 * (floor + growth * (past * past));
        out.0[i] = if hit {
            HIT
        } else if measured && z + margin < least {
            FREE
        } else if !measured && z < pass.silent_m && pass.silent[(y >> 3) * tiles + (x >> 3)] != 0 {
            SILENT
        } else {
            NOTHING
        };
        any |= out.0[i] != NOTHING;
    }
    any
}

/// Updates log-odds with the evidence of an image; true when some voxel changed. They are clamped, so that a change
/// of the scene shows within a bounded number of images: Hornung et al., "OctoMap" (Autonomous Robots 2013), eq. 3
/// and 4.
#[inline(always)]
pub fn apply(odds: &mut Odds, evidence: &Evidence, [hit, miss, limit]: [i8; 3]) -> bool {
    let mut changed = 0;
    for (cell, &says) in odds.0.iter_mut().zip(&evidence.0) {
        // Where no depth is returned, only occupied voxels change, and no further than to just free.
        let gone = (says == SILENT) & (*cell > 0);
        let step = if says == HIT {
            hit
        } else if (says == FREE) | gone {
            -miss
        } else {
            0
        };
        // Limit and steps are at most 63: the sum does not overflow.
        let new = (*cell + step).clamp(-limit, limit);
        let new = if gone & (new <= 0) { -1 } else { new };
        changed |= new ^ *cell;
        *cell = new;
    }
    changed != 0
}

/// Adds the same value to all voxels, clamped; true when they are all equal afterwards.
#[inline(always)]
pub fn add_all(odds: &mut Odds, step: i8, limit: i8) -> bool {
    let first = (odds.0[0] + step).clamp(-limit, limit);
    let mut same = true;
    for cell in &mut odds.0 {
        *cell = (*cell + step).clamp(-limit, limit);
        same &= *cell == first;
    }
    same
}
