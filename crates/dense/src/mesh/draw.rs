//! Depth and normals of a surface from any pose, by rasterising its triangles: on dense surfaces several times as
//! fast as casting a ray for each pixel, and equal to within a fraction of a voxel.
//!
//! Inverse depth is linear over the image of a plane, so it is interpolated with the edge functions of Pineda, "A
//! parallel algorithm for polygon rasterization" (SIGGRAPH 1988).

use super::{Mesh, Mesher};
use crate::pyramid::{greater, lesser};
use crate::view::{Box2, NEAREST_M};
use crate::{DenseError, RayCast, TsdfVolume};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, Distortion, Image};
use nalgebra::{Matrix3, Vector3};

impl Mesher {
    /// Renders a field as a pinhole camera would see it: its triangles in view are extracted and drawn.
    ///
    /// # Errors
    /// An invalid camera, or one whose lens distorts; a pose that is not finite.
    pub fn view(
        &mut self,
        volume: &TsdfVolume,
        camera: &Camera,
        volume_from_camera: &Se3,
        farthest_m: f64,
    ) -> Result<RayCast, DenseError> {
        check(camera, volume_from_camera)?;
        let side = crate::block::SIDE as f64 * volume.config().voxel_m;
        let boxes = Box2::new(camera, volume_from_camera, side);
        let in_view = |key| boxes.of(key).is_some_and(|(_, _, depth)| f64::from(depth[0]) < farthest_m);
        let keys: Vec<_> = volume.changed_since(0).filter(|&key| in_view(key)).collect();
        let mut mesh = Mesh::default();
        self.add(volume, keys.into_iter(), &mut mesh);
        mesh.finish();
        draw(&mesh, camera, volume_from_camera)
    }
}

/// Refuses what straight edges cannot be drawn for.
pub(super) fn check(camera: &Camera, pose: &Se3) -> Result<(), DenseError> {
    camera.validate().map_err(|e| DenseError::Camera(e.to_string()))?;
    if camera.distortion != Distortion::None {
        return Err(DenseError::Camera(
            "only a pinhole without distortion draws straight edges: cast rays".into(),
        ));
    }
    if !pose.is_finite() {
        return Err(DenseError::Pose("a number is not finite".into()));
    }
    Ok(())
}

/// A vertex projected into the camera: pixel, and inverse depth (0 for one that is too near or behind).
#[derive(Clone, Copy)]
pub(super) struct Corner {
    u: f32,
    v: f32,
    inverse: f32,
}

/// Projects vertices, and finds the pixels of triangles.
pub(super) struct Raster {
    rotation: Matrix3<f32>,
    translation: Vector3<f32>,
    focal: [f32; 2],
    centre: [f32; 2],
    width: usize,
    /// The last column and row.
    last: [f32; 2],
}

impl Raster {
    pub fn new(camera: &Camera, mesh_from_camera: &Se3) -> Self {
        let from = mesh_from_camera.inverse();
        Self {
            rotation: from.rotation.matrix().map(|v| v as f32),
            translation: from.translation.map(|v| v as f32),
            focal: [camera.fx, camera.fy].map(|v| v as f32),
            centre: [camera.cx, camera.cy].map(|v| v as f32),
            width: camera.width,
            last: [camera.width, camera.height].map(|n| n as f32 - 1.0),
        }
    }

    /// A direction of the mesh in the camera frame.
    fn turn(&self, p: &[f32; 3]) -> [f32; 3] {
        let r = &self.rotation;
        std::array::from_fn(|i| r[(i, 0)] * p[0] + r[(i, 1)] * p[1] + r[(i, 2)] * p[2])
    }

    pub fn project(&self, p: &[f32; 3]) -> Corner {
        let turned = self.turn(p);
        let [x, y, z] = std::array::from_fn(|i| turned[i] + self.translation[i]);
        let inverse = if z > NEAREST_M { 1.0 / z } else { 0.0 };
        Corner {
            u: self.focal[0] * x * inverse + self.centre[0],
            v: self.focal[1] * y * inverse + self.centre[1],
            inverse,
        }
    }

