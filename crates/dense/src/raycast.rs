//! Depth and normals of the surface as a camera at any pose would see it.
//!
//! Each ray starts at the nearest block in front of it (block projections are first drawn into squares of eight
//! pixels), advances by the distances it reads, and ends at the zero crossing: Newcombe et al., "KinectFusion" (ISMAR
//! 2011), section 3.3.

use crate::DenseError;
use crate::block::{BlockKey, SIDE, index};
use crate::sample::{Sampler, floor};
use crate::tsdf::{STEPS, TsdfVolume};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{Camera, Distortion, Image};

/// A rendered view.
#[derive(Clone, Debug, PartialEq)]
pub struct RayCast {
    /// Depth along the optical axis in metres; 0 where the ray meets no surface.
    pub depth_m: Image<f32>,
    /// Unit normals in the camera frame, towards the camera; zero where the ray meets no surface.
    pub normals: Image<[f32; 3]>,
}

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
    let mut out = RayCast {
        depth_m: Image::new(camera.width, camera.height),
        normals: Image::new(camera.width, camera.height),
    };
    let tiles = Tiles::new(volume, camera, volume_from_camera, farthest_m as f32);
    let caster = Caster::new(volume, volume_from_camera);
    let lens = (camera.distortion != Distortion::None).then_some(camera);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let Some([near, far]) = tiles.range(x, y) else { continue };
            let ray = match lens {
                None => [(x as f64 - camera.cx) / camera.fx, (y as f64 - camera.cy) / camera.fy],
                Some(lens) => match lens.unproject(&Vec2::new(x as f64, y as f64)).filter(|r| r.z > 0.1) {
                    Some(r) => [r.x / r.z, r.y / r.z],
                    None => continue,
                },
            };
            if let Some((depth, normal)) = caster.cast(ray.map(|v| v as f32), near, far) {
                out.depth_m.row_mut(y)[x] = depth;
                out.normals.row_mut(y)[x] = normal;
            }
        }
    }
    Ok(out)
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

struct Caster<'a> {
    sampler: Sampler<'a>,
    /// Camera axes in the volume, by column, and its centre.
    axes: [[f32; 3]; 3],
    centre: [f32; 3],
    voxel_m: f32,
    band_m: f32,
}

impl<'a> Caster<'a> {
    fn new(volume: &'a TsdfVolume, pose: &Se3) -> Self {
        let r = pose.rotation.matrix();
        Self {
            sampler: Sampler::new(volume),
            axes: std::array::from_fn(|k| std::array::from_fn(|i| r[(i, k)] as f32)),
            centre: pose.translation.map(|v| v as f32).into(),
            voxel_m: volume.config().voxel_m as f32,
            band_m: volume.band_m() as f32,
        }
    }

    /// Depth and normal where the ray with depth 1 at `(x, y)` meets the surface from the front.
    fn cast(&self, [x, y]: [f32; 2], near: f32, far: f32) -> Option<(f32, [f32; 3])> {
        let ray: [f32; 3] =
            std::array::from_fn(|i| self.axes[0][i] * x + self.axes[1][i] * y + self.axes[2][i]);
        let along = |z: f32| -> [f32; 3] { std::array::from_fn(|i| self.centre[i] + ray[i] * z) };
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
            let t = (wall - self.centre[i]) / ray[i];
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
        let turned: [f32; 3] = std::array::from_fn(|k| (0..3).map(|i| self.axes[k][i] * g[i]).sum());
        let length = turned.iter().map(|v| v * v).sum::<f32>().sqrt();
        (length > 0.0).then(|| (z, turned.map(|v| v / length)))
    }
}
