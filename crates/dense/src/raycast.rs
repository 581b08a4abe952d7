//! Depth and normals of the surface as a camera at any pose would see it.
//!
//! The field ends each ray where its trilinear interpolation is zero (Newcombe et al., "KinectFusion", ISMAR 2011, section
//! 3.3). For an ideal pinhole the triangles in view are drawn first, which tells every ray the cell that it ends in, and a
//! step of Newton's method finds the place in it. For a lens that distorts each ray starts at the nearest block in front of
//! it (block projections are first drawn into squares of eight pixels) and advances by the distances it reads.

use crate::backend::dispatch;
use crate::block::{BlockKey, SIDE, index};
use crate::mesh::{Cell, FirstCells, MeshConfig, Mesher};
use crate::sample::{Sampler, floor, interpolate};
use crate::tsdf::{STEPS, TsdfVolume};
use crate::{Backend, DenseError, RayCast};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{Camera, Distortion, Image};

/// Pixels along each side of a square.
const TILE: usize = 8;

/// Casts a ray through each pixel of a camera, up to the depth `farthest_m`.
///
/// # Errors
/// An invalid camera or pose.
pub fn raycast(
    volume: &TsdfVolume,
    camera: &Camera,
    volume_from_camera: &Se3,
    farthest_m: f64,
) -> Result<RayCast, DenseError> {
    camera.validate().map_err(|e| DenseError::Camera(e.to_string()))?;
    if !volume_from_camera.is_finite() {
        return Err(DenseError::Pose("a number is not finite".into()));
    }
    match camera.distortion {
        Distortion::None => from_drawn(volume, camera, volume_from_camera, farthest_m),
        _ => Ok(marched(volume, camera, volume_from_camera, farthest_m)),
    }
}

/// Every ray ends in the cell that its pixel was drawn with.
fn from_drawn(
    volume: &TsdfVolume,
    camera: &Camera,
    pose: &Se3,
    farthest_m: f64,
) -> Result<RayCast, DenseError> {
    let first = Mesher::new(MeshConfig::of_key_frames()).first_cells(volume, camera, pose, farthest_m)?;
    let mut out = RayCast {
        depth_m: Image::new(camera.width, camera.height),
        normals: Image::new(camera.width, camera.height),
    };
    let view = &View::new(volume, pose);
    let [by_fx, by_fy, cx, cy] = [1.0 / camera.fx, 1.0 / camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    let columns: Vec<f32> = (0..camera.width).map(|x| (x as f32 - cx) * by_fx).collect();
    let (first, columns) = (&first, &columns[..]);
    for y in 0..camera.height {
        let row = Row { y: (y as f32 - cy) * by_fy, from: y * camera.width, farthest_m: farthest_m as f32 };
        let (depths, normals) = (out.depth_m.row_mut(y), out.normals.row_mut(y));
        dispatch!(Backend::best(), end_row(
            view: &View, first: &FirstCells, columns: &[f32], row: Row, depths: &mut [f32], normals: &mut [[f32; 3]]
        ) -> ());
    }
    Ok(out)
}

/// A row of pixels.
#[derive(Clone, Copy)]
struct Row {
    /// Where its rays with depth 1 are.
    y: f32,
    /// Its first pixel.
    from: usize,
    farthest_m: f32,
}

/// Ends the rays of a row of pixels in their cells, several at a time.
#[inline(always)]
fn end_row(
    view: &View,
    first: &FirstCells,
    columns: &[f32],
    row: Row,
    depths: &mut [f32],
    normals: &mut [[f32; 3]],
) {
    let chunks = columns.chunks(LANES).zip(depths.chunks_mut(LANES).zip(normals.chunks_mut(LANES)));
    for (chunk, (columns, (depths, normals))) in chunks.enumerate() {
        let mut lanes = Lanes::default();
        for (i, &column) in columns.iter().enumerate() {
            let seen = first.at(row.from + chunk * LANES + i).filter(|&(_, z)| z <= row.farthest_m);
            if let Some((cell, z)) = seen {
                lanes.set(i, cell, column, z);
            }
        }
        let ended = view.end(&lanes, row.y);
        for (i, (depth, normal)) in depths.iter_mut().zip(normals).enumerate() {
            (*depth, *normal) = (ended[3][i], [ended[0][i], ended[1][i], ended[2][i]]);
        }
    }
}

/// Rays that end at a time.
const LANES: usize = 16;

/// Cells, and where rays enter them: one lane each; all zero where a ray ends nowhere.
#[derive(Default)]
struct Lanes {
    steps: [[f32; LANES]; 8],
    low: [[f32; LANES]; 3],
    column: [f32; LANES],
    z: [f32; LANES],
}

impl Lanes {
    #[inline(always)]
    fn set(&mut self, i: usize, cell: &Cell, column: f32, z: f32) {
        (0..8).for_each(|k| self.steps[k][i] = cell.steps[k]);
        (0..3).for_each(|k| self.low[k][i] = cell.low[k]);
        (self.column[i], self.z[i]) = (column, z);
    }
}

/// Every ray goes from the nearest block on.
fn marched(volume: &TsdfVolume, camera: &Camera, pose: &Se3, farthest_m: f64) -> RayCast {
    let mut out = RayCast {
        depth_m: Image::new(camera.width, camera.height),
        normals: Image::new(camera.width, camera.height),
    };
    let tiles = Tiles::new(volume, camera, pose, farthest_m as f32);
    let caster = Caster::new(volume, pose);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let Some([near, far]) = tiles.range(x, y) else { continue };
            let ray = camera.unproject(&Vec2::new(x as f64, y as f64)).filter(|r| r.z > 0.1);
            let Some(ray) = ray.map(|r| [r.x / r.z, r.y / r.z].map(|v| v as f32)) else { continue };
            if let Some((depth, normal)) = caster.cast(ray, near, far) {
                out.depth_m.row_mut(y)[x] = depth;
                out.normals.row_mut(y)[x] = normal;
            }
        }
    }
    out
}

