//! A synthetic scene with exact depth: a room around the camera, and spheres.
#![allow(dead_code)]

use cairn_dense::{DepthConfig, DepthFrame, DepthPreparer};
use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, Image};

/// Room and spheres; any part may be missing.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Low and high corner of the room.
    pub room: Option<(Vec3, Vec3)>,
    /// Centre and radius.
    pub spheres: Vec<(Vec3, f64)>,
}

impl Scene {
    /// A room of 4 x 3 x 2.4 m around the origin, with a ball.
    pub fn room() -> Self {
        let room = Some((Vec3::new(-2.0, -1.2, -1.5), Vec3::new(2.0, 1.2, 1.5)));
        Self { room, spheres: vec![(Vec3::new(0.4, 0.5, 0.6), 0.4)] }
    }

    /// Distance along a ray to the first surface.
    fn cast(&self, from: Vec3, ray: Vec3) -> Option<f64> {
        let mut best = f64::INFINITY;
        if let Some((low, high)) = self.room {
            for i in 0..3 {
                let wall = if ray[i] > 0.0 { high[i] } else { low[i] };
                let t = (wall - from[i]) / ray[i];
                if t > 0.0 {
                    best = best.min(t);
                }
            }
        }
        for (centre, radius) in &self.spheres {
            let to = from - centre;
            let (a, b) = (ray.norm_squared(), to.dot(&ray));
            let root = b * b - a * (to.norm_squared() - radius * radius);
            if root > 0.0 && -b - root.sqrt() > 0.0 {
                best = best.min((-b - root.sqrt()) / a);
            }
        }
        best.is_finite().then_some(best)
    }

    /// Distance of a point to the nearest surface.
    pub fn distance(&self, p: Vec3) -> f64 {
        let room = self
            .room
            .iter()
            .flat_map(|(low, high)| (0..3).map(move |i| (p[i] - low[i]).abs().min((p[i] - high[i]).abs())));
        let spheres = self.spheres.iter().map(|(centre, radius)| ((p - centre).norm() - radius).abs());
        room.chain(spheres).fold(f64::INFINITY, f64::min)
    }

    /// Depth in metres along the optical axis; 0 where the ray meets nothing.
    pub fn depth(&self, camera: &Camera, world_from_camera: &Se3) -> Image<f32> {
        let mut out = Image::new(camera.width, camera.height);
        for y in 0..camera.height {
            for x in 0..camera.width {
                let Some(ray) = camera.unproject(&Vec2::new(x as f64, y as f64)) else { continue };
                let hit = self.cast(world_from_camera.translation, world_from_camera.rotation * ray);
                out.row_mut(y)[x] = hit.map_or(0.0, |t| (t * ray.z) as f32);
            }
        }
        out
    }

    /// The same as a frame.
    pub fn frame(&self, camera: &Camera, world_from_camera: &Se3) -> DepthFrame {
        let mut preparer = DepthPreparer::new(DepthConfig::default(), *camera, 0.001).expect("a camera");
        preparer.prepare_metres(&self.depth(camera, world_from_camera)).expect("depth").clone()
    }
}

/// A small camera.
pub fn camera() -> Camera {
    Camera::pinhole(160, 120, 140.0, 140.0, 79.5, 59.5)
}

/// A pose at a position, with a rotation vector.
pub fn pose(at: [f64; 3], turn: [f64; 3]) -> Se3 {
    Se3::new(So3::exp(&Vec3::from(turn)), Vec3::from(at))
}

/// Poses near one position over a full turn, with a little sway.
pub fn turn(n: usize) -> Vec<Se3> {
    let at = |i: usize| std::f64::consts::TAU * i as f64 / n as f64;
    (0..n).map(|i| pose([0.1 * at(i).sin(), 0.05 * at(i).cos(), -0.2], [0.0, at(i), 0.0])).collect()
}
