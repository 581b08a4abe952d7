//! Depth and normals of the surface as a camera at any pose would see it.
//!
//! The field ends each ray where its trilinear interpolation is zero (Newcombe et al., "KinectFusion", ISMAR 2011, section
//! 3.3). For an ideal pinhole the triangles in view are drawn first, which tells every ray the cell that it ends in, and a
//! step of Newton's method finds the place in it. For a lens that distorts each ray starts at the nearest block in front of
//! it (block projections are first drawn into squares of eight pixels) and advances by the distances it reads.

use crate::DenseError;
use crate::RayCast;
use crate::block::{BlockKey, SIDE, index};
use crate::mesh::{MeshConfig, Mesher};
use crate::sample::{Sampler, floor};
use crate::tsdf::{STEPS, TsdfVolume};
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

/// Every ray begins where its pixel was drawn.
fn from_drawn(
    volume: &TsdfVolume,
    camera: &Camera,
    pose: &Se3,
    farthest_m: f64,
) -> Result<RayCast, DenseError> {
    let mut out = Mesher::new(MeshConfig::of_key_frames()).view(volume, camera, pose, farthest_m)?;
    let caster = Caster::new(volume, pose);
    let [by_fx, by_fy] = [1.0 / camera.fx, 1.0 / camera.fy].map(|v| v as f32);
    let [cx, cy] = [camera.cx, camera.cy].map(|v| v as f32);
    for y in 0..camera.height {
        let (depths, normals) = (out.depth_m.row_mut(y), out.normals.row_mut(y));
        for (x, (depth, normal)) in depths.iter_mut().zip(normals).enumerate() {
            if *depth > farthest_m as f32 {
                (*depth, *normal) = (0.0, [0.0; 3]);
            }
            if *depth > 0.0 {
                let ray = [(x as f32 - cx) * by_fx, (y as f32 - cy) * by_fy];
                // At a silhouette or a seam the field may not say more than the triangle.
                (*depth, *normal) = caster.polish(ray, *depth).unwrap_or((*depth, *normal));
            }
        }
    }
    Ok(out)
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

    /// Depth and normal of the zero crossing next to a depth; `None` where the field is not seen there, not crossed from
    /// the front, or the crossing is more than a voxel away.
    #[inline]
    fn polish(&self, [x, y]: [f32; 2], z: f32) -> Option<(f32, [f32; 3])> {
        let ray: [f32; 3] =
            std::array::from_fn(|i| self.axes[0][i] * x + self.axes[1][i] * y + self.axes[2][i]);
        let sample = self.sampler.at(std::array::from_fn(|i| self.centre[i] + ray[i] * z))?;
        let g = sample.gradient;
        // In steps per metre of depth.
        let slope = (g[0] * ray[0] + g[1] * ray[1] + g[2] * ray[2]) / self.voxel_m;
        let by = -sample.steps / slope;
        if !(slope < 0.0 && by.abs() < self.voxel_m) {
            return None;
        }
        Some((z + by, self.in_camera(g)?))
    }

    /// A gradient as a unit normal in the camera frame.
    #[inline]
    fn in_camera(&self, g: [f32; 3]) -> Option<[f32; 3]> {
        let turned: [f32; 3] = std::array::from_fn(|k| (0..3).map(|i| self.axes[k][i] * g[i]).sum());
        let length = turned.iter().map(|v| v * v).sum::<f32>().sqrt();
        (length > 0.0).then(|| turned.map(|v| v / length))
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
        Some((z, self.in_camera(g)?))
    }
}
