//! Portable version of the passes of [`super::resize`], and the taps of every version.

/// Taps per destination pixel and axis; enough for ratios below 2.
pub(super) const TAPS: usize = 4;

/// Four neighbouring source pixels and their weights (sum 128, each 0 to 127).
#[derive(Clone, Copy, Debug)]
pub(super) struct Tap {
    pub(super) start: usize,
    pub(super) weights: [u8; TAPS],
}

/// Weighted sum of four rows, from column `from` on.
pub(super) fn combine_rows(rows: [&[u8]; TAPS], weights: [u8; TAPS], out: &mut [u8], from: usize) {
    for x in from..rows[0].len() {
        let sum: u32 = (0..TAPS).map(|k| rows[k][x] as u32 * weights[k] as u32).sum();
        out[x] = ((sum + 64) >> 7) as u8;
    }
}

/// Weighted sum of four neighbours for each destination pixel, from column `from` on.
pub(super) fn combine_columns(row: &[u8], columns: &[Tap], out: &mut [u8], from: usize) {
    for (out, tap) in out.iter_mut().zip(columns).skip(from) {
        let source = &row[tap.start..tap.start + TAPS];
        let sum: u32 = (0..TAPS).map(|k| source[k] as u32 * tap.weights[k] as u32).sum();
        *out = ((sum + 64) >> 7) as u8;
    }
}
