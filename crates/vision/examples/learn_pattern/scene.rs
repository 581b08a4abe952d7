//! Synthetic training images, rendered from a seed: the "dead leaves" model with textured surfaces.
//!
//! Shapes of random brightness that occlude each other, with sizes from a power law, have the edge and corner
//! statistics of photographs (Lee, Mumford and Huang, "Occlusion models for natural images", IJCV 2001); each carries
//! value noise whose amplitude falls as its frequency rises (a 1/f spectrum). Only operations that round identically on
//! every machine are used (no sine, no logarithm), so the images are the same everywhere.

/// A small seeded generator (xorshift64*, Vigna 2016). Not `cairn-random`: the pattern that was learned by its numbers is part
/// of every saved map.
pub struct Rng(u64);

impl Rng {
    pub fn new(seed: u64) -> Self {
        let mut rng = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..8).for_each(|_| {
            rng.bits();
        });
        rng
    }

    pub fn bits(&mut self) -> u32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32) as u32
    }

    /// Uniform in `from..to`.
    pub fn real(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.bits() as f64 / 4294967296.0)
    }

    /// Approximately normal with standard deviation 1: the sum of twelve uniform numbers.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.real(0.0, 1.0)).sum::<f64>() - 6.0
    }

    /// A random direction: cosine and sine.
    pub fn direction(&mut self) -> [f64; 2] {
        loop {
            let (x, y) = (self.real(-1.0, 1.0), self.real(-1.0, 1.0));
            let r = (x * x + y * y).sqrt();
            if r > 0.1 && r <= 1.0 {
                return [x / r, y / r];
            }
        }
    }
}

struct Leaf {
    at: [f64; 2],
    half: [f64; 2],
    turn: [f64; 2],
    round: bool,
    tone: f64,
    roughness: f64,
    grain: f64,
}

/// A plane covered by leaves, front to back.
pub struct Scene {
    leaves: Vec<Leaf>,
    salt: u64,
}

/// Side of the square of the plane that a scene covers.
pub const SIDE: f64 = 560.0;

impl Scene {
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let contrast = rng.real(25.0, 90.0);
        let (least, most) = (rng.real(3.0, 8.0), 150.0f64);
        let leaves = (0..6000)
            .map(|_| {
                let keep = 1.0 - (least / most) * (least / most);
                let size = least / (1.0 - rng.real(0.0, 1.0) * keep).sqrt();
                Leaf {
                    at: [rng.real(0.0, SIDE), rng.real(0.0, SIDE)],
                    half: [size, size * rng.real(0.25, 1.0)],
                    turn: rng.direction(),
                    round: rng.bits().is_multiple_of(3),
                    tone: 128.0 + contrast * rng.real(-1.2, 1.2),
                    roughness: contrast * rng.real(0.0, 0.35),
                    grain: rng.real(0.5, 3.0),
                }
            })
            .collect();
        Self { leaves, salt: seed }
    }

    /// A square image of `side` pixels with four samples per pixel; `scene_from_image` maps pixels to the plane.
    pub fn image(
        &self,
        side: usize,
        rng: &mut Rng,
        scene_from_image: impl Fn(f64, f64) -> [f64; 2],
    ) -> Vec<u8> {
        let buckets = Buckets::new(&self.leaves);
        let (gain, offset, noise) = (rng.real(0.7, 1.3), rng.real(-20.0, 20.0), rng.real(0.5, 4.0));
        let mut out = vec![0; side * side];
        for (i, out) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let p = scene_from_image((i % side) as f64 + dx, (i / side) as f64 + dy);
                sum += self.tone(&buckets, p);
            }
            let value = (sum / 4.0 - 128.0) * gain + 128.0 + offset + noise * rng.normal();
            *out = value.round().clamp(0.0, 255.0) as u8;
        }
        out
    }

    fn tone(&self, buckets: &Buckets, p: [f64; 2]) -> f64 {
        for &l in buckets.at(p) {
            let leaf = &self.leaves[l as usize];
            if leaf.covers(p) {
                return leaf.tone + leaf.roughness * roughness(p, leaf.grain, self.salt ^ l as u64);
            }
        }
        128.0
    }
}

impl Leaf {
    fn covers(&self, p: [f64; 2]) -> bool {
        let (dx, dy) = (p[0] - self.at[0], p[1] - self.at[1]);
        let x = (self.turn[0] * dx + self.turn[1] * dy) / self.half[0];
        let y = (self.turn[0] * dy - self.turn[1] * dx) / self.half[1];
        if self.round { x * x + y * y <= 1.0 } else { x.abs() <= 1.0 && y.abs() <= 1.0 }
    }
}

/// The leaves that can cover each cell of the plane, front to back.
struct Buckets(Vec<Vec<u32>>);

const BUCKET: f64 = 16.0;
const BUCKETS: usize = (SIDE / BUCKET) as usize;

impl Buckets {
    fn new(leaves: &[Leaf]) -> Self {
        let mut lists = vec![Vec::new(); BUCKETS * BUCKETS];
        let index = |c: f64| ((c / BUCKET).floor().max(0.0) as usize).min(BUCKETS - 1);
        for (i, leaf) in leaves.iter().enumerate() {
            let reach = leaf.half[0] * 1.5;
            for y in index(leaf.at[1] - reach)..=index(leaf.at[1] + reach) {
                for x in index(leaf.at[0] - reach)..=index(leaf.at[0] + reach) {
                    lists[y * BUCKETS + x].push(i as u32);
                }
            }
        }
        Self(lists)
    }

    fn at(&self, p: [f64; 2]) -> &[u32] {
        let index = |c: f64| ((c / BUCKET).floor().max(0.0) as usize).min(BUCKETS - 1);
        &self.0[index(p[1]) * BUCKETS + index(p[0])]
    }
}

/// Value noise of four octaves, each of twice the frequency and half the amplitude; about -1 to 1.
fn roughness(p: [f64; 2], grain: f64, salt: u64) -> f64 {
    let mut sum = 0.0;
    for octave in 0..4u64 {
        let width = grain * (8 >> octave) as f64;
        let (x, y) = (p[0] / width + 1000.0, p[1] / width + 1000.0);
        let (ix, iy) = (x.floor(), y.floor());
        let (fx, fy) = (x - ix, y - iy);
        let value = |dx: u64, dy: u64| {
            lattice(ix as u64 + dx, iy as u64 + dy, salt.wrapping_mul(4).wrapping_add(octave))
        };
        let top = value(0, 0) * (1.0 - fx) + value(1, 0) * fx;
        let bottom = value(0, 1) * (1.0 - fx) + value(1, 1) * fx;
        sum += (top * (1.0 - fy) + bottom * fy) * (8 >> octave) as f64 / 8.0;
    }
    sum
}

fn lattice(x: u64, y: u64, salt: u64) -> f64 {
    let mut h = x.wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ salt.wrapping_mul(0x1656_67b1_9e37_79f9);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (h >> 40) as f64 / 8388608.0 - 1.0
}
