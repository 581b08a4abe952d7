//! Robust losses and chi-square bounds.

/// 95 % quantile of chi-square with two degrees of freedom: a monocular observation.
pub const CHI2_2: f64 = 5.991;
/// 95 % quantile of chi-square with three degrees of freedom: an observation with a right image or depth.
pub const CHI2_3: f64 = 7.815;

/// Huber's loss of a squared whitened residual: `(cost, weight)` with the bound `delta2` (squared).
///
/// Source: Huber (1964); the weight is that of iteratively re-weighted least squares.
pub fn huber(chi2: f64, delta2: f64) -> (f64, f64) {
    if chi2 <= delta2 {
        (chi2, 1.0)
    } else {
        let (delta, r) = (delta2.sqrt(), chi2.sqrt());
        (2.0 * delta * r - delta2, delta / r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_is_the_slope_of_the_cost() {
        for chi2 in [0.5, 5.0, 7.0, 50.0, 900.0] {
            let h = 1e-6 * chi2;
            let slope = (huber(chi2 + h, CHI2_2).0 - huber(chi2 - h, CHI2_2).0) / (2.0 * h);
            assert!((slope - huber(chi2, CHI2_2).1).abs() < 1e-6);
        }
    }
}
