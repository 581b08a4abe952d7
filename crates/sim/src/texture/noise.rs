//! Tiles of value noise over several octaves, made once per world and combined at unlike periods so that no
//! two places look alike.
//!
//! Source: lattice noise with smooth interpolation, as in Perlin, "An image synthesizer" (1985).

use crate::random::lattice;

/// Two tiles of unlike period, values about -127..127 with deviation near 40.
pub(crate) struct Noise {
    fine: Tile,
    other: Tile,
    coarse: Tile,
}

struct Tile {
    side: usize,
    values: Vec<i8>,
}

impl Noise {
    /// The tiles of a world.
    pub fn new(seed: u64) -> Self {
        Self {
            fine: Tile::new(seed ^ 0xA1, 512, &[(4, 0.5), (8, 0.6), (16, 0.7), (32, 0.8)]),
            other: Tile::new(seed ^ 0xB2, 418, &[(2, 0.35), (11, 0.6), (22, 0.7), (38, 0.8)]),
            coarse: Tile::new(seed ^ 0xC3, 480, &[(24, 0.5), (60, 0.9), (120, 1.0)]),
        }
    }

    /// Fine structure (2 to 40 texels), -1..1.
    pub fn fine(&self, x: usize, y: usize) -> f32 {
        f32::from(self.fine.at(x, y)) * (0.6 / 127.0) + f32::from(self.other.at(x + y / 7, y)) * (0.6 / 127.0)
    }

    /// Slow structure (24 to 120 texels), -1..1.
    pub fn coarse(&self, x: usize, y: usize) -> f32 {
        f32::from(self.coarse.at(x, y)) * (0.7 / 127.0)
            + f32::from(self.fine.at(y / 4 + x / 5, x / 4)) * (0.5 / 127.0)
    }
}

impl Tile {
    /// Sums octaves of (cell in texels, weight); cells divide the side or are stretched until they do.
    fn new(seed: u64, side: usize, octaves: &[(usize, f32)]) -> Self {
        let mut sum = vec![0f32; side * side];
        for (k, &(cell, weight)) in octaves.iter().enumerate() {
            let n = side / cell;
            let step: Vec<(usize, f32)> = (0..side)
                .map(|i| {
                    let p = i as f32 * n as f32 / side as f32;
                    let f = p.fract();
                    (p as usize % n, f * f * (3.0 - 2.0 * f))
                })
                .collect();
            let values: Vec<f32> = (0..n * n)
                .map(|i| lattice(seed + k as u64, (i % n) as i64, (i / n) as i64) * 2.0 - 1.0)
                .collect();
            for y in 0..side {
                let (j, g) = step[y];
                let (a, b) = (&values[j * n..(j + 1) * n], &values[(j + 1) % n * n..][..n]);
                let row: Vec<f32> = a.iter().zip(b).map(|(a, b)| a + (b - a) * g).collect();
                for (out, &(i, f)) in sum[y * side..(y + 1) * side].iter_mut().zip(&step) {
                    let right = row[if i + 1 == n { 0 } else { i + 1 }];
                    *out += weight * (row[i] + (right - row[i]) * f);
                }
            }
        }
        let values = sum.iter().map(|v| (v * 64.0).clamp(-127.0, 127.0) as i8).collect();
        Self { side, values }
    }

    fn at(&self, x: usize, y: usize) -> i8 {
        self.values[y % self.side * self.side + x % self.side]
    }
}
