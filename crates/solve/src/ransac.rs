//! Seeded sampling for robust estimation: a small generator, samples without replacement, and how many
//! samples are enough (Fischler and Bolles 1981). No global state: the same seed gives the same samples.

/// A PCG-XSH-RR 64/32 generator (O'Neill 2014, "PCG: A family of simple fast space-efficient statistically
/// good algorithms for random number generation").
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
    increment: u64,
}

const MULTIPLIER: u64 = 6_364_136_223_846_793_005;

impl Rng {
    /// A generator from a seed; different seeds give unrelated streams.
    pub fn new(seed: u64) -> Self {
        Self::with_stream(seed, 0)
    }

    /// A generator from a seed and a stream number, so that (run, stage, frame) can each have its own.
    pub fn with_stream(seed: u64, stream: u64) -> Self {
        let mut rng = Self { state: 0, increment: (mix(stream) << 1) | 1 };
        rng.next_u32();
        rng.state = rng.state.wrapping_add(mix(seed));
        rng.next_u32();
        rng
    }

    /// The next 32 random bits.
    pub fn next_u32(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(MULTIPLIER).wrapping_add(self.increment);
        let shifted = (((old >> 18) ^ old) >> 27) as u32;
        shifted.rotate_right((old >> 59) as u32)
    }

    /// A whole number in `0..n`, without bias (Lemire 2019); 0 when `n` is 0.
    pub fn below(&mut self, n: u32) -> u32 {
        if n == 0 {
            return 0;
        }
        let threshold = n.wrapping_neg() % n;
        loop {
            let product = u64::from(self.next_u32()) * u64::from(n);
            if product as u32 >= threshold {
                return (product >> 32) as u32;
            }
        }
    }

    /// A float in [0, 1) with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        let high = u64::from(self.next_u32()) << 21;
        let low = u64::from(self.next_u32()) >> 11;
        (high ^ low) as f64 / (1u64 << 53) as f64
    }

    /// A float in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A draw from the normal distribution with mean 0 and deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// `K` different numbers in `0..n`, every set equally likely; `None` when `n < K`.
    pub fn sample<const K: usize>(&mut self, n: usize) -> Option<[usize; K]> {
        if n < K || n > u32::MAX as usize {
            return None;
        }
        let mut chosen = [0; K];
        for k in 0..K {
            chosen[k] = loop {
                let candidate = self.below(n as u32) as usize;
                if !chosen[..k].contains(&candidate) {
                    break candidate;
                }
            };
        }
        Some(chosen)
    }
}

/// Spreads a seed over all bits (the finaliser of SplitMix64, Steele et al. 2014).
fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// How many samples of `sample_size` are needed so that with probability `confidence` at least one holds
/// inliers only, when the share of inliers is `inlier_ratio` (Fischler and Bolles 1981, section II.B);
/// between 1 and `limit`.
pub fn iterations(inlier_ratio: f64, sample_size: u32, confidence: f64, limit: usize) -> usize {
    let limit = limit.max(1);
    let clean = inlier_ratio.clamp(0.0, 1.0).powi(sample_size as i32);
    if clean >= 1.0 {
        return 1;
    }
    let needed = (1.0 - confidence.clamp(0.0, 1.0 - 1e-12)).ln() / (-clean).ln_1p();
    if needed.is_finite() && needed < limit as f64 { (needed.ceil() as usize).max(1) } else { limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_seed_same_draws_and_other_seed_other_draws() {
        let draw = |seed, stream| -> Vec<u32> {
            let mut rng = Rng::with_stream(seed, stream);
            (0..32).map(|_| rng.next_u32()).collect()
        };
        assert_eq!(draw(7, 1), draw(7, 1));
        assert_ne!(draw(7, 1), draw(8, 1));
        assert_ne!(draw(7, 1), draw(7, 2));
    }

    #[test]
    fn samples_are_different_and_uniform() {
        let mut rng = Rng::new(3);
        let mut hits = [0usize; 10];
        for _ in 0..20_000 {
            let s = rng.sample::<4>(10).unwrap();
            for (k, &i) in s.iter().enumerate() {
                assert!(i < 10 && !s[..k].contains(&i));
                hits[i] += 1;
            }
        }
        // 8,000 expected for each, deviation about 70.
        assert!(hits.iter().all(|&h| (7_650..8_350).contains(&h)), "{hits:?}");
        assert_eq!(rng.sample::<4>(3), None);
    }

    #[test]
    fn iteration_counts_are_those_of_the_formula() {
        assert_eq!(iterations(1.0, 5, 0.99, 1000), 1);
        assert_eq!(iterations(0.5, 4, 0.99, 1000), 72);
        assert_eq!(iterations(0.5, 8, 0.99, 5000), 1177);
        assert_eq!(iterations(0.0, 5, 0.99, 300), 300);
        assert_eq!(iterations(0.2, 8, 0.99, 500), 500);
        assert_eq!(iterations(f64::NAN, 8, 0.99, 500), 500);
    }
}