/// The depth interval in which each square of pixels meets blocks.
struct Tiles {
    width: usize,
    ranges: Vec<[f32; 2]>,
}

impl Tiles {
    fn new(volume: &TsdfVolume, camera: &Camera, pose: &Se3, farthest_m: f32) -> Self {
        let (width, height) = (camera.width.div_ceil(TILE), camera.height.div_ceil(TILE));
        let mut tiles = Self { width, ranges: vec![[f32::INFINITY, 0.0]; width * height] };
        if camera.distortion != Distortion::None {
            tiles.ranges.fill([crate::view::NEAREST_M, farthest_m]);
            return tiles;
        }
        let projection = crate::view::Box2::new(camera, pose, SIDE as f64 * volume.config().voxel_m);
        for key in volume.changed_since(0) {
            let Some((x, y, [near, far])) = projection.of(key) else { continue };
            if near > farthest_m {
                continue;
            }
            for row in y[0] / TILE..=y[1] / TILE {
                for range in &mut tiles.ranges[row * width + x[0] / TILE..=row * width + x[1] / TILE] {
                    *range = [range[0].min(near), range[1].max(far.min(farthest_m))];
                }
            }
        }
        tiles
    }

    fn range(&self, x: usize, y: usize) -> Option<[f32; 2]> {
        let range = self.ranges[y / TILE * self.width + x / TILE];
        (range[0] < range[1]).then_some(range)
    }
}

/// A camera in a volume.
struct View {
    /// Camera axes in the volume, by column, and its centre.
    axes: [[f32; 3]; 3],
    centre: [f32; 3],
    voxel_m: f32,
}

impl View {
    fn new(volume: &TsdfVolume, pose: &Se3) -> Self {
        let r = pose.rotation.matrix();
        Self {
            axes: std::array::from_fn(|k| std::array::from_fn(|i| r[(i, k)] as f32)),
            centre: pose.translation.map(|v| v as f32).into(),
            voxel_m: volume.config().voxel_m as f32,
        }
    }

    /// The ray with depth 1 at `(x, y)`, along the axes of the volume.
    #[inline(always)]
    fn ray(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        std::array::from_fn(|i| self.axes[0][i] * x + self.axes[1][i] * y + self.axes[2][i])
    }

