//! Statistics of a list of errors, with the definitions of evo.

use serde::{Deserialize, Serialize};

/// Statistics of a list of errors, in the unit of the errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Root mean square.
    pub rmse: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Median; the mean of the two middle values for an even count.
    pub median: f64,
    /// Standard deviation of the population (divided by the count).
    pub std: f64,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
    /// Sum of squares.
    pub sse: f64,
    /// Number of values.
    pub count: usize,
}

impl Statistics {
    /// Statistics of these values; `None` without values, or when one is not finite.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.is_empty() || values.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (count, n) = (sorted.len(), sorted.len() as f64);
        let mean = values.iter().sum::<f64>() / n;
        let sse: f64 = values.iter().map(|v| v * v).sum();
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n;
        let median = 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
        let (min, max) = (sorted[0], sorted[count - 1]);
        Some(Self { rmse: (sse / n).sqrt(), mean, median, std: variance.sqrt(), min, max, sse, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_known_values() {
        let s = Statistics::of(&[3.0, 1.0, 2.0, 6.0]).unwrap();
        assert_eq!((s.mean, s.median, s.min, s.max, s.sse, s.count), (3.0, 2.5, 1.0, 6.0, 50.0, 4));
        assert!((s.rmse - 12.5_f64.sqrt()).abs() < 1e-15 && (s.std - 3.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(Statistics::of(&[]), None);
        assert_eq!(Statistics::of(&[1.0, f64::NAN]), None);
    }
}
