//! Which voxels of a block were seen, and which of them lie behind the surface: one bit a voxel, by layers.
//!
//! They are read while the block is fused and still near to the processor: who looks for the surface then reads 128 bytes of most
//! blocks, not 4096.

use super::kernel::Planes;
use crate::block::SIDE;

/// The bits of a block; the voxel `x | y << 3` of a layer has the bit of that number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(align(64))]
pub struct Bits {
    /// By layer: voxels with any weight.
    pub seen: [u64; SIDE],
    /// By layer: voxels behind the surface.
    pub inside: [u64; SIDE],
}

impl Bits {
    /// Takes the bits of a block.
    #[inline(always)]
    pub fn read(&mut self, planes: &Planes) {
        for z in 0..SIDE {
            let sum = &planes.sum[64 * z..64 * z + 64];
            let weight = &planes.weight[64 * z..64 * z + 64];
            let (mut seen, mut inside) = ([0u8; 64], [0u8; 64]);
            for i in 0..64 {
                seen[i] = u8::from(weight[i] > 0);
                // Without weight the sum is zero.
                inside[i] = u8::from(sum[i] < 0);
            }
            (self.seen[z], self.inside[z]) = (bits(&seen), bits(&inside));
        }
    }
}

/// The lowest bits of 64 bytes: a product moves those of eight bytes next to each other.
#[inline(always)]
fn bits(bytes: &[u8; 64]) -> u64 {
    let mut out = 0;
    for i in 0..8 {
        let eight = (0..8).fold(0, |all, k| all | u64::from(bytes[8 * i + k]) << (8 * k));
        out |= (eight.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * i);
    }
    out
}
