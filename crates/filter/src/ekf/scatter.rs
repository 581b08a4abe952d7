//! How much the innovations of a robot scatter, against what the filter believes.
//!
//! In: the normalised innovation squared of each judged sighting. Out: the factor by which the covariance of innovations is wrong. Source:
//! Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE TAC 15(2), 1970; of his estimates only the scale, which
//! is the variance of unit weight of adjustment theory: when all noises are wrong by one factor, the estimate is the same and its
//! covariance is wrong by that factor.

/// Degrees of freedom after which older innovations count half as much: some minutes of one or two sightings at a time.
const MEMORY: f64 = 600.0;
/// Weight of the belief that the noise is right, in degrees of freedom.
const PRIOR: f64 = 20.0;
/// The factor stays within this one and its inverse: exact data would let it vanish.
const MOST: f64 = 16.0;

/// The scatter of the last innovations.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scatter {
    squares: f64,
    dof: f64,
}

impl Scatter {
    /// The mean normalised innovation squared for each degree of freedom.
    pub fn factor(&self) -> f64 {
        ((PRIOR + self.squares) / (PRIOR + self.dof)).clamp(1.0 / MOST, MOST)
    }

    /// Learns from a sighting; an outlier counts as this bound.
    pub fn learn(&mut self, nis: f64, bound: f64, dof: usize) {
        let keep = 0.5_f64.powf(dof as f64 / MEMORY);
        self.squares = keep * self.squares + nis.min(bound * self.factor());
        self.dof = keep * self.dof + dof as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    #[test]
    fn finds_the_factor_of_a_wrong_noise_and_one_of_a_right_one() {
        let mut random = Random::new(5);
        for factor in [0.3, 1.0, 4.0] {
            let mut scatter = Scatter::default();
            assert_eq!(scatter.factor(), 1.0, "at first the noise is believed");
            for _ in 0..2000 {
                let [a, b] = [random.standard_normal(), random.standard_normal()];
                scatter.learn(factor * (a * a + b * b), 13.8, 2);
            }
            assert!((scatter.factor() / factor - 1.0).abs() < 0.15, "{factor}: {}", scatter.factor());
        }
        let mut exact = Scatter::default();
        (0..5000).for_each(|_| exact.learn(0.0, 13.8, 2));
        assert_eq!(exact.factor(), 1.0 / MOST);
    }
}
