//! Whether a surface is bent or doubled: where the poses of different key frames put the same piece of the true surface.
//!
//! In: each key frame with its final and its true pose. Out: for the true surface, in cells of 10 cm, how far along its normal the
//! key frames that see it put it in the mean (bent), and how far apart any two of them put it (doubled). No field averages
//! anything here, and no voxel hides two sheets.

use crate::MeasureError;
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{DepthImage, GrayImage};
use cairn_sim::{Renderer, SimConfig, World};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Pieces of a surface seen farther away count for nothing, metres: nor do they in the surface's completeness.
const SEEN_M: [f64; 2] = [0.4, 3.5];
/// Cells in a metre.
const CELLS: f64 = 10.0;
/// Two sheets this far apart are told as a doubled surface, metres.
pub const DOUBLED_M: f64 = 0.05;

/// A key frame: poses of its depth camera in the world, where the engine has it and where it truly was.
pub struct View {
    pub world_from_depth: Se3,
    pub truth: Se3,
}

/// How well key frames agree about the true surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Agreement {
    /// Root mean square distance of its pieces, as all that see them have them in the mean, metres.
    pub bent_m: f64,
    /// Root mean square, over its pieces, of the greatest distance between two that see one, metres.
    pub apart_m: f64,
    /// Share of its pieces that two put more than [`DOUBLED_M`] apart.
    pub doubled: f64,
}

/// What key frames make of a piece of the surface: sum, number, least and greatest distance along the normal.
#[derive(Clone, Copy)]
struct Piece {
    sum: f64,
    count: f64,
    range: [f64; 2],
}

/// Agreement of key frames in a simulated world.
///
/// # Errors
/// A camera that cannot be rendered.
pub fn agreement(config: &SimConfig, world: &Arc<World>, views: &[View]) -> Result<Agreement, MeasureError> {
    let camera = config.camera;
    let mut renderer = Renderer::new(world, camera)?;
    let (mut image, mut depth) =
        (GrayImage::new(camera.width, camera.height), DepthImage::new(camera.width, camera.height));
    let mut pieces: BTreeMap<[i32; 6], Piece> = BTreeMap::new();
    for view in views {
        renderer.render(&view.truth, &mut image, Some(&mut depth));
        let at = |u: usize, v: usize| {
            let z = f64::from(depth.data()[v * camera.width + u]) * 1e-3;
            let ray = Vec3::new((u as f64 - camera.cx) / camera.fx, (v as f64 - camera.cy) / camera.fy, 1.0);
            (SEEN_M[0]..SEEN_M[1]).contains(&z).then(|| ray * z)
        };
        let moved = view.world_from_depth * view.truth.inverse();
        let mut once: BTreeMap<[i32; 6], f64> = BTreeMap::new();
        for v in (6..camera.height - 6).step_by(6) {
            for u in (6..camera.width - 6).step_by(6) {
                let Some((p, normal)) = piece(at, u, v) else { continue };
                let (p, normal) = (view.truth * p, view.truth.rotation * normal);
                let [x, y, z] = [p.x, p.y, p.z].map(|v| (v * CELLS).floor() as i32);
                let [i, j, k] = [normal.x, normal.y, normal.z].map(|v| (2.0 * v).round() as i32);
                once.entry([x, y, z, i, j, k]).or_insert(normal.dot(&(moved * p - p)));
            }
        }
        for (cell, off) in once {
            let all = pieces.entry(cell).or_insert(Piece { sum: 0.0, count: 0.0, range: [off; 2] });
            (all.sum, all.count) = (all.sum + off, all.count + 1.0);
            all.range = [all.range[0].min(off), all.range[1].max(off)];
        }
    }
    let n = f64::max(pieces.len() as f64, 1.0);
    let apart = |p: &Piece| p.range[1] - p.range[0];
    let mean = |of: &dyn Fn(&Piece) -> f64| pieces.values().map(of).sum::<f64>() / n;
    Ok(Agreement {
        bent_m: mean(&|p| (p.sum / p.count).powi(2)).sqrt(),
        apart_m: mean(&|p| apart(p).powi(2)).sqrt(),
        doubled: mean(&|p| f64::from(u8::from(apart(p) > DOUBLED_M))),
    })
}

/// A point of a depth image and its normal, where it and four around it lie on one plane, to a centimetre.
fn piece(at: impl Fn(usize, usize) -> Option<Vec3>, u: usize, v: usize) -> Option<(Vec3, Vec3)> {
    let p = at(u, v)?;
    let [left, right, up, down] = [at(u - 3, v)?, at(u + 3, v)?, at(u, v - 3)?, at(u, v + 3)?];
    let normal = (right - left).cross(&(down - up)).try_normalize(1e-9)?;
    let flat = [left, right, up, down].iter().all(|q| (q - p).dot(&normal).abs() < 0.01);
    flat.then_some((p, normal))
}
