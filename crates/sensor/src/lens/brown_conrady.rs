//! Brown-Conrady: radial (polynomial or rational) and tangential distortion of the image plane, and its inverse.
//!
//! Brown, "Close-range camera calibration" (1971), eq. 5-8, with the rational radial part of OpenCV:
//! `R(s) = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)`, `s = x^2 + y^2`;
//! `x' = x R + 2 p1 x y + p2 (s + 2 x^2)`, `y' = y R + p1 (s + 2 y^2) + 2 p2 x y`.

use super::positive::positive_on;

/// Coefficients of the polynomial model as those of the rational model.
pub fn extended(c: &[f64; 5]) -> [f64; 8] {
    [c[0], c[1], c[2], c[3], c[4], 0.0, 0.0, 0.0]
}

/// The distorted point; `None` where the model has folded over.
pub fn apply(c: &[f64; 8], m: [f64; 2]) -> Option<[f64; 2]> {
    let at = distort(c, m);
    (at.determinant() > 0.0 && before_fold(c, m)).then_some(at.value)
}

/// The point that is distorted to `target`, on the branch connected to the centre; `None` where there is none.
pub fn invert(c: &[f64; 8], target: [f64; 2]) -> Option<[f64; 2]> {
    let accept = |m: &[f64; 2]| distort(c, *m).determinant() > 0.0 && before_fold(c, *m);
    if let Some(m) = newton(c, target, target).filter(accept) {
        return Some(m);
    }
    // Near the fold Newton may jump to another branch: continuation from the centre, where the model is the identity.
    let mut m = [0.0, 0.0];
    for step in 1..=16 {
        let t = step as f64 / 16.0;
        m = newton(c, [target[0] * t, target[1] * t], m).filter(accept)?;
    }
    Some(m)
}

/// Value and Jacobian (rows `[a, b]`, `[b, d]`: it is symmetric) of the model at one point.
struct Distorted {
    value: [f64; 2],
    a: f64,
    b: f64,
    d: f64,
}

impl Distorted {
    fn determinant(&self) -> f64 {
        self.a * self.d - self.b * self.b
    }
}

fn distort(c: &[f64; 8], [x, y]: [f64; 2]) -> Distorted {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = *c;
    let s = x * x + y * y;
    let numerator = 1.0 + s * (k1 + s * (k2 + s * k3));
    let inverse_denominator = 1.0 / (1.0 + s * (k4 + s * (k5 + s * k6)));
    let radial = numerator * inverse_denominator;
    let slope = (k1 + s * (2.0 * k2 + s * 3.0 * k3) - radial * (k4 + s * (2.0 * k5 + s * 3.0 * k6)))
        * inverse_denominator;
    Distorted {
        value: [
            x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
            y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        a: radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        b: 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
        d: radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    }
}

/// Newton's method with step halving while the error grows; `None` when it does not converge to 1e-10 of the target.
fn newton(c: &[f64; 8], target: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
    let error = |at: &Distorted| [target[0] - at.value[0], target[1] - at.value[1]];
    let unit = 1.0 + target[0] * target[0] + target[1] * target[1];
    let mut m = start;
    let mut at = distort(c, m);
    let mut e = error(&at);
    let mut cost = e[0] * e[0] + e[1] * e[1];
    for _ in 0..60 {
        if cost < 1e-26 * unit {
            return Some(m);
        }
        let det = at.determinant();
        let mut step = [(at.d * e[0] - at.b * e[1]) / det, (at.a * e[1] - at.b * e[0]) / det];
        let mut better = false;
        for _ in 0..8 {
            let next = [m[0] + step[0], m[1] + step[1]];
            let next_at = distort(c, next);
            let next_e = error(&next_at);
            let next_cost = next_e[0] * next_e[0] + next_e[1] * next_e[1];
            if next_cost < cost {
                (m, at, e, cost, better) = (next, next_at, next_e, next_cost, true);
                break;
            }
            step = [0.5 * step[0], 0.5 * step[1]];
        }
        if !better {
            break;
        }
    }
    (cost < 1e-20 * unit).then_some(m)
}

/// True when the radial part is strictly increasing from the centre on: `d(r R) / dr > 0` on `[0, r]`, without a pole.
fn before_fold(c: &[f64; 8], [x, y]: [f64; 2]) -> bool {
    let [k1, k2, _, _, k3, k4, k5, k6] = *c;
    let s = x * x + y * y;
    if k4 == 0.0 && k5 == 0.0 && k6 == 0.0 {
        return positive_on(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3], s);
    }
    // (N / D) + 2 s (N' D - N D') / D^2 > 0, times D^2; the term s^(i+j) of N D carries 1 + 2 (i - j).
    let (numerator, denominator) = ([1.0, k1, k2, k3], [1.0, k4, k5, k6]);
    let mut p = [0.0; 7];
    for i in 0..4 {
        for j in 0..4 {
            p[i + j] += numerator[i] * denominator[j] * (1.0 + 2.0 * (i as f64 - j as f64));
        }
    }
    positive_on(&denominator, s) && positive_on(&p, s)
}
