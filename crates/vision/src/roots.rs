//! Real roots of polynomials of low degree and null spaces of small matrices, for the minimal solvers.

/// Highest degree that [`real_roots`] accepts.
pub(crate) const MAX_DEGREE: usize = 10;

/// Real roots of a polynomial, at most [`MAX_DEGREE`] of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Roots {
    values: [f64; 2 * MAX_DEGREE],
    count: usize,
}

impl Roots {
    fn new() -> Self {
        Self { values: [0.0; 2 * MAX_DEGREE], count: 0 }
    }

    fn push(&mut self, root: f64) {
        if self.count < self.values.len() {
            self.values[self.count] = root;
            self.count += 1;
        }
    }

    /// The roots found.
    pub(crate) fn as_slice(&self) -> &[f64] {
        &self.values[..self.count]
    }
}

/// Real roots of `c[0] + c[1] x + c[2] x^2 + ...`, degree at most [`MAX_DEGREE`].
///
/// Between neighbouring roots of its derivative a polynomial is monotonic, so each sign change there brackets one root;
/// derivatives are solved the same way, down to degree one. Roots outside [-1, 1] are found as inverses of those of the
/// reversed polynomial, which keeps all numbers near one. A double root is found when rounding leaves a sign change
/// there, or a value that is zero up to rounding.
pub(crate) fn real_roots(coefficients: &[f64]) -> Roots {
    let mut roots = Roots::new();
    let largest = coefficients.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    if coefficients.len() > MAX_DEGREE + 1 || !(largest > 0.0 && largest.is_finite()) {
        return roots;
    }
    let mut c = [0.0; MAX_DEGREE + 1];
    let n = coefficients.len();
    for (to, from) in c.iter_mut().zip(coefficients) {
        *to = from / largest;
    }
    for &x in roots_within(&c[..n]).as_slice() {
        roots.push(x);
    }
    c[..n].reverse();
    for &x in roots_within(&c[..n]).as_slice() {
        if x.abs() > 1e-12 && x.abs() < 1.0 {
            roots.push(1.0 / x);
        }
    }
    roots
}

/// Roots in [-1, 1].
fn roots_within(c: &[f64]) -> Roots {
    let mut roots = Roots::new();
    let degree = c.len().saturating_sub(1);
    if degree == 0 {
        return roots;
    }
    if degree == 1 {
        let x = -c[0] / c[1];
        if x.abs() <= 1.0 {
            roots.push(x);
        }
        return roots;
    }
    let mut slope = [0.0; MAX_DEGREE];
    for k in 1..=degree {
        slope[k - 1] = c[k] * k as f64;
    }
    let extrema = roots_within(&slope[..degree]);
    let (mut low, mut f_low) = (-1.0, horner(c, -1.0));
    for &high in extrema.as_slice().iter().chain(&[1.0]) {
        let f_high = horner(c, high);
        if f_low == 0.0 || f_low * f_high < 0.0 {
            roots.push(bracketed(c, &slope[..degree], low, high, f_low));
        } else if high < 1.0 && f_high.abs() < 1e-14 && f_high != 0.0 {
            roots.push(high);
        }
        (low, f_low) = (high, f_high);
    }
    if f_low == 0.0 {
        roots.push(1.0);
    }
    roots
}

