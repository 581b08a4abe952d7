//! Depth and normals of a surface from any pose, by rasterising its triangles: on dense surfaces several times as
//! fast as casting a ray for each pixel, and equal to within a fraction of a voxel.
//!
//! Inverse depth is linear over the image of a plane, so it is interpolated with the edge functions of Pineda, "A
//! parallel algorithm for polygon rasterization" (SIGGRAPH 1988).

use super::{Mesh, Mesher};
use crate::view::{Box2, NEAREST_M};
use crate::{DenseError, RayCast, TsdfVolume};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, Distortion, Image};

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
        let mesh = self.some(volume, keys.into_iter());
        draw(&mesh, camera, volume_from_camera)
    }
}

fn check(camera: &Camera, pose: &Se3) -> Result<(), DenseError> {
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

/// A vertex projected into the camera: pixel, inverse depth, normal.
#[derive(Clone, Copy)]
struct Seen {
    u: f32,
    v: f32,
    inverse: f32,
    normal: [f32; 3],
}

/// Renders a mesh as a pinhole camera would see it. Triangles seen from behind are not drawn.
///
/// # Errors
/// An invalid camera, or one whose lens distorts; a pose that is not finite.
pub fn draw(mesh: &Mesh, camera: &Camera, mesh_from_camera: &Se3) -> Result<RayCast, DenseError> {
    check(camera, mesh_from_camera)?;
    let from = mesh_from_camera.inverse();
    let r = from.rotation.matrix().map(|v| v as f32);
    let t = from.translation.map(|v| v as f32);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    let turn = |p: &[f32; 3], i: usize| r[(i, 0)] * p[0] + r[(i, 1)] * p[1] + r[(i, 2)] * p[2];
    let seen: Vec<Seen> = mesh
        .positions
        .iter()
        .zip(&mesh.normals)
        .map(|(p, n)| {
            let z = turn(p, 2) + t[2];
            let inverse = if z > NEAREST_M { 1.0 / z } else { 0.0 };
            let (x, y) = (turn(p, 0) + t[0], turn(p, 1) + t[1]);
            let normal = [turn(n, 0), turn(n, 1), turn(n, 2)];
            Seen { u: fx * x * inverse + cx, v: fy * y * inverse + cy, inverse, normal }
        })
        .collect();
    let (width, height) = (camera.width, camera.height);
    let mut nearest = vec![0.0f32; width * height];
    let mut normals = Image::new(width, height);
    for triangle in &mesh.triangles {
        draw_one(triangle.map(|i| &seen[i as usize]), [width, height], &mut nearest, normals.data_mut());
    }
    let depth = nearest.into_iter().map(|v| if v > 0.0 { 1.0 / v } else { 0.0 }).collect();
    let depth_m = Image::from_vec(width, height, depth).unwrap_or_else(|| Image::new(width, height));
    for n in normals.data_mut() {
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        *n = if length > 0.0 { n.map(|v| v / length) } else { [0.0; 3] };
    }
    Ok(RayCast { depth_m, normals })
}

#[inline(always)]
fn draw_one(
    [a, b, c]: [&Seen; 3],
    [width, height]: [usize; 2],
    nearest: &mut [f32],
    normals: &mut [[f32; 3]],
) {
    // A triangle that reaches behind the camera is not drawn.
    if a.inverse * b.inverse * c.inverse <= 0.0 {
        return;
    }
    // Seen from the front, triangles are clockwise in an image with y down, so this area is negative.
    let area = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
    if area >= 0.0 {
        return;
    }
    let low = |p: f32, q: f32, r: f32| p.min(q).min(r).max(0.0).ceil() as usize;
    let high = |p: f32, q: f32, r: f32, size: usize| (p.max(q).max(r).min(size as f32 - 1.0)).floor();
    let (x1, y1) = (high(a.u, b.u, c.u, width), high(a.v, b.v, c.v, height));
    if x1 < 0.0 || y1 < 0.0 {
        return;
    }
    let (x0, y0, x1, y1) = (low(a.u, b.u, c.u), low(a.v, b.v, c.v), x1 as usize, y1 as usize);
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
            if of_a < -1e-4 || of_b < -1e-4 || of_c < -1e-4 {
                continue;
            }
            let inverse = of_a * a.inverse + of_b * b.inverse + of_c * c.inverse;
            let at = y * width + x;
            if inverse > nearest[at] {
                nearest[at] = inverse;
                normals[at] =
                    std::array::from_fn(|k| of_a * a.normal[k] + of_b * b.normal[k] + of_c * c.normal[k]);
            }
        }
    }
}
