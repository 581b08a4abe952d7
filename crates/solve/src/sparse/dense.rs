//! Dense kernels of a front: factor its columns, and take their product from what is left.
//!
//! One source, compiled for what the processor has. Every sum runs in the same order with fused multiply-add whatever the
//! vectors' width, so that the bits are the same on every machine; where there is no such instruction, by [`fused`].
//! Matrices are column-major slices with a leading dimension.

use super::fused::{fits, fused};

/// Columns factored one by one before the next ones are updated by a product.
const BLOCK: usize = 12;
/// Widest tile, columns.
const COLUMNS: usize = 6;

/// Factors the first `k` columns of a front of `m` rows in `panel` (leading dimension `m`) and subtracts the product of the
/// rows below from `rest` (`m - k` square, lower triangle; what stands above is not to be read). False when a pivot is
/// not positive.
pub fn factor_front(panel: &mut [f64], rest: &mut [f64], m: usize, k: usize) -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f") {
            return wide::avx512(panel, rest, m, k);
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            return wide::avx2(panel, rest, m, k);
        }
    }
    // Every 64-bit ARM processor has the instruction, WebAssembly has none.
    if cfg!(target_arch = "aarch64") {
        factor_with::<8, true>(panel, rest, m, k)
    } else {
        factor_with::<2, false>(panel, rest, m, k)
    }
}

/// The same code with wider instructions.
#[cfg(target_arch = "x86_64")]
mod wide {
    use super::factor_with;

    /// Only for processors with AVX-512F, as the caller has found out.
    #[allow(unsafe_code)]
    pub fn avx512(panel: &mut [f64], rest: &mut [f64], m: usize, k: usize) -> bool {
        #[target_feature(enable = "avx512f")]
        fn inner(panel: &mut [f64], rest: &mut [f64], m: usize, k: usize) -> bool {
            factor_with::<16, true>(panel, rest, m, k)
        }
        assert!(is_x86_feature_detected!("avx512f"));
        // SAFETY: the processor has the feature; the function itself is safe code.
        unsafe { inner(panel, rest, m, k) }
    }

    /// Only for processors with AVX2 and FMA, as the caller has found out.
    #[allow(unsafe_code)]
    pub fn avx2(panel: &mut [f64], rest: &mut [f64], m: usize, k: usize) -> bool {
        #[target_feature(enable = "avx2,fma")]
        fn inner(panel: &mut [f64], rest: &mut [f64], m: usize, k: usize) -> bool {
            factor_with::<8, true>(panel, rest, m, k)
        }
        assert!(is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));
        // SAFETY: the processor has the features; the function itself is safe code.
        unsafe { inner(panel, rest, m, k) }
    }
}

#[inline(always)]
fn factor_with<const ROWS: usize, const HAS_FMA: bool>(
    panel: &mut [f64],
    rest: &mut [f64],
    m: usize,
    k: usize,
) -> bool {
    let mut from = 0;
    while from < k {
        let width = BLOCK.min(k - from);
        let (done, now) = panel.split_at_mut(from * m);
        // Contributions of the columns before.
        subtract_product::<ROWS, HAS_FMA>(
            &mut now[from..],
            m,
            &done[from.min(done.len())..],
            m,
            m - from,
            width,
            from,
        );
        if !factor_columns::<HAS_FMA>(now, m, from, width) {
            return false;
        }
        from += width;
    }
    let below = m - k;
    if below > 0 {
        subtract_product::<ROWS, HAS_FMA>(rest, below, &panel[k..], m, below, below, k);
    }
    true
}

/// Factors `width` columns whose first diagonal entry stands at row `from`.
#[inline(always)]
fn factor_columns<const HAS_FMA: bool>(columns: &mut [f64], ld: usize, from: usize, width: usize) -> bool {
    for j in 0..width {
        let (before, column) = columns.split_at_mut(j * ld);
        let column = &mut column[from + j..ld];
        for p in 0..j {
            let left = &before[p * ld + from + j..(p + 1) * ld];
            let factor = -left[0];
            if HAS_FMA || !all_fit(left) {
                column.iter_mut().zip(left).for_each(|(c, l)| *c = l.mul_add(factor, *c));
            } else {
                column.iter_mut().zip(left).for_each(|(c, l)| *c = fused(*l, factor, *c));
            }
        }
        let pivot = column[0];
        // Also false for NaN.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        let inverse = 1.0 / root;
        column[0] = root;
        column[1..].iter_mut().for_each(|c| *c *= inverse);
    }
    true
}

/// `c -= a * a[..n]^T`: `c` has `m` rows and `n` columns, `a` has `m` rows and `depth` columns. Only what is on and below
/// the diagonal is sure to be computed.
#[inline(always)]
fn subtract_product<const ROWS: usize, const HAS_FMA: bool>(
    c: &mut [f64],
    ldc: usize,
    a: &[f64],
    lda: usize,
    m: usize,
    n: usize,
    depth: usize,
) {
    if depth == 0 {
        return;
    }
    if !HAS_FMA && !(0..depth).all(|p| all_fit(&a[p * lda..p * lda + m])) {
        return subtract_slowly(c, ldc, a, lda, m, n, depth);
    }
    let mut column = 0;
    while column < n {
        let width = COLUMNS.min(n - column);
        let (c, b) = (&mut c[column * ldc..], &a[column..]);
        match width {
            6 => strip::<ROWS, 6, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
            5 => strip::<ROWS, 5, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
            4 => strip::<ROWS, 4, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
            3 => strip::<ROWS, 3, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
            2 => strip::<ROWS, 2, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
            _ => strip::<ROWS, 1, HAS_FMA>(c, ldc, a, b, lda, column, m, depth),
        }
        column += width;
    }
}

