//! A picture of a whole mesh from above, for people: shaded by its normals, coloured by height.

use super::{Mesh, draw};
use crate::DenseError;
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::{Camera, Image};

/// How far the view looks down, radians.
const DOWN_RAD: f64 = 0.95;
/// Colours of the lowest and the highest surface.
const LOW: [f64; 3] = [92.0, 120.0, 150.0];
const HIGH: [f64; 3] = [236.0, 214.0, 168.0];

/// Draws a mesh as seen from above and a little from the side. Ceilings are seen from behind and therefore not drawn.
/// `up` is the direction away from the ground, in the frame of the mesh.
///
/// # Errors
/// A mesh without vertices, a direction that is zero or not finite, a size that no camera has.
pub fn overview(mesh: &Mesh, up: &Vec3, width: usize, height: usize) -> Result<Image<[u8; 3]>, DenseError> {
    let up = up.try_normalize(1e-9).filter(|u| u.iter().all(|v| v.is_finite()));
    let up = up.ok_or_else(|| DenseError::Pose("no direction is up".into()))?;
    let along = longest(mesh, &up).ok_or_else(|| DenseError::Pose("the mesh is empty".into()))?;
    // x to the right along the longest extent, z forward and down.
    let ahead = up.cross(&along);
    let forward = ahead * DOWN_RAD.cos() - up * DOWN_RAD.sin();
    let down = forward.cross(&along);
    let rotation = So3::from_matrix(&Mat3::from_columns(&[along, down, forward]));
    let f = 1.2 * width as f64;
    let camera = Camera::pinhole(width, height, f, f, 0.5 * width as f64 - 0.5, 0.5 * height as f64 - 0.5);
    let (pose, heights) = framed(mesh, &rotation, &camera, &up);
    let seen = draw(mesh, &camera, &pose)?;
    let light = (rotation.inverse() * (up + 0.5 * along - 0.4 * ahead)).normalize();
    let mut out: Image<[u8; 3]> = Image::new(width, height);
    for (v, row) in out.data_mut().chunks_exact_mut(width).enumerate() {
        for (u, pixel) in row.iter_mut().enumerate() {
            let z = f64::from(seen.depth_m.at(u, v));
            if z <= 0.0 {
                *pixel = [255; 3];
                continue;
            }
            let ray = Vec3::new((u as f64 - camera.cx) / camera.fx, (v as f64 - camera.cy) / camera.fy, 1.0);
            let h = up.dot(&(pose * (ray * z)));
            let share = ((h - heights[0]) / (heights[1] - heights[0]).max(1e-6)).clamp(0.0, 1.0);
            let n = seen.normals.at(u, v).map(f64::from);
            let lit = 0.45 + 0.55 * Vec3::new(n[0], n[1], n[2]).dot(&light).max(0.0);
            *pixel = std::array::from_fn(|k| {
                (lit * (LOW[k] + share * (HIGH[k] - LOW[k]))).clamp(0.0, 255.0) as u8
            });
        }
    }
    Ok(out)
}

fn points(mesh: &Mesh) -> impl Iterator<Item = Vec3> + '_ {
    mesh.positions.iter().map(|p| Vec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])))
}

/// The horizontal direction in which a mesh extends farthest: the first principal axis of its vertices.
fn longest(mesh: &Mesh, up: &Vec3) -> Option<Vec3> {
    let n = mesh.positions.len() as f64;
    if n < 1.0 {
        return None;
    }
    let mean = points(mesh).sum::<Vec3>() / n;
    let level = |p: Vec3| p - up * up.dot(&p);
    let scatter: Mat3 = points(mesh).map(|p| level(p - mean)).map(|d| d * d.transpose()).sum();
    let eigen = scatter.symmetric_eigen();
    let most = (0..3).max_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]))?;
    level(eigen.eigenvectors.column(most).into_owned()).try_normalize(1e-9)
}

/// A pose from which all vertices are in the picture, and the heights of the lowest and highest twentieth.
fn framed(mesh: &Mesh, rotation: &So3, camera: &Camera, up: &Vec3) -> (Se3, [f64; 2]) {
    let inverse = rotation.inverse();
    let seen: Vec<Vec3> = points(mesh).map(|p| inverse * p).collect();
    let low = seen.iter().fold(Vec3::repeat(f64::MAX), |a, p| a.inf(p));
    let high = seen.iter().fold(Vec3::repeat(f64::MIN), |a, p| a.sup(p));
    let middle = 0.5 * (low + high);
    // Far enough that each vertex is inside the narrower of the two angles.
    let back = |p: &Vec3| {
        let d = p - middle;
        let across = (d.x.abs() * camera.fx / camera.cx).max(d.y.abs() * camera.fy / camera.cy);
        1.04 * across - d.z
    };
    let away = seen.iter().map(back).fold(0.1, f64::max);
    let mut heights: Vec<f64> = points(mesh).step_by(7).map(|p| up.dot(&p)).collect();
    heights.sort_by(f64::total_cmp);
    let at = |share: f64| heights[((heights.len() - 1) as f64 * share) as usize];
    (Se3::new(*rotation, *rotation * (middle - Vec3::z() * away)), [at(0.05), at(0.95)])
}
