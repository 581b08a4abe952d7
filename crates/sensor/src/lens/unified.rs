//! Unified models: a ray meets a surface around the camera, and is projected from a point on the axis.

use super::brown_conrady;
use cairn_geometry::Vec3;

/// Mei and Rives, "Single view point omnidirectional camera calibration from planar grids" (2007), section II: the unit ray is
/// projected from `xi` behind the centre of the sphere, and distorted as by Brown and Conrady.
pub fn distort(c: &[f64; 5], p: &Vec3) -> Option<[f64; 2]> {
    let [xi, k1, k2, p1, p2] = *c;
    let norm = p.norm();
    let (ray, depth) = (p / norm, p.z / norm + xi);
    // For xi > 1 the sphere hides its far side: rays beyond the tangent have no image.
    let seen = if xi > 1.0 { ray.z > -1.0 / xi } else { ray.z > -xi };
    if !(norm > 1e-12 && seen && depth > 1e-9) {
        return None;
    }
    brown_conrady::apply(&[k1, k2, p1, p2, 0.0, 0.0, 0.0, 0.0], [ray.x / depth, ray.y / depth])
}

/// Inverse of [`distort`].
pub fn undistort(c: &[f64; 5], m: [f64; 2]) -> Option<Vec3> {
    let [xi, k1, k2, p1, p2] = *c;
    let [x, y] = brown_conrady::invert(&[k1, k2, p1, p2, 0.0, 0.0, 0.0, 0.0], m)?;
    let s = x * x + y * y;
    let under_root = 1.0 + (1.0 - xi * xi) * s;
    if under_root < 0.0 {
        return None;
    }
    let scale = (xi + under_root.sqrt()) / (1.0 + s);
    let ray = Vec3::new(scale * x, scale * y, scale - xi);
    distort(c, &ray).is_some().then_some(ray)
}

/// Khomutenko, Garcia and Martinet, "An enhanced unified camera model" (2016), eq. 5-6 and 9.
pub fn extended_distort(alpha: f64, beta: f64, p: &Vec3) -> Option<[f64; 2]> {
    let distance = (beta * (p.x * p.x + p.y * p.y) + p.z * p.z).sqrt();
    let bound = if alpha <= 0.5 { alpha / (1.0 - alpha) } else { (1.0 - alpha) / alpha };
    let denominator = alpha * distance + (1.0 - alpha) * p.z;
    (distance > 1e-12 && p.z > -bound * distance && denominator > 1e-12)
        .then(|| [p.x / denominator, p.y / denominator])
}

/// Inverse of [`extended_distort`] (eq. 16-18), in closed form.
pub fn extended_undistort(alpha: f64, beta: f64, m: [f64; 2]) -> Option<Vec3> {
    let s = beta * (m[0] * m[0] + m[1] * m[1]);
    let under_root = 1.0 - (2.0 * alpha - 1.0) * s;
    if under_root < 0.0 {
        return None;
    }
    let depth = (1.0 - alpha * alpha * s) / (alpha * under_root.sqrt() + 1.0 - alpha);
    let ray = Vec3::new(m[0], m[1], depth);
    extended_distort(alpha, beta, &ray).is_some().then_some(ray)
}