    /// A gradient as a unit normal in the camera frame; zero for zero.
    #[inline(always)]
    fn in_camera(&self, g: [f32; 3]) -> [f32; 3] {
        let n: [f32; 3] =
            std::array::from_fn(|k| self.axes[k][0] * g[0] + self.axes[k][1] * g[1] + self.axes[k][2] * g[2]);
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        n.map(|v| if length > 0.0 { v / length } else { 0.0 })
    }

    /// Normal and depth of the zero crossing in a cell next to a depth, by lanes. Where the field is not crossed from the front
    /// there, or the crossing is more than a voxel away (at a silhouette or a seam), the depth stays, and the normal is that in the
    /// middle of the cell, turned to the camera.
    #[inline(always)]
    fn end(&self, lanes: &Lanes, row: f32) -> [[f32; LANES]; 4] {
        let mut out = [[0.0; LANES]; 4];
        let by_voxel = 1.0 / self.voxel_m;
        for i in 0..LANES {
            let z = lanes.z[i];
            let ray = self.ray([lanes.column[i], row]);
            let at: [f32; 3] =
                std::array::from_fn(|k| (self.centre[k] + ray[k] * z) * by_voxel - lanes.low[k][i]);
            let steps: [f32; 8] = std::array::from_fn(|k| lanes.steps[k][i]);
            let sample = interpolate(&steps, at);
            let (g, middle) = (sample.gradient, interpolate(&steps, [0.5; 3]).gradient);
            // In steps per metre of depth.
            let slope = (g[0] * ray[0] + g[1] * ray[1] + g[2] * ray[2]) * by_voxel;
            let by = -sample.steps / slope;
            let crossed = (slope < 0.0) & (by.abs() < self.voxel_m);
            let away = middle[0] * ray[0] + middle[1] * ray[1] + middle[2] * ray[2] > 0.0;
            let facing = middle.map(|v| if away { -v } else { v });
            let normal = self.in_camera(std::array::from_fn(|k| if crossed { g[k] } else { facing[k] }));
            (0..3).for_each(|k| out[k][i] = normal[k]);
            out[3][i] = if crossed { z + by } else { z };
        }
        out
    }
}

struct Caster<'a> {
    sampler: Sampler<'a>,
    view: View,
    voxel_m: f32,
    band_m: f32,
}

impl<'a> Caster<'a> {
    fn new(volume: &'a TsdfVolume, pose: &Se3) -> Self {
        let view = View::new(volume, pose);
        let (voxel_m, band_m) = (view.voxel_m, volume.band_m() as f32);
        Self { sampler: Sampler::new(volume), view, voxel_m, band_m }
    }

    /// Depth and normal where the ray with depth 1 at `(x, y)` meets the surface from the front.
    fn cast(&self, ray: [f32; 2], near: f32, far: f32) -> Option<(f32, [f32; 3])> {
        let ray = self.view.ray(ray);
        let along = |z: f32| -> [f32; 3] { std::array::from_fn(|i| self.view.centre[i] + ray[i] * z) };
        let by_voxel = 1.0 / self.voxel_m;
        let mut z = near;
        let mut held: Option<(BlockKey, Option<u32>)> = None;
        // Depth and distance at the previous step, when it was in front of the surface.
        let mut before: Option<f32> = None;
        while z < far {
            let at = along(z).map(|v| floor(v * by_voxel));
            let key = BlockKey(at.map(|v| v >> 3));
            let slot = match held {
                Some((k, slot)) if k == key => slot,
                _ => self.sampler.slot(key),
            };
            held = Some((key, slot));
            let Some(slot) = slot else {
                before = None;
                z = self.leave(key, ray, z);
                continue;
            };
            let (sum, weight) = self.sampler.voxel(slot, index(at.map(|v| (v & 7) as usize)));
            if weight == 0 {
                before = None;
                z += self.voxel_m;
            } else if sum > 0 {
                before = Some(z);
                // Distances are along the optical axis of the cameras that saw the surface, so only part of one is
                // safe to advance.
                let metres = sum as f32 / (weight * STEPS) as f32 * self.band_m;
                z += (0.8 * metres).max(0.5 * self.voxel_m);
            } else if let Some(front) = before {
                return self.refine(along, front, z);
            } else {
                // Inside, coming from unseen space: continue to the other side.
                z += self.voxel_m;
            }
        }
        None
    }

