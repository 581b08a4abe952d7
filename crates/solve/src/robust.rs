//! Robust losses and chi-square bounds.

/// 95 % quantile of chi-square with two degrees of freedom: a monocular observation.
pub const CHI2_2: f64 = 5.991;
/// 95 % quantile of chi-square with three degrees of freedom: an observation with a right image or depth.
pub const CHI2_3: f64 = 7.815;

/// 95 % quantiles of chi-square with one to nine degrees of freedom.
pub const CHI2_95: [f64; 9] = [3.841, 5.991, 7.815, 9.488, 11.070, 12.592, 14.067, 15.507, 16.919];

/// Robust loss: the cost of a squared whitened residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Its square.
    Squared,
    /// Huber's: the square up to this width (in standard deviations), then linear.
    Huber(f64),
    /// Cauchy's with this width: a logarithm, so that far outliers have almost no influence.
    Cauchy(f64),
}

impl Loss {
    /// Cost of a squared whitened residual, and the weight of iteratively re-weighted least squares (the slope).
    pub fn of(&self, chi2: f64) -> (f64, f64) {
        match self {
            Self::Squared => (chi2, 1.0),
            Self::Huber(width) => huber(chi2, width * width),
            Self::Cauchy(width) => {
                let (c2, q) = (width * width, 1.0 + chi2 / (width * width));
                (c2 * q.ln(), 1.0 / q)
            }
        }
    }
}

/// Huber's loss of a squared whitened residual: `(cost, weight)` with the bound `delta2` (squared).
///
/// Source: Huber (1964); the weight is that of iteratively re-weighted least squares.
#[inline]
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
        for loss in [Loss::Squared, Loss::Huber(CHI2_2.sqrt()), Loss::Cauchy(1.5)] {
            for chi2 in [0.5, 5.0, 7.0, 50.0, 900.0] {
                let h = 1e-6 * chi2;
                let slope = (loss.of(chi2 + h).0 - loss.of(chi2 - h).0) / (2.0 * h);
                assert!((slope - loss.of(chi2).1).abs() < 1e-6);
            }
        }
    }
}
