//! Tests whether a polynomial is positive on a whole interval, to detect where a radial model folds over.
//!
//! Bernstein form (Farouki 2012, "The Bernstein polynomial basis", section 4): a polynomial lies within
//! the convex hull of its Bernstein coefficients, so positive coefficients prove it; otherwise the interval is halved.

/// True when `sum c[i] * s^i > 0` for every `s` in `[0, end]`; `N` coefficients, at most 7.
pub fn positive_on<const N: usize>(c: &[f64; N], end: f64) -> bool {
    let mut scaled = *c;
    let mut power = 1.0;
    let mut lowest = c[0];
    for (i, v) in scaled.iter_mut().enumerate() {
        *v *= power;
        power *= end;
        if i > 0 {
            lowest += 0.5 * (*v - v.abs()); // min(v, 0), but keeps NaN
        }
    }
    if lowest > 0.0 {
        return true; // even with all negative terms at their maximum
    }
    subdivide(&bernstein(&scaled), 0)
}

/// From powers of `u` on `[0, 1]` to Bernstein coefficients: `b_j = sum_{i<=j} C(j,i) / C(n,i) a_i`.
fn bernstein<const N: usize>(a: &[f64; N]) -> [f64; N] {
    let mut b = [0.0; N];
    for (j, out) in b.iter_mut().enumerate() {
        let (mut choose_j, mut choose_n) = (1.0, 1.0);
        for (i, v) in a.iter().enumerate().take(j + 1) {
            *out += choose_j / choose_n * v;
            choose_j *= (j - i) as f64 / (i + 1) as f64;
            choose_n *= (N - 1 - i) as f64 / (i + 1) as f64;
        }
    }
    b
}

/// De Casteljau subdivision, until positivity is proven or an end coefficient (a value of the polynomial) is not
/// positive.
fn subdivide<const N: usize>(b: &[f64; N], depth: usize) -> bool {
    if !(b[0] > 0.0 && b[N - 1] > 0.0) {
        return false;
    }
    if b.iter().all(|&v| v > 0.0) {
        return true;
    }
    if depth == 24 {
        return false; // zero up to rounding
    }
    let (mut left, mut right) = ([0.0; N], *b);
    for (k, l) in left.iter_mut().enumerate() {
        *l = right[0];
        for i in 0..N - 1 - k {
            right[i] = 0.5 * (right[i] + right[i + 1]);
        }
    }
    subdivide(&left, depth + 1) && subdivide(&right, depth + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn finds_a_dip_between_positive_ends() {
        // (s - 0.5)^2 + e on [0, 1]
        assert!(positive_on(&[0.25 + 1e-6, -1.0, 1.0], 1.0));
        assert!(!positive_on(&[0.25 - 1e-6, -1.0, 1.0], 1.0));
        assert!(!positive_on(&[1.0, f64::NAN, 0.0], 1.0));
    }

    proptest! {
        #[test]
        fn agrees_with_dense_sampling(a in -3.0..3.0f64, b in -3.0..3.0f64, c in -3.0..3.0f64, end in 0.0..2.0f64) {
            let p = [1.0, a, b, c];
            let least = (0..=2000)
                .map(|i| end * i as f64 / 2000.0)
                .map(|s| p[0] + s * (p[1] + s * (p[2] + s * p[3])))
                .fold(f64::INFINITY, f64::min);
            prop_assume!(least.abs() > 1e-4);
            prop_assert_eq!(positive_on(&p, end), least > 0.0);
        }
    }
}
