//! Seeded values on a lattice, for textures.

use cairn_random::mix;

/// A value in 0..1 that belongs to a lattice point.
pub(crate) fn lattice(seed: u64, x: i64, y: i64) -> f32 {
    let h = mix(seed ^ mix((x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ mix(y as u64)));
    (h >> 40) as f32 / (1u64 << 24) as f32
}