    /// Depth where the ray leaves a block, plus a small margin.
    fn leave(&self, key: BlockKey, ray: [f32; 3], z: f32) -> f32 {
        let side = self.voxel_m * SIDE as f32;
        let mut out = f32::INFINITY;
        for i in 0..3 {
            let wall = (key.0[i] + i32::from(ray[i] > 0.0)) as f32 * side;
            let t = (wall - self.view.centre[i]) / ray[i];
            if t > z && t < out {
                out = t;
            }
        }
        (out + 1e-3 * self.voxel_m).max(z + 0.01 * self.voxel_m)
    }

    /// The zero crossing between two depths, in the trilinearly interpolated field.
    fn refine(&self, along: impl Fn(f32) -> [f32; 3], front: f32, back: f32) -> Option<(f32, [f32; 3])> {
        let (mut a, mut b) = (front, back + 0.5 * self.voxel_m);
        let (mut at_a, mut at_b) = (self.sampler.at(along(a))?, None);
        // The nearest voxel may be behind the surface while the interpolated field is not yet, and the other way
        // round.
        for back in [back, b, b + 0.5 * self.voxel_m] {
            match self.sampler.at(along(back)) {
                Some(s) if s.steps <= 0.0 => {
                    (b, at_b) = (back, Some(s));
                    break;
                }
                Some(s) => (a, at_a) = (back, s),
                None => return None,
            }
        }
        let mut at_b = at_b?;
        if at_a.steps <= 0.0 {
            a -= self.voxel_m;
            at_a = self.sampler.at(along(a)).filter(|s| s.steps > 0.0)?;
        }
        for _ in 0..2 {
            let z = a + (b - a) * (at_a.steps / (at_a.steps - at_b.steps));
            let s = self.sampler.at(along(z))?;
            if s.steps > 0.0 {
                (a, at_a) = (z, s);
            } else {
                (b, at_b) = (z, s);
            }
        }
        let share = at_a.steps / (at_a.steps - at_b.steps);
        let z = a + (b - a) * share;
        let g: [f32; 3] =
            std::array::from_fn(|i| at_a.gradient[i] + (at_b.gradient[i] - at_a.gradient[i]) * share);
        Some((z, self.view.in_camera(g)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TsdfConfig;
    use cairn_random::Random;

    #[test]
    fn rays_end_at_the_same_place_with_all_instructions() {
        let volume = TsdfVolume::new(TsdfConfig::default()).expect("a config");
        let view = &View::new(&volume, &Se3::identity());
        let mut random = Random::new(3);
        let mut number = |from: f64, to: f64| random.uniform(from, to) as f32;
        let cell = |i: usize| Cell {
            steps: std::array::from_fn(|_| number(-900.0, 900.0)),
            low: [(i % 37) as f32 * 0.3, 0.0, 50.0],
        };
        let cells: Vec<Cell> = (0..37).map(cell).collect();
        let columns = &(0..37).map(|x| x as f32 * 0.006).collect::<Vec<_>>()[..];
        let seen: Vec<f32> = (0..37).map(|i| if i % 7 == 3 { 0.0 } else { number(1.0, 1.03) }).collect();
        let first = &FirstCells::of(cells, &seen);
        let row = Row { y: 0.003, from: 0, farthest_m: 1.02 };
        let mut all = Vec::new();
        for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
            let (mut depths, mut normals) = (vec![9.0; 37], vec![[9.0; 3]; 37]);
            {
                let (depths, normals) = (&mut depths[..], &mut normals[..]);
                dispatch!(backend, end_row(
                    view: &View, first: &FirstCells, columns: &[f32], row: Row, depths: &mut [f32], normals: &mut [[f32; 3]]
                ) -> ());
            }
            all.push((depths, normals));
        }
        let (depths, normals) = &all[0];
        assert!(depths.iter().filter(|z| **z > 0.0).count() > 15 && depths.contains(&0.0));
        for (z, n) in depths.iter().zip(normals) {
            let length = n.iter().map(|v| v * v).sum::<f32>().sqrt();
            assert!((length - f32::from(u8::from(*z > 0.0))).abs() < 1e-5, "{z} {n:?}");
        }
        all[1..].iter().for_each(|other| assert_eq!(&all[0], other));
    }
}
