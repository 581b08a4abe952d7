//! Portable version of the passes of [`super::blur`], and the kernel of every version.

/// Half the kernel, outermost first, in 1/128ths: `exp(-x^2 / 8)`, normalised.
pub(super) const KERNEL: [u8; 4] = [9, 17, 24, 28];

/// Vertical pass, from column `from` on.
pub(super) fn columns(rows: [&[u8]; 7], out: &mut [u8], from: usize) {
    let n = rows[0].len();
    weighted_sums(rows.map(|r| &r[from..]), &mut out[from..n]);
}

/// Horizontal pass: output pixel `x` is computed from scratch pixels `x` to `x + 6`.
pub(super) fn row(scratch: &[u8], out: &mut [u8]) {
    weighted_sums(std::array::from_fn(|k| &scratch[k..]), out);
}

/// Each row is at least as long as `out`. Sums fit sixteen bits, so that compilers compute eight or more at once.
fn weighted_sums(rows: [&[u8]; 7], out: &mut [u8]) {
    let rows = rows.map(|r| &r[..out.len()]);
    let k = KERNEL.map(|v| v as u16);
    for x in 0..out.len() {
        let p = rows.map(|r| r[x] as u16);
        let sum = (p[0] + p[6]) * k[0] + (p[1] + p[5]) * k[1] + (p[2] + p[4]) * k[2] + p[3] * k[3];
        out[x] = ((sum + 64) >> 7) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernel_is_gaussian() {
        let exact: Vec<f64> = (-3..=3).map(|x| (-(x * x) as f64 / 8.0).exp()).collect();
        let total: f64 = exact.iter().sum();
        for (k, e) in KERNEL.iter().zip(&exact) {
            assert!((*k as f64 - e / total * 128.0).abs() < 0.5);
        }
        assert_eq!(2 * (KERNEL[0] + KERNEL[1] + KERNEL[2]) as u32 + KERNEL[3] as u32, 128);
    }
}