/// [`subtract_product`] for numbers of any size.
fn subtract_slowly(c: &mut [f64], ldc: usize, a: &[f64], lda: usize, m: usize, n: usize, depth: usize) {
    for j in 0..n {
        for i in j..m {
            let sum = (0..depth).fold(0.0, |sum, p| a[p * lda + i].mul_add(a[p * lda + j], sum));
            c[j * ldc + i] -= sum;
        }
    }
}

fn all_fit(numbers: &[f64]) -> bool {
    numbers.iter().fold(true, |all, &v| all & fits(v))
}

/// `N` columns of the product, rows `from..m`.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn strip<const ROWS: usize, const N: usize, const HAS_FMA: bool>(
    c: &mut [f64],
    ldc: usize,
    a: &[f64],
    b: &[f64],
    lda: usize,
    from: usize,
    m: usize,
    depth: usize,
) {
    let mut row = from;
    while row + ROWS <= m {
        tile::<ROWS, N, HAS_FMA>(&mut c[row..], ldc, &a[row..], b, lda, depth);
        row += ROWS;
    }
    if ROWS > 8 && row + 8 <= m {
        tile::<8, N, HAS_FMA>(&mut c[row..], ldc, &a[row..], b, lda, depth);
        row += 8;
    }
    if row + 4 <= m {
        tile::<4, N, HAS_FMA>(&mut c[row..], ldc, &a[row..], b, lda, depth);
        row += 4;
    }
    if row + 2 <= m {
        tile::<2, N, HAS_FMA>(&mut c[row..], ldc, &a[row..], b, lda, depth);
        row += 2;
    }
    if row < m {
        tile::<1, N, HAS_FMA>(&mut c[row..], ldc, &a[row..], b, lda, depth);
    }
}

/// `M` rows and `N` columns of the product, held in registers.
#[inline(always)]
fn tile<const M: usize, const N: usize, const HAS_FMA: bool>(
    c: &mut [f64],
    ldc: usize,
    a: &[f64],
    b: &[f64],
    lda: usize,
    depth: usize,
) {
    let mut sum = [[0.0f64; M]; N];
    for p in 0..depth {
        let a: &[f64; M] = match a[p * lda..].first_chunk() {
            Some(a) => a,
            None => return,
        };
        let b: &[f64; N] = match b[p * lda..].first_chunk() {
            Some(b) => b,
            None => return,
        };
        for j in 0..N {
            for i in 0..M {
                sum[j][i] =
                    if HAS_FMA { a[i].mul_add(b[j], sum[j][i]) } else { fused(a[i], b[j], sum[j][i]) };
            }
        }
    }
    for j in 0..N {
        for (c, s) in c[j * ldc..j * ldc + M].iter_mut().zip(&sum[j]) {
            *c -= s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn front(m: usize, k: usize) -> (Vec<f64>, Vec<f64>) {
        let whole = |i: usize, j: usize| {
            let (lo, hi) = (i.min(j) as f64, i.max(j) as f64);
            if i == j { 2.0 * m as f64 } else { (lo * 1.3 + hi * 0.7).sin() }
        };
        let panel = (0..k).flat_map(|j| (0..m).map(move |i| whole(i, j))).collect();
        let rest = (k..m).flat_map(|j| (k..m).map(move |i| whole(i, j))).collect();
        (panel, rest)
    }

    #[test]
    fn fronts_of_every_size_are_factored() {
        for (m, k) in [(1, 1), (6, 6), (7, 3), (18, 6), (31, 13), (53, 24), (64, 60), (90, 41)] {
            let ((mut panel, mut rest), (before, rest_before)) = (front(m, k), front(m, k));
            assert!(factor_front(&mut panel, &mut rest, m, k));
            for j in 0..m {
                for i in j..m {
                    let product: f64 = (0..k.min(j + 1)).map(|p| panel[p * m + i] * panel[p * m + j]).sum();
                    let (found, expected) = if j < k {
                        (product, before[j * m + i])
                    } else {
                        let at = (j - k) * (m - k) + i - k;
                        (product + rest[at], rest_before[at])
                    };
                    assert!((found - expected).abs() < 1e-11, "{m} {k}: {i} {j}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn bits_do_not_depend_on_the_instructions() {
        let (m, k) = (71, 38);
        // Products of the second matrix have errors that underflow.
        for scale in [1.0, 1e-280] {
            let (mut a, mut ra) = front(m, k);
            a.iter_mut().chain(&mut ra).for_each(|v| *v *= scale);
            let (mut b, mut rb) = (a.clone(), ra.clone());
            assert!(factor_front(&mut a, &mut ra, m, k) && factor_with::<2, false>(&mut b, &mut rb, m, k));
            let lower = |j: usize, ld: usize| j * ld + j..(j + 1) * ld;
            assert!((0..k).all(|j| a[lower(j, m)] == b[lower(j, m)]));
            assert!((0..m - k).all(|j| ra[lower(j, m - k)] == rb[lower(j, m - k)]));
        }
    }

    #[test]
    fn refuses_a_pivot_that_is_not_positive() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let (mut panel, mut rest) = front(9, 4);
            panel[2 * 9 + 2] = bad;
            assert!(!factor_front(&mut panel, &mut rest, 9, 4));
        }
    }
}
