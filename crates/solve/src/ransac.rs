//! How many samples robust estimation by random samples needs (Fischler and Bolles 1981).

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
    fn iteration_counts_are_those_of_the_formula() {
        assert_eq!(iterations(1.0, 5, 0.99, 1000), 1);
        assert_eq!(iterations(0.5, 4, 0.99, 1000), 72);
        assert_eq!(iterations(0.5, 8, 0.99, 5000), 1177);
        assert_eq!(iterations(0.0, 5, 0.99, 300), 300);
        assert_eq!(iterations(0.2, 8, 0.99, 500), 500);
        assert_eq!(iterations(f64::NAN, 8, 0.99, 500), 500);
    }
}
