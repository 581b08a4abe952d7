#![doc = include_str!("../README.md")]

/// The increment of SplitMix64: 2^64 divided by the golden ratio, made odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64: similar inputs give unrelated outputs.
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A seeded generator (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// From a seed and a number that says what the numbers are for; streams of one seed are unrelated.
    pub fn stream(seed: u64, stream: u64) -> Self {
        Self(mix(seed.wrapping_add(GOLDEN)) ^ mix(stream.wrapping_add(0x1234_5678_9abc_def1)))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in [low, high), in single precision.
    pub fn uniform_f32(&mut self, low: f32, high: f32) -> f32 {
        self.uniform(f64::from(low), f64::from(high)) as f32
    }

    /// Uniform among 0 to `n - 1`; 0 for `n` = 0.
    pub fn below(&mut self, n: usize) -> usize {
        if n == 0 { 0 } else { (self.bits() % n as u64) as usize }
    }

    /// `K` different numbers in `0..n`, every set equally likely; `None` when `n < K`.
    pub fn sample<const K: usize>(&mut self, n: usize) -> Option<[usize; K]> {
        if n < K {
            return None;
        }
        let mut chosen = [0; K];
        for k in 0..K {
            chosen[k] = loop {
                let candidate = self.below(n);
                if !chosen[..k].contains(&candidate) {
                    break candidate;
                }
            };
        }
        Some(chosen)
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn standard_normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Normal with this mean and standard deviation.
    pub fn normal(&mut self, mean: f64, deviation: f64) -> f64 {
        mean + deviation * self.standard_normal()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_paper() {
        // The first outputs for seed 1234567 of the reference implementation (Vigna, prng.di.unimi.it).
        let mut random = Random::new(1_234_567);
        assert_eq!([random.bits(), random.bits()], [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
    }

    #[test]
    fn samples_are_different_and_uniform() {
        let mut random = Random::new(3);
        let mut hits = [0usize; 10];
        for _ in 0..20_000 {
            let s = random.sample::<4>(10).expect("ten are enough");
            for (k, &i) in s.iter().enumerate() {
                assert!(i < 10 && !s[..k].contains(&i));
                hits[i] += 1;
            }
        }
        // 8,000 expected for each, deviation about 70.
        assert!(hits.iter().all(|&h| (7_650..8_350).contains(&h)), "{hits:?}");
        assert_eq!(random.sample::<4>(3), None);
        assert_eq!(random.sample::<0>(0), Some([]));
    }

    #[test]
    fn moments_are_right() {
        let mut random = Random::new(1);
        let n = 100_000;
        let (mut sum, mut squares, mut units) = (0.0, 0.0, 0.0);
        let mut counts = [0; 7];
        for _ in 0..n {
            let x = random.normal(2.0, 3.0);
            (sum, squares, units) = (sum + x, squares + (x - 2.0) * (x - 2.0), units + random.unit());
            counts[random.below(7)] += 1;
        }
        let n = f64::from(n);
        // Five standard deviations of each mean.
        assert!((sum / n - 2.0).abs() < 5.0 * 3.0 / n.sqrt(), "{}", sum / n);
        assert!((squares / n - 9.0).abs() < 5.0 * 9.0 * (2.0 / n).sqrt(), "{}", squares / n);
        assert!((units / n - 0.5).abs() < 5.0 * (1.0 / 12.0 / n).sqrt(), "{}", units / n);
        for count in counts {
            assert!((f64::from(count) - n / 7.0).abs() < 5.0 * (n * 6.0 / 49.0).sqrt(), "{counts:?}");
        }
        assert_eq!(random.below(0), 0);
    }
}
