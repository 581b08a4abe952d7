//! Tiles of value noise over several octaves, made once per world and combined at different periods so that no
//! two places look the same.
//!
//! Source: lattice noise with smooth interpolation, as in Perlin, "An image synthesizer" (1985).

use super::lattice::lattice;

/// Tiles of different periods, values about -127..127.
pub(crate) struct Noise {
    fine: Tile<512>,
    other: Tile<418>,
    coarse: Tile<480>,
}

struct Tile<const SIDE: usize> {
    values: Vec<i8>,
}

impl Noise {
    /// The tiles of a world.
    pub fn new(seed: u64) -> Self {
        Self {
            fine: Tile::new(seed ^ 0xA1, &[(2, 0.55), (4, 0.6), (8, 0.5), (16, 0.45), (32, 0.4)]),
            other: Tile::new(seed ^ 0xB2, &[(2, 0.4), (3, 0.5), (6, 0.6), (11, 0.6), (22, 0.5), (38, 0.4)]),
            coarse: Tile::new(seed ^ 0xC3, &[(24, 0.5), (60, 0.9), (120, 1.0)]),
        }
    }

    /// Fine structure (2 to 40 texels), -1..1.
    #[inline]
    pub fn fine(&self, x: usize, y: usize) -> f32 {
        f32::from(self.fine.at(x, y)) * (0.7 / 127.0) + f32::from(self.other.at(x + y / 8, y)) * (0.7 / 127.0)
    }

    /// As [`Noise::fine`], along a row from `x` on.
    pub fn fine_row(&self, x: usize, y: usize, out: &mut [f32]) {
        let (mut fine, mut other) = (vec![0; out.len()], vec![0; out.len()]);
        self.fine.row(x, y, &mut fine);
        self.other.row(x + y / 8, y, &mut other);
        for ((out, a), b) in out.iter_mut().zip(&fine).zip(&other) {
            *out = f32::from(*a) * (0.7 / 127.0) + f32::from(*b) * (0.7 / 127.0);
        }
    }

    /// Slow structure (24 to 120 texels), -1..1, along a row from `x` on.
    pub fn coarse_row(&self, x: usize, y: usize, out: &mut [f32]) {
        let mut coarse = vec![0; out.len()];
        self.coarse.row(x, y, &mut coarse);
        let mut slow = 0.0;
        for (i, (out, a)) in out.iter_mut().zip(&coarse).enumerate() {
            let x = x + i;
            if i == 0 || x.is_multiple_of(4) {
                slow = f32::from(self.other.at(y / 4 + x / 4, x / 4)) * (0.3 / 127.0);
            }
            *out = f32::from(*a) * (0.7 / 127.0) + slow;
        }
    }
}

impl<const SIDE: usize> Tile<SIDE> {
    /// Sums octaves of (cell in texels, weight); cells that do not divide the side are stretched until they do.
    fn new(seed: u64, octaves: &[(usize, f32)]) -> Self {
        let mut sum = vec![0f32; SIDE * SIDE];
        for (k, &(cell, weight)) in octaves.iter().enumerate() {
            let n = SIDE / cell;
            let step: Vec<(usize, f32)> = (0..SIDE)
                .map(|i| {
                    let p = i as f32 * n as f32 / SIDE as f32;
                    let f = p.fract();
                    (p as usize % n, f * f * (3.0 - 2.0 * f))
                })
                .collect();
            let values: Vec<f32> = (0..n * n)
                .map(|i| lattice(seed + k as u64, (i % n) as i64, (i / n) as i64) * 2.0 - 1.0)
                .collect();
            for y in 0..SIDE {
                let (j, g) = step[y];
                let (a, b) = (&values[j * n..(j + 1) * n], &values[(j + 1) % n * n..][..n]);
                let row: Vec<f32> = a.iter().zip(b).map(|(a, b)| a + (b - a) * g).collect();
                for (out, &(i, f)) in sum[y * SIDE..(y + 1) * SIDE].iter_mut().zip(&step) {
                    let right = row[if i + 1 == n { 0 } else { i + 1 }];
                    *out += weight * (row[i] + (right - row[i]) * f);
                }
            }
        }
        let values = sum.iter().map(|v| (v * 72.0).clamp(-127.0, 127.0) as i8).collect();
        Self { values }
    }

    fn row(&self, x: usize, y: usize, out: &mut [i8]) {
        let row = &self.values[y % SIDE * SIDE..][..SIDE];
        let (head, rest) = out.split_at_mut(out.len().min(SIDE - x % SIDE));
        head.copy_from_slice(&row[x % SIDE..][..head.len()]);
        rest.chunks_mut(SIDE).for_each(|part| part.copy_from_slice(&row[..part.len()]));
    }

    #[inline]
    fn at(&self, x: usize, y: usize) -> i8 {
        // In 32 bits the remainder by a constant is a multiplication.
        let (x, y) = (x as u32 % SIDE as u32, y as u32 % SIDE as u32);
        self.values[y as usize * SIDE + x as usize]
    }
}