fn horner(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Newton's method with bisection when a step would leave the bracket.
fn bracketed(c: &[f64], slope: &[f64], mut low: f64, mut high: f64, f_low: f64) -> f64 {
    if f_low == 0.0 {
        return low;
    }
    let rising = f_low < 0.0;
    let mut x = 0.5 * (low + high);
    for _ in 0..60 {
        let f = horner(c, x);
        if (f < 0.0) == rising {
            low = x
        } else {
            high = x
        }
        let newton = x - f / horner(slope, x);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() < 1e-15 {
            return next;
        }
        x = next;
    }
    x
}

/// A basis of the null space of a matrix of full row rank `R < C`, by elimination with complete pivoting, then made
/// orthonormal: `K = C - R` vectors; `None` when the rank is less.
pub(crate) fn null_space<const R: usize, const C: usize, const K: usize>(
    mut a: [[f64; C]; R],
) -> Option<[[f64; C]; K]> {
    debug_assert_eq!(K, C - R);
    let mut column: [usize; C] = std::array::from_fn(|i| i);
    let size = a.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    for r in 0..R {
        let (mut best, mut at) = (0.0, (r, r));
        for (i, row) in a.iter().enumerate().skip(r) {
            for (j, &col) in column.iter().enumerate().skip(r) {
                if row[col].abs() > best {
                    (best, at) = (row[col].abs(), (i, j));
                }
            }
        }
        // Also false for NaN.
        if !(best > 1e-12 * size) {
            return None;
        }
        a.swap(r, at.0);
        column.swap(r, at.1);
        let pivot_row = a[r].map(|v| v / a[r][column[r]]);
        a[r] = pivot_row;
        for (i, row) in a.iter_mut().enumerate() {
            if i != r {
                let factor = row[column[r]];
                for (v, p) in row.iter_mut().zip(&pivot_row) {
                    *v -= factor * p;
                }
            }
        }
    }
    let mut basis = [[0.0; C]; K];
    for k in 0..K {
        let free = column[R + k];
        let mut v = [0.0; C];
        v[free] = 1.0;
        for r in 0..R {
            v[column[r]] = -a[r][free];
        }
        for done in &basis[..k] {
            let along: f64 = v.iter().zip(done).map(|(a, b)| a * b).sum();
            for (v, d) in v.iter_mut().zip(done) {
                *v -= along * d;
            }
        }
        let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        basis[k] = v.map(|x| x / norm);
    }
    Some(basis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    fn from_roots(roots: &[f64]) -> Vec<f64> {
        let mut c = vec![1.0];
        for r in roots {
            let mut next = vec![0.0; c.len() + 1];
            for (k, v) in c.iter().enumerate() {
                next[k + 1] += v;
                next[k] -= r * v;
            }
            c = next;
        }
        c
    }

    #[test]
    fn finds_every_root() {
        let mut rng = Random::new(4);
        for _ in 0..500 {
            let n = 1 + rng.below(10);
            let mut roots: Vec<f64> = Vec::new();
            while roots.len() < n {
                let r = rng.uniform(-1.0, 1.0) * 10f64.powf(rng.uniform(-1.0, 1.0));
                if roots.iter().all(|o: &f64| (o - r).abs() > 0.08 * r.abs().max(1.0)) {
                    roots.push(r);
                }
            }
            let mut found = real_roots(&from_roots(&roots)).as_slice().to_vec();
            found.sort_by(f64::total_cmp);
            roots.sort_by(f64::total_cmp);
            assert_eq!(found.len(), n, "{found:?} {roots:?}");
            for (f, r) in found.iter().zip(&roots) {
                assert!((f - r).abs() < 1e-4 * r.abs().max(1.0), "{f} {r}");
            }
        }
    }

    #[test]
    fn no_roots_of_degenerate_polynomials() {
        assert!(real_roots(&[1.0, 0.0, 1.0]).as_slice().is_empty());
        assert!(real_roots(&[1.0]).as_slice().is_empty());
        assert!(real_roots(&[0.0, 0.0]).as_slice().is_empty());
        assert!(real_roots(&[f64::NAN, 1.0]).as_slice().is_empty());
        assert!(real_roots(&[]).as_slice().is_empty());
    }

    #[test]
    fn null_space_is_orthonormal_and_in_the_kernel() {
        let mut rng = Random::new(9);
        for _ in 0..100 {
            let a: [[f64; 9]; 5] = std::array::from_fn(|_| std::array::from_fn(|_| rng.standard_normal()));
            let basis = null_space::<5, 9, 4>(a).unwrap();
            for (k, v) in basis.iter().enumerate() {
                let dot = |u: &[f64; 9]| u.iter().zip(v).map(|(a, b)| a * b).sum::<f64>();
                assert!(a.iter().all(|row| dot(row).abs() < 1e-10));
                for (l, w) in basis.iter().enumerate() {
                    assert!((dot(w) - if k == l { 1.0 } else { 0.0 }).abs() < 1e-10);
                }
            }
        }
        assert!(null_space::<2, 3, 1>([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]).is_none());
        assert!(null_space::<2, 3, 1>([[f64::NAN, 2.0, 3.0], [2.0, 4.0, 6.0]]).is_none());
    }
}
