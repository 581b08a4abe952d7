//! The camera of the BAL data set and its derivatives.

use cairn_geometry::{Manifold, Se3, So3, Vec2, Vec3, hat};
use nalgebra::{Matrix2, Matrix2x3, SMatrix, SVector};

/// Pose and lens of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalCamera {
    /// `camera_from_world`; the camera looks along -z.
    pub camera_from_world: Se3,
    /// Focal length in pixels.
    pub focal: f64,
    /// Radial distortion of second order.
    pub k1: f64,
    /// Radial distortion of fourth order.
    pub k2: f64,
}

/// A pixel with its derivatives by the camera (translation, rotation on the left, focal, k1, k2) and by the point.
pub struct Projection {
    pub pixel: Vec2,
    pub by_camera: SMatrix<f64, 2, 9>,
    pub by_point: Matrix2x3<f64>,
}

impl BalCamera {
    /// Projection of a point of the world, pixels from the image's centre; not finite for points in the camera's plane.
    pub fn project(&self, point: &Vec3) -> Vec2 {
        let p = self.camera_from_world * *point;
        let n = Vec2::new(-p.x / p.z, -p.y / p.z);
        let r2 = n.norm_squared();
        n * (self.focal * (1.0 + r2 * (self.k1 + r2 * self.k2)))
    }

    pub(crate) fn linearise(&self, point: &Vec3) -> Projection {
        let turned = self.camera_from_world.rotation * *point;
        let p = turned + self.camera_from_world.translation;
        let n = Vec2::new(-p.x / p.z, -p.y / p.z);
        let r2 = n.norm_squared();
        let scale = 1.0 + r2 * (self.k1 + r2 * self.k2);
        let by_n = (Matrix2::from_diagonal_element(scale)
            + n * n.transpose() * (2.0 * self.k1 + 4.0 * self.k2 * r2))
            * self.focal;
        let n_by_p = Matrix2x3::new(-1.0, 0.0, -n.x, 0.0, -1.0, -n.y) / p.z;
        let by_p = by_n * n_by_p;
        let mut by_camera = SMatrix::<f64, 2, 9>::zeros();
        by_camera.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_p);
        by_camera.fixed_view_mut::<2, 3>(0, 3).copy_from(&-(by_p * hat(&turned)));
        by_camera.set_column(6, &(n * scale));
        by_camera.set_column(7, &(n * (self.focal * r2)));
        by_camera.set_column(8, &(n * (self.focal * r2 * r2)));
        let by_point = by_p * self.camera_from_world.rotation.matrix();
        Projection { pixel: n * (self.focal * scale), by_camera, by_point }
    }
}

impl Manifold<9> for BalCamera {
    fn retract(&self, d: &SVector<f64, 9>) -> Self {
        let pose = &self.camera_from_world;
        Self {
            camera_from_world: Se3::new(
                So3::exp(&d.fixed_rows::<3>(3).into()) * pose.rotation,
                pose.translation + d.fixed_rows::<3>(0),
            ),
            focal: self.focal + d[6],
            k1: self.k1 + d[7],
            k2: self.k2 + d[8],
        }
    }

    fn local(&self, other: &Self) -> SVector<f64, 9> {
        let (a, b) = (&self.camera_from_world, &other.camera_from_world);
        let t = b.translation - a.translation;
        let w = (b.rotation * a.rotation.inverse()).log();
        [t.x, t.y, t.z, w.x, w.y, w.z, other.focal - self.focal, other.k1 - self.k1, other.k2 - self.k2]
            .into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_match_differences() {
        let camera = BalCamera {
            camera_from_world: Se3::new(So3::exp(&Vec3::new(0.1, -0.2, 0.3)), Vec3::new(0.5, -0.3, -8.0)),
            focal: 500.0,
            k1: -0.1,
            k2: 0.05,
        };
        let point = Vec3::new(1.0, 2.0, 1.5);
        let found = camera.linearise(&point);
        assert!((found.pixel - camera.project(&point)).norm() < 1e-12);
        let h = 1e-6;
        for k in 0..9 {
            let mut d = SVector::<f64, 9>::zeros();
            d[k] = h;
            let slope =
                (camera.retract(&d).project(&point) - camera.retract(&-d).project(&point)) / (2.0 * h);
            assert!((slope - found.by_camera.column(k)).norm() < 1e-5, "{k}");
            assert!((camera.local(&camera.retract(&d)) - d).norm() < 1e-12);
        }
        for k in 0..3 {
            let mut d = Vec3::zeros();
            d[k] = h;
            let slope = (camera.project(&(point + d)) - camera.project(&(point - d))) / (2.0 * h);
            assert!((slope - found.by_point.column(k)).norm() < 1e-5, "{k}");
        }
    }
}
