//! Wide-angle lenses: equidistant (Kannala-Brandt), field-of-view and double-sphere models.

use super::positive::positive_on;
use cairn_geometry::Vec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Kannala and Brandt, "A generic camera model and calibration method" (2006), eq. 6 with the first coefficient 1:
/// `d(t) = t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9` for the angle `t` to the optical axis. Angles beyond 90 degrees have
/// an image too.
pub fn equidistant_distort(k: &[f64; 4], p: &Vec3) -> Option<[f64; 2]> {
    let r = p.x.hypot(p.y);
    if r < 1e-12 {
        return (p.z > 0.0).then_some([0.0, 0.0]);
    }
    let theta = r.atan2(p.z);
    if !equidistant_is_increasing(k, theta) {
        return None;
    }
    let scale = equidistant(k, theta).0 / r;
    Some([p.x * scale, p.y * scale])
}

/// Inverse of [`equidistant_distort`]; `None` beyond the fold or beyond 180 degrees.
pub fn equidistant_undistort(k: &[f64; 4], m: [f64; 2]) -> Option<Vec3> {
    let target = m[0].hypot(m[1]);
    if target < 1e-12 {
        return Some(Vec3::new(m[0], m[1], 1.0));
    }
    let theta = equidistant_angle(k, target)?;
    let scale = theta.sin() / target;
    Some(Vec3::new(m[0] * scale, m[1] * scale, theta.cos()))
}

/// `d(t)` and its derivative.
fn equidistant(k: &[f64; 4], t: f64) -> (f64, f64) {
    let s = t * t;
    let value = t * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
    let slope = 1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * (7.0 * k[2] + s * 9.0 * k[3])));
    (value, slope)
}

/// True when `d` is strictly increasing on `[0, theta]`.
fn equidistant_is_increasing(k: &[f64; 4], theta: f64) -> bool {
    positive_on(&[1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]], theta * theta)
}

/// The angle whose image is at distance `target`: Newton's method, with bisection where Newton leaves the increasing
/// part.
fn equidistant_angle(k: &[f64; 4], target: f64) -> Option<f64> {
    let mut t = target.min(PI);
    for _ in 0..20 {
        let (value, slope) = equidistant(k, t);
        let step = (target - value) / slope;
        t += step;
        if step.abs() < 1e-13 {
            break;
        }
    }
    let good = |t: f64| {
        t > 0.0 && t <= PI && (equidistant(k, t).0 - target).abs() < 1e-10 && equidistant_is_increasing(k, t)
    };
    if good(t) {
        return Some(t);
    }
    let (mut low, mut high) = (0.0, PI);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if equidistant_is_increasing(k, middle) && equidistant(k, middle).0 < target {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(low).filter(|&t| good(t))
}

/// Devernay and Faugeras, "Straight lines have to be straight" (2001), eq. 13:
/// `r' = atan(2 r tan(w / 2)) / w`.
pub fn fov_distort(w: f64, m: [f64; 2]) -> [f64; 2] {
    let r = m[0].hypot(m[1]);
    if w < 1e-6 || r < 1e-12 {
        return m; // the limit in both cases, to 1e-12
    }
    let scale = (2.0 * r * (0.5 * w).tan()).atan() / (w * r);
    [m[0] * scale, m[1] * scale]
}

/// Inverse of [`fov_distort`] (eq. 14); `None` for rays at 90 degrees or more.
pub fn fov_undistort(w: f64, m: [f64; 2]) -> Option<[f64; 2]> {
    let r = m[0].hypot(m[1]);
    if w < 1e-6 {
        return Some(m);
    }
    if r * w >= FRAC_PI_2 - 1e-9 {
        return None;
    }
    let slope = 2.0 * (0.5 * w).tan();
    if r < 1e-12 {
        return Some([m[0] * w / slope, m[1] * w / slope]);
    }
    let scale = (r * w).tan() / (slope * r);
    Some([m[0] * scale, m[1] * scale])
}

/// Usenko, Demmel and Cremers, "The double sphere camera model" (2018), eq. 40-45.
pub fn double_sphere_distort(xi: f64, alpha: f64, p: &Vec3) -> Option<[f64; 2]> {
    let d1 = p.norm();
    let w1 = if alpha <= 0.5 { alpha / (1.0 - alpha) } else { (1.0 - alpha) / alpha };
    let w2 = (w1 + xi) / (2.0 * w1 * xi + xi * xi + 1.0).sqrt();
    if d1 < 1e-12 || p.z <= -w2 * d1 {
        return None;
    }
    let shifted = xi * d1 + p.z;
    let d2 = (p.x * p.x + p.y * p.y + shifted * shifted).sqrt();
    let denominator = alpha * d2 + (1.0 - alpha) * shifted;
    (denominator > 1e-12).then(|| [p.x / denominator, p.y / denominator])
}

/// Inverse of [`double_sphere_distort`] (eq. 46-51), in closed form.
pub fn double_sphere_undistort(xi: f64, alpha: f64, m: [f64; 2]) -> Option<Vec3> {
    let s = m[0] * m[0] + m[1] * m[1];
    let under_root = 1.0 - (2.0 * alpha - 1.0) * s;
    if under_root < 0.0 {
        return None;
    }
    let mz = (1.0 - alpha * alpha * s) / (alpha * under_root.sqrt() + 1.0 - alpha);
    let under_root = mz * mz + (1.0 - xi * xi) * s;
    if under_root < 0.0 {
        return None;
    }
    let scale = (mz * xi + under_root.sqrt()) / (mz * mz + s);
    let ray = Vec3::new(scale * m[0], scale * m[1], scale * mz - xi);
    // The model is not one to one near its limit: only a ray that projects is a ray of this camera.
    (ray.norm_squared() > 1e-12 && double_sphere_distort(xi, alpha, &ray).is_some()).then_some(ray)
}
