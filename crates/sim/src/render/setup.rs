//! The linear functions of the pixel for one face seen by one camera.

use crate::world::Face;
use cairn_geometry::{Mat3, Se3, Vec3};
use cairn_sensor::Camera;

/// A value `x * a[0] + y * a[1] + a[2]` over the image.
pub(crate) type Plane = [f64; 3];

/// The value of a plane at a pixel.
pub(crate) fn at(p: &Plane, x: f64, y: f64) -> f64 {
    p[0] * x + p[1] * y + p[2]
}

/// The near plane, in metres.
pub(crate) const NEAR_M: f64 = 0.04;

/// A face ready to be drawn.
pub(crate) struct Setup {
    /// Inverse depth in 1/m.
    pub inverse_depth: Plane,
    /// Texture coordinates over depth, in texels/m.
    pub texture_over_depth: [Plane; 2],
    /// By x and by y, of the inverse depth and of the texture coordinates over depth.
    pub slopes: [[f32; 2]; 3],
    /// Signed distance in pixels from each edge, positive inside; single precision, the fourth repeats the third for
    /// triangles.
    pub edges: [[f32; 3]; 4],
    /// The polygon in the image after clipping at the near plane.
    pub outline: [(f64, f64); 8],
    /// Corners in `outline`.
    pub corners: usize,
    /// Index of the texture.
    pub texture: usize,
}

/// The camera in the form that the setup needs.
pub(crate) struct View {
    rotation: Mat3,
    translation: Vec3,
    camera: Camera,
    /// Inward unit normals of the four sides of the view frustum.
    sides: [Vec3; 4],
}

impl View {
    /// From a pinhole camera and its pose.
    pub fn new(camera: &Camera, world_from_camera: &Se3) -> Self {
        let inverse = world_from_camera.inverse();
        let ray = |x: f64, y: f64| Vec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
        let (w, h) = (camera.width as f64, camera.height as f64);
        let (a, b) = (ray(-1.0, -1.0), ray(w, -1.0));
        let (c, d) = (ray(w, h), ray(-1.0, h));
        let sides = [a.cross(&b), b.cross(&c), c.cross(&d), d.cross(&a)].map(|n| n.normalize());
        Self { rotation: inverse.rotation.matrix(), translation: inverse.translation, camera: *camera, sides }
    }

    /// The linear functions of this face, or `None` when it is not visible.
    pub fn setup(&self, face: &Face) -> Option<Setup> {
        let centre = self.rotation * face.centre + self.translation;
        if centre.z < -face.radius || self.sides.iter().any(|n| n.dot(&centre) < -face.radius) {
            return None;
        }
        let origin = self.rotation * face.origin + self.translation;
        let (along, down) = (self.rotation * face.along, self.rotation * face.down);
        let normal = along.cross(&down);
        let det = normal.dot(&origin);
        if det < 1e-5 {
            return None;
        }
        let cam = &self.camera;
        let linear = |n: &Vec3, k: f64| -> Plane {
            let (gx, gy) = (n.x * k / cam.fx, n.y * k / cam.fy);
            [gx, gy, n.z * k - gx * cam.cx - gy * cam.cy]
        };
        let mut corners = [Vec3::zeros(); 4];
        let n = face.corners.len().min(4);
        for (out, c) in corners.iter_mut().zip(&face.corners) {
            *out = origin + along * c.x + down * c.y;
        }
        let (outline, count) = self.outline(&corners[..n])?;
        let mut edges = [[0f32; 3]; 4];
        for (i, edge) in edges.iter_mut().enumerate() {
            let i = i.min(n - 1);
            let e = linear(&corners[i].cross(&corners[(i + 1) % n]), 1.0);
            let norm = 1.0 / e[0].hypot(e[1]).max(1e-12);
            *edge = e.map(|v| (v * norm) as f32);
        }
        let inverse_depth = linear(&normal, 1.0 / det);
        let texture_over_depth =
            [down.cross(&origin), origin.cross(&along)].map(|n| linear(&n, face.texels_per_m / det));
        let [u, v] = texture_over_depth;
        Some(Setup {
            inverse_depth,
            texture_over_depth,
            slopes: [inverse_depth, u, v].map(|[x, y, _]| [x as f32, y as f32]),
            edges,
            outline,
            corners: count,
            texture: face.texture,
        })
    }

    /// Clips at the near plane and projects (Sutherland and Hodgman 1974).
    fn outline(&self, corners: &[Vec3]) -> Option<([(f64, f64); 8], usize)> {
        let mut out = [(0.0, 0.0); 8];
        let mut count = 0;
        let cam = &self.camera;
        let mut push = |p: Vec3| {
            out[count] = (cam.fx * p.x / p.z + cam.cx, cam.fy * p.y / p.z + cam.cy);
            count += 1;
        };
        for (i, a) in corners.iter().enumerate() {
            let b = &corners[(i + 1) % corners.len()];
            if a.z >= NEAR_M {
                push(*a);
            }
            if (a.z >= NEAR_M) != (b.z >= NEAR_M) {
                push(a + (b - a) * ((NEAR_M - a.z) / (b.z - a.z)));
            }
        }
        (count >= 3).then_some((out, count))
    }
}
