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
    let n = rows[0].len();
    let (out, rows) = (&mut out[from..n], rows.map(|r| &r[from..n]));
    // Sums fit sixteen bits, so that compilers compute eight or more at once.
    for x in 0..n - from {
        let sum: u16 = (0..TAPS).map(|k| rows[k][x] as u16 * weights[k] as u16).sum();
        out[x] = ((sum + 64) >> 7) as u8;
    }
}

/// Weighted sum of four neighbours for each destination pixel, from column `from` on.
pub(super) fn combine_columns(row: &[u8], columns: &[Tap], out: &mut [u8], from: usize) {
    for (out, tap) in out.iter_mut().zip(columns).skip(from) {
        let source = &row[tap.start..tap.start + TAPS];
        // Bytes 0 and 2, and 1 and 3. The upper half of `(a + b << 16) * (d + c << 16)` is `ac + bd` where nothing is carried.
        let pairs = |bytes: [u8; TAPS]| [0, 8].map(|bits| (u32::from_le_bytes(bytes) >> bits) & 0x00ff_00ff);
        let [even, odd] = pairs([source[0], source[1], source[2], source[3]]);
        let [by_even, by_odd] = pairs(tap.weights).map(|w| w.rotate_left(16));
        let sum = even.wrapping_mul(by_even).wrapping_add(odd.wrapping_mul(by_odd)) >> 16;
        *out = ((sum + 64) >> 7) as u8;
    }
}
