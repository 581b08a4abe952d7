//! The division model: Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens distortion" (2001),
//! eq. 1.

/// The distorted point: the root of `k r r_d^2 - r_d + r = 0` that is `r` for `k = 0`; `None` beyond the radius where it folds
/// over.
pub fn distort(k: f64, m: [f64; 2]) -> Option<[f64; 2]> {
    let under_root = 1.0 - 4.0 * k * (m[0] * m[0] + m[1] * m[1]);
    (under_root > 0.0).then(|| {
        let scale = 2.0 / (1.0 + under_root.sqrt());
        [m[0] * scale, m[1] * scale]
    })
}

/// The undistorted point; `None` beyond the fold or at infinity.
pub fn undistort(k: f64, m: [f64; 2]) -> Option<[f64; 2]> {
    let bent = k * (m[0] * m[0] + m[1] * m[1]);
    // d(r) / d(r_d) = (1 - bent) / (1 + bent)^2.
    (bent < 1.0 && bent > -1.0 + 1e-9).then(|| [m[0] / (1.0 + bent), m[1] / (1.0 + bent)])
}
