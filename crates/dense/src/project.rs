//! Voxels to homogeneous pixels: one addition per voxel, from a table shared by all blocks of an image.

use crate::block::{BlockKey, SIDE, VOXELS};
use crate::frame::DepthFrame;
use cairn_geometry::{Se3, Vec3};

/// Homogeneous pixel of each voxel relative to the block's first one: `u = (origin.u + u[i]) / (origin.z + z[i])`.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Offsets {
    /// Focal length times x plus principal point times z.
    pub u: [f32; VOXELS],
    /// The same for y.
    pub v: [f32; VOXELS],
    /// Depth.
    pub z: [f32; VOXELS],
}

/// Blocks to homogeneous pixels, for one image and pose.
pub(crate) struct Projection {
    /// Rows u, v, z of camera matrix times rotation, per metre of the volume.
    rows: [Vec3; 3],
    /// The volume's origin.
    origin: Vec3,
    voxel_m: f64,
}

impl Projection {
    pub fn new(frame: &DepthFrame, volume_from_camera: &Se3, voxel_m: f64) -> Self {
        let camera_from_volume = volume_from_camera.inverse();
        let (r, t) = (camera_from_volume.rotation.matrix(), camera_from_volume.translation);
        let c = frame.camera();
        // Half a pixel is added so that truncation rounds to the nearest pixel.
        let row = |f: f64, centre: f64, i: usize| (r.row(i) * f + r.row(2) * (centre + 0.5)).transpose();
        let rows = [row(c.fx, c.cx, 0), row(c.fy, c.cy, 1), r.row(2).transpose()];
        let origin = Vec3::new(c.fx * t.x + (c.cx + 0.5) * t.z, c.fy * t.y + (c.cy + 0.5) * t.z, t.z);
        Self { rows, origin, voxel_m }
    }

    /// Half of a voxel's extent along the optical axis, in metres.
    pub fn half_depth_m(&self) -> f64 {
        0.5 * self.voxel_m * self.rows[2].abs().sum()
    }

    /// Homogeneous pixel of a block's first voxel.
    pub fn origin(&self, key: BlockKey) -> [f32; 3] {
        let corner = key.corner_m(self.voxel_m) + Vec3::from_element(0.5 * self.voxel_m);
        std::array::from_fn(|i| (self.rows[i].dot(&corner) + self.origin[i]) as f32)
    }

    /// Homogeneous pixels of all voxels of a block, relative to its first.
    pub fn offsets(&self) -> Box<Offsets> {
        let mut out = Box::new(Offsets { u: [0.0; VOXELS], v: [0.0; VOXELS], z: [0.0; VOXELS] });
        for i in 0..VOXELS {
            let at = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)].map(|v| v as f64 * self.voxel_m);
            let [u, v, z] = std::array::from_fn(|k| self.rows[k].dot(&Vec3::from(at)) as f32);
            (out.u[i], out.v[i], out.z[i]) = (u, v, z);
        }
        out
    }
}
