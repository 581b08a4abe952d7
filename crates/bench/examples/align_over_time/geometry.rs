//! What the true motion says of a match, and motions fitted to matches.

use cairn_geometry::{Se3, Vec3};
use cairn_vision::RectifiedCamera;
use nalgebra::{Matrix2x3, Matrix6, SMatrix, SVector, Vector2, Vector6};

fn ray(camera: &RectifiedCamera, px: [f64; 2]) -> Vec3 {
    Vec3::new((px[0] - camera.cx) / camera.fx, (px[1] - camera.cy) / camera.fy, 1.0)
}

/// Distance in pixels to the epipolar lines, the mean of both images.
pub fn epipolar(camera: &RectifiedCamera, b_from_a: &Se3, a: [f64; 2], b: [f64; 2]) -> f64 {
    let (ra, rb) = (ray(camera, a), ray(camera, b));
    let r = b_from_a.rotation.matrix();
    let line_b = b_from_a.translation.cross(&(r * ra));
    let line_a = r.transpose() * rb.cross(&b_from_a.translation);
    let length = |l: Vec3| (l.x / camera.fx).hypot(l.y / camera.fy).max(1e-15);
    let e = rb.dot(&line_b).abs();
    0.5 * (e / length(line_a) + e / length(line_b))
}

/// The motion near `start` that the matches agree with best: rotation and direction of the translation.
pub fn fit_epipolar(camera: &RectifiedCamera, start: Se3, matches: &[([f64; 2], [f64; 2])]) -> Se3 {
    let turned = |m: &Se3, d: &SVector<f64, 5>| {
        let length = m.translation.norm();
        let t = m.translation / length;
        let side = t.cross(&if t.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() }).normalize();
        let t = (t + side * d[3] + t.cross(&side) * d[4]).normalize() * length;
        let r = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, d[0], d[1], d[2])).rotation;
        Se3::new(r * m.rotation, t)
    };
    // Signed, so that it can be differentiated.
    let residual = |m: &Se3, (a, b): &([f64; 2], [f64; 2])| {
        let e = ray(camera, *b).dot(&m.translation.cross(&(m.rotation.matrix() * ray(camera, *a))));
        epipolar(camera, m, *a, *b) * e.signum()
    };
    let mut motion = start;
    for _ in 0..8 {
        let (mut h, mut g) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
        for m in matches {
            let e = residual(&motion, m);
            let j = SVector::<f64, 5>::from_fn(|k, _| {
                let mut d = SVector::<f64, 5>::zeros();
                d[k] = 1e-5;
                (residual(&turned(&motion, &d), m) - residual(&turned(&motion, &-d), m)) / 2e-5
            });
            let w = 1.0 / (1.0 + e * e / 0.25);
            h += w * j * j.transpose();
            g += w * j * e;
        }
        let Some(c) = h.cholesky() else { return motion };
        motion = turned(&motion, &-c.solve(&g));
    }
    motion
}

/// A point in the earlier camera, its pixel in the later one, and the size of a pixel of the level there.
pub struct Sighting {
    pub point: Vec3,
    pub pixel: [f64; 2],
    pub scale: f64,
}

/// The motion `b_from_a` near `start` by pose-only adjustment with Huber's loss.
pub fn fit_pose(camera: &RectifiedCamera, start: Se3, sightings: &[Sighting]) -> Se3 {
    let mut motion = start;
    for _ in 0..10 {
        let (mut h, mut g) = (Matrix6::<f64>::zeros(), Vector6::<f64>::zeros());
        for s in sightings {
            let p = motion * s.point;
            let Some([u, v, _]) = camera.project(&p) else { continue };
            let e = Vector2::new(u - s.pixel[0], v - s.pixel[1]) / s.scale;
            let iz = 1.0 / p.z;
            let d = Matrix2x3::new(
                camera.fx * iz,
                0.0,
                -camera.fx * p.x * iz * iz,
                0.0,
                camera.fy * iz,
                -camera.fy * p.y * iz * iz,
            ) / s.scale;
            let mut j = SMatrix::<f64, 2, 6>::zeros();
            j.fixed_view_mut::<2, 3>(0, 0).copy_from(&d);
            j.fixed_view_mut::<2, 3>(0, 3).copy_from(&(d * -cairn_geometry::hat(&p)));
            let w = (1.5 / e.norm().max(1e-9)).min(1.0);
            h += w * j.transpose() * j;
            g += w * j.transpose() * e;
        }
        let Some(c) = h.cholesky() else { return motion };
        motion = Se3::exp(&-c.solve(&g)) * motion;
    }
    motion
}
