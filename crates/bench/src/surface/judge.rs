//! A surface against the world's true one: distances of its vertices to the world's faces, and how much of what was seen it has.

use crate::MeasureError;
use cairn_dense::Mesh;
use cairn_geometry::{Se3, Sim3, Vec3, umeyama};
use cairn_sensor::{DepthImage, GrayImage, Stamp};
use cairn_sim::{Renderer, SimConfig, SimSource};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Figures of a surface.
#[derive(Clone, Copy, Default)]
pub struct Figures {
    pub mean_mm: f64,
    pub most_mm: f64,
    pub far: f64,
    pub complete: f64,
    pub trajectory_mm: f64,
}

pub fn aligned(poses: &BTreeMap<Stamp, Se3>, truth: &BTreeMap<Stamp, Se3>) -> Result<Sim3, MeasureError> {
    let (target, from) = positions(poses, truth);
    Ok(umeyama(&target, &from, false)?)
}

/// By what share of its lengths a map is too large, by the trajectory.
pub fn too_large(poses: &BTreeMap<Stamp, Se3>, truth: &BTreeMap<Stamp, Se3>) -> Result<f64, MeasureError> {
    let (target, from) = positions(poses, truth);
    Ok(1.0 / umeyama(&target, &from, true)?.scale - 1.0)
}

/// True positions, and those of a trajectory.
fn positions(poses: &BTreeMap<Stamp, Se3>, truth: &BTreeMap<Stamp, Se3>) -> (Vec<Vec3>, Vec<Vec3>) {
    poses.iter().filter_map(|(t, p)| Some((truth.get(t)?.translation, p.translation))).unzip()
}

pub fn engine_rms(poses: &BTreeMap<Stamp, Se3>, truth: &BTreeMap<Stamp, Se3>, place: &Sim3) -> f64 {
    let errors = poses
        .iter()
        .filter_map(|(t, p)| Some((*place * p.translation - truth.get(t)?.translation).norm_squared()));
    let (sum, n) = errors.fold((0.0, 0.0), |(s, n), e| (s + e, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

/// Points of the true surface that the walk saw, one in each cell of 5 cm.
pub fn seen(
    config: &SimConfig,
    source: &SimSource,
    body_from_depth: &Se3,
    truth: &BTreeMap<Stamp, Se3>,
) -> Result<Vec<Vec3>, MeasureError> {
    let camera = config.camera;
    let mut renderer = Renderer::new(source.world(), camera)?;
    let (mut image, mut depth) =
        (GrayImage::new(camera.width, camera.height), DepthImage::new(camera.width, camera.height));
    let mut cells = BTreeSet::new();
    let mut out = Vec::new();
    for pose in truth.values().step_by(10) {
        let pose = *pose * *body_from_depth;
        renderer.render(&pose, &mut image, Some(&mut depth));
        for i in (0..depth.data().len()).step_by(37) {
            let z = f64::from(depth.data()[i]) * 1e-3;
            if !(0.4..3.5).contains(&z) {
                continue;
            }
            let (u, v) = ((i % camera.width) as f64, (i / camera.width) as f64);
            let p = pose * Vec3::new((u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z);
            if cells.insert([p.x, p.y, p.z].map(|v| (v * 20.0).floor() as i32)) {
                out.push(p);
            }
        }
    }
    Ok(out)
}

pub fn report(
    name: &str,
    mesh: &Mesh,
    place: &Sim3,
    world: &Arc<cairn_sim::World>,
    seen: &[Vec3],
    ate_m: f64,
) -> Figures {
    let vertices: Vec<Vec3> = mesh
        .positions
        .iter()
        .map(|p| *place * Vec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2])))
        .collect();
    let cell = |p: &Vec3| [p.x, p.y, p.z].map(|v| (v * 20.0).floor() as i32);
    let mut cells: BTreeMap<[i32; 3], Vec<Vec3>> = BTreeMap::new();
    vertices.iter().for_each(|p| cells.entry(cell(p)).or_default().push(*p));
    let covered = seen.iter().filter(|p| {
        let c = cell(p);
        let mut around = (0..27).map(|i| [c[0] + i % 3 - 1, c[1] + i / 3 % 3 - 1, c[2] + i / 9 - 1]);
        around.any(|k| cells.get(&k).is_some_and(|all| all.iter().any(|q| (q - *p).norm() < 0.05)))
    });
    let covered = covered.count() as f64 / seen.len().max(1) as f64;
    let mut errors: Vec<f64> = vertices.iter().step_by(3).map(|p| world.distance_to_surface(p)).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let at = |share: f64| errors.get((errors.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let doubled = errors.iter().filter(|e| **e > 0.05).count() as f64 / errors.len().max(1) as f64;
    println!(
        "{name}: mean {:.1} mm, median {:.1}, 95 % {:.1} mm, {:.2} % farther than 5 cm; complete {:.1} %; {} vertices; trajectory {:.1} mm",
        mean * 1e3,
        at(0.5) * 1e3,
        at(0.95) * 1e3,
        100.0 * doubled,
        100.0 * covered,
        vertices.len(),
        ate_m * 1e3
    );
    Figures {
        mean_mm: mean * 1e3,
        most_mm: at(0.95) * 1e3,
        far: 100.0 * doubled,
        complete: 100.0 * covered,
        trajectory_mm: ate_m * 1e3,
    }
}