    /// Calls the closure with index, inverse depth (0 beside the triangle) and barycentric coordinates of each pixel around a
    /// triangle. Triangles seen from behind, or reaching behind the camera, have none.
    #[inline(always)]
    pub fn pixels(&self, [a, b, c]: [&Corner; 3], mut pixel: impl FnMut(usize, f32, [f32; 3])) {
        if a.inverse * b.inverse * c.inverse <= 0.0 {
            return;
        }
        // Seen from the front, triangles are clockwise in an image with y down, so this area is negative.
        let area = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
        if area >= 0.0 {
            return;
        }
        // Rounded without a library call, none of the numbers being negative or NaN.
        let [last_x, last_y] = self.last;
        let low = |p: f32, q: f32, r: f32| {
            let least = greater(lesser(lesser(p, q), r), 0.0);
            least as i32 + i32::from((least as i32 as f32) < least)
        };
        let high = |p: f32, q: f32, r: f32, last: f32| lesser(greater(greater(p, q), r), last);
        let (x1, y1) = (high(a.u, b.u, c.u, last_x), high(a.v, b.v, c.v, last_y));
        if x1 < 0.0 || y1 < 0.0 {
            return;
        }
        let (x0, y0, x1, y1) = (low(a.u, b.u, c.u), low(a.v, b.v, c.v), x1 as i32, y1 as i32);
        if x0 > x1 || y0 > y1 {
            return;
        }
        let by_area = 1.0 / area;
        // Barycentric coordinates of b and c, linear in the pixel.
        let (bx, by) = ((c.v - a.v) * by_area, -(c.u - a.u) * by_area);
        let (cx, cy) = (-(b.v - a.v) * by_area, (b.u - a.u) * by_area);
        for y in y0..=y1 {
            let dy = y as f32 - a.v;
            for x in x0..=x1 {
                let dx = x as f32 - a.u;
                let (of_b, of_c) = (dx * bx + dy * by, dx * cx + dy * cy);
                let of_a = 1.0 - of_b - of_c;
                // A small overlap, so that no pixel falls between two triangles.
                let covered = (of_a >= -1e-4) & (of_b >= -1e-4) & (of_c >= -1e-4);
                let inverse = of_a * a.inverse + of_b * b.inverse + of_c * c.inverse;
                pixel(
                    y as usize * self.width + x as usize,
                    if covered { inverse } else { 0.0 },
                    [of_a, of_b, of_c],
                );
            }
        }
    }
}

/// Renders a mesh as a pinhole camera would see it. Triangles seen from behind are not drawn.
///
/// # Errors
/// An invalid camera, or one whose lens distorts; a pose that is not finite.
pub fn draw(mesh: &Mesh, camera: &Camera, mesh_from_camera: &Se3) -> Result<RayCast, DenseError> {
    check(camera, mesh_from_camera)?;
    let raster = Raster::new(camera, mesh_from_camera);
    let vertices = mesh.positions.iter().zip(&mesh.normals);
    let seen: Vec<_> = vertices.map(|(p, n)| (raster.project(p), raster.turn(n))).collect();
    let (width, height) = (camera.width, camera.height);
    let mut nearest = vec![0.0f32; width * height];
    let mut normals = Image::new(width, height);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| &seen[i as usize]);
        raster.pixels([&a.0, &b.0, &c.0], |at, inverse, [of_a, of_b, of_c]| {
            if inverse > nearest[at] {
                nearest[at] = inverse;
                normals.data_mut()[at] =
                    std::array::from_fn(|k| of_a * a.1[k] + of_b * b.1[k] + of_c * c.1[k]);
            }
        });
    }
    let depth = nearest.into_iter().map(|v| if v > 0.0 { 1.0 / v } else { 0.0 }).collect();
    let depth_m = Image::from_vec(width, height, depth).unwrap_or_else(|| Image::new(width, height));
    for n in normals.data_mut() {
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        *n = if length > 0.0 { n.map(|v| v / length) } else { [0.0; 3] };
    }
    Ok(RayCast { depth_m, normals })
}
