//! The reprojection residual of an ideal pinhole, with or without a right image, and its Jacobians.
//!
//! With `q = world_from_camera^-1 * p`, the prediction is `u = fx q.x / q.z + cx`, `v = fy q.y / q.z + cy`, and minus the disparity,
//! `u_right - u = -baseline_fx / q.z`. The disparity and not `u_right`, because the feature in the right image is
//! found by aligning it to the left one (and depth is read at the left one's pixel): a localisation error of the left corner is
//! repeated in the right one, so the two are not independent measurements. Perturbing the pose on the right by `(t, w)` moves `q` by
//! `-t + q x w`; perturbing the point by `d` moves it by `R^T d`.

use cairn_geometry::{Mat3, Se3, Vec3};

/// An ideal camera: focal lengths and principal point in pixels, baseline times `fx` in pixel metres (0 for mono).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Focal length along x.
    pub fx: f64,
    /// Focal length along y.
    pub fy: f64,
    /// Principal point x.
    pub cx: f64,
    /// Principal point y.
    pub cy: f64,
    /// Baseline times `fx`.
    pub baseline_fx: f64,
}

/// A measured pixel: `u`, `v`, and the x in the right image, NaN where there is none.
pub type Pixel = [f64; 3];

/// A residual with its Jacobians; the third row is zero for a monocular pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear {
    /// Measured minus predicted: x, y, and x in the right image less x, pixels.
    pub residual: [f64; 3],
    /// By the pose: translation, then rotation.
    pub by_pose: [[f64; 6]; 3],
    /// By the point.
    pub by_point: [[f64; 3]; 3],
}

/// Rotation from world to camera and the camera's position, ready to project many points.
#[derive(Clone, Copy)]
pub(crate) struct View {
    camera_from_world: Mat3,
    centre: Vec3,
}

impl View {
    pub fn new(world_from_camera: &Se3) -> Self {
        Self {
            camera_from_world: world_from_camera.rotation.matrix().transpose(),
            centre: world_from_camera.translation,
        }
    }

    /// Rows of the rotation from world to camera.
    #[inline(always)]
    pub fn rows(&self) -> [[f64; 3]; 3] {
        rows(&self.camera_from_world)
    }

    /// Position of the camera.
    #[inline(always)]
    pub fn centre(&self) -> [f64; 3] {
        self.centre.into()
    }

    #[inline(always)]
    pub fn to_camera(self, p: &Vec3) -> Vec3 {
        self.camera_from_world * (p - self.centre)
    }
}

impl Pinhole {
    /// Residual and Jacobians of a point observed from a pose; `None` behind the camera.
    pub fn reproject(&self, world_from_camera: &Se3, point: &Vec3, pixel: &Pixel) -> Option<Linear> {
        self.linearise(&View::new(world_from_camera), point, pixel)
    }

    /// Measured minus predicted; `None` behind or at the camera.
    #[inline(always)]
    pub(crate) fn residual(&self, q: &Vec3, pixel: &Pixel) -> Option<[f64; 3]> {
        if q.z < 1e-3 {
            return None;
        }
        let inv = 1.0 / q.z;
        let u = self.fx * q.x * inv + self.cx;
        let right = if pixel[2].is_nan() { 0.0 } else { pixel[2] - pixel[0] + self.baseline_fx * inv };
        Some([pixel[0] - u, pixel[1] - (self.fy * q.y * inv + self.cy), right])
    }

    /// Residual and Jacobians at a view and a point; `None` behind the camera.
    #[inline(always)]
    pub(crate) fn linearise(&self, view: &View, point: &Vec3, pixel: &Pixel) -> Option<Linear> {
        let q = view.to_camera(point);
        let residual = self.residual(&q, pixel)?;
        let inv = 1.0 / q.z;
        let inv2 = inv * inv;
        // Residual = measured - predicted, so each row is minus the derivative of the prediction by q.
        let row_u = [-self.fx * inv, 0.0, self.fx * q.x * inv2];
        let row_v = [0.0, -self.fy * inv, self.fy * q.y * inv2];
        let row_r = if pixel[2].is_nan() { [0.0; 3] } else { [0.0, 0.0, -self.baseline_fx * inv2] };
        let mut by_pose = [[0.0; 6]; 3];
        let mut by_point = [[0.0; 3]; 3];
        let r = &rows(&view.camera_from_world);
        for (k, row) in [row_u, row_v, row_r].iter().enumerate() {
            let [a, b, c] = *row;
            by_pose[k] = [-a, -b, -c, b * q.z - c * q.y, c * q.x - a * q.z, a * q.y - b * q.x];
            for j in 0..3 {
                by_point[k][j] = a * r[0][j] + b * r[1][j] + c * r[2][j];
            }
        }
        Some(Linear { residual, by_pose, by_point })
    }
}

#[inline(always)]
fn rows(m: &Mat3) -> [[f64; 3]; 3] {
    [[m[(0, 0)], m[(0, 1)], m[(0, 2)]], [m[(1, 0)], m[(1, 1)], m[(1, 2)]], [m[(2, 0)], m[(2, 1)], m[(2, 2)]]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Manifold, So3};
    use nalgebra::SVector;

    #[test]
    fn jacobians_match_differences() {
        let camera = Pinhole { fx: 450.0, fy: 460.0, cx: 370.0, cy: 240.0, baseline_fx: 50.0 };
        let pose = Se3::new(So3::exp(&Vec3::new(0.3, -0.5, 0.2)), Vec3::new(1.0, -2.0, 0.5));
        for (q, right) in [(Vec3::new(0.4, -0.3, 3.0), 400.0), (Vec3::new(-2.0, 1.0, 5.0), f64::NAN)] {
            let point = pose * q;
            let pixel = [380.0, 200.0, right];
            let at = |pose: &Se3, point: &Vec3| {
                let l = camera.linearise(&View::new(pose), point, &pixel).expect("in front");
                l.residual
            };
            let linear = camera.linearise(&View::new(&pose), &point, &pixel).expect("in front");
            let h = 1e-6;
            for k in 0..6 {
                let mut d = SVector::<f64, 6>::zeros();
                d[k] = h;
                let (plus, minus) = (at(&pose.retract(&d), &point), at(&pose.retract(&-d), &point));
                for row in 0..3 {
                    let numeric = (plus[row] - minus[row]) / (2.0 * h);
                    assert!((numeric - linear.by_pose[row][k]).abs() < 1e-4, "pose {row} {k}");
                }
            }
            for k in 0..3 {
                let mut d = Vec3::zeros();
                d[k] = h;
                let (plus, minus) = (at(&pose, &(point + d)), at(&pose, &(point - d)));
                for row in 0..3 {
                    let numeric = (plus[row] - minus[row]) / (2.0 * h);
                    assert!((numeric - linear.by_point[row][k]).abs() < 1e-4, "point {row} {k}");
                }
            }
        }
    }
}
