//! The chi-square distribution, for gates and consistency bounds.
//!
//! Source: Abramowitz and Stegun, "Handbook of mathematical functions" (1964), 6.1.41 (logarithm of the gamma
//! function), 6.5.29 (series) and 6.5.31 (continued fraction) of the incomplete gamma function, 26.4.17 (first guess of
//! a quantile).

/// Probability that a chi-square variable with `dof` degrees of freedom is at most `x`; 0 for `x <= 0` and NaN for NaN.
pub fn cumulative(x: f64, dof: usize) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x.is_infinite() {
        return 1.0;
    }
    let (a, x) = (0.5 * dof as f64, 0.5 * x);
    let scale = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 { series(a, x) * scale } else { 1.0 - fraction(a, x) * scale }
}

/// The value that a chi-square variable with `dof` degrees of freedom does not exceed with this probability.
///
/// 0 for a probability of 0 or less or for no degrees of freedom, infinite for a probability of 1 or more.
pub fn quantile(probability: f64, dof: usize) -> f64 {
    if probability <= 0.0 || dof == 0 {
        return 0.0;
    }
    if probability >= 1.0 {
        return f64::INFINITY;
    }
    let n = dof as f64;
    // Bracketed from the mean, then bisected: fifty halvings are more precise than gates and bounds need.
    let (mut low, mut high) = (0.0, n + 10.0);
    while cumulative(high, dof) < probability {
        high *= 2.0;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if cumulative(middle, dof) < probability { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The two values between which the mean of `runs` chi-square variables, each of `dof` degrees of freedom, lies with
/// this probability (Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001,
/// 5.4.2).
pub fn mean_bounds(probability: f64, dof: usize, runs: usize) -> (f64, f64) {
    let tail = 0.5 * (1.0 - probability);
    let at = |p: f64| quantile(p, dof * runs) / runs.max(1) as f64;
    (at(tail), at(1.0 - tail))
}

fn series(a: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
    for _ in 0..10_000 {
        k += 1.0;
        term *= x / k;
        sum += term;
        if term < sum * 1e-16 {
            break;
        }
    }
    sum
}

/// Lentz's evaluation of the continued fraction.
fn fraction(a: f64, x: f64) -> f64 {
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1.0 / tiny, 1.0 / b);
    let mut value = d;
    for k in 1..10_000 {
        let k = f64::from(k);
        let numerator = -k * (k - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b).max(tiny);
        c = (b + numerator / c).max(tiny);
        let step = c * d;
        value *= step;
        if (step - 1.0).abs() < 1e-15 {
            break;
        }
    }
    value
}

/// Stirling's series, with the argument shifted up to where it is exact to double precision.
fn ln_gamma(a: f64) -> f64 {
    let (mut shift, mut z) = (0.0, a);
    while z < 12.0 {
        shift += z.ln();
        z += 1.0;
    }
    let (r, r2) = (1.0 / z, 1.0 / (z * z));
    let tail =
        r * (1.0 / 12.0 - r2 * (1.0 / 360.0 - r2 * (1.0 / 1260.0 - r2 * (1.0 / 1680.0 - r2 / 1188.0))));
    (z - 0.5) * z.ln() - z + 0.5 * std::f64::consts::TAU.ln() + tail - shift
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_tables() {
        // 95 % and 99 % quantiles, as in any statistics handbook.
        for (p, dof, value) in [
            (0.95, 1, 3.841_459),
            (0.95, 2, 5.991_465),
            (0.95, 3, 7.814_728),
            (0.99, 2, 9.210_340),
            (0.95, 10, 18.307_038),
            (0.05, 10, 3.940_299),
            (0.975, 100, 129.561_197),
            (0.025, 100, 74.221_927),
        ] {
            assert!((quantile(p, dof) - value).abs() < 1e-5, "{p} {dof}: {}", quantile(p, dof));
            assert!((cumulative(value, dof) - p).abs() < 1e-7);
        }
        // With two degrees of freedom the quantile has a closed form.
        for p in [0.01, 0.5, 0.9, 0.999] {
            assert!((quantile(p, 2) + 2.0 * (1.0_f64 - p).ln()).abs() < 1e-9);
        }
    }

    #[test]
    fn bounds_close_in_on_the_mean() {
        let (low, high) = mean_bounds(0.95, 3, 50);
        assert!((low - 2.36).abs() < 0.01 && (high - 3.72).abs() < 0.01, "{low} {high}");
        let (low, high) = mean_bounds(0.95, 3, 5000);
        assert!(low > 2.9 && high < 3.1);
    }

    #[test]
    fn ends_and_nonsense() {
        assert_eq!(quantile(0.0, 2), 0.0);
        assert_eq!(quantile(1.0, 2), f64::INFINITY);
        assert_eq!(quantile(0.5, 0), 0.0);
        assert_eq!(cumulative(-1.0, 2), 0.0);
        assert_eq!(cumulative(f64::INFINITY, 2), 1.0);
        assert!(cumulative(f64::NAN, 2).is_nan());
    }
}
