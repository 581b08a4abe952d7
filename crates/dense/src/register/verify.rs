//! What two surfaces say of a pose: which points of one lie on the other, and which in space that the other saw to be
//! free.

use super::Surface;
use crate::Occupancy;
use crate::sample::Sampler;
use cairn_geometry::{Se3, Vec3};

/// Counts of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Seen {
    /// On the other surface.
    pub on: usize,
    /// In free space of the other.
    pub free: usize,
    /// All points, also those where the other has not looked.
    pub all: usize,
}

impl Seen {
    /// How much speaks for the pose.
    pub fn score(&self) -> i64 {
        self.on as i64 - 2 * self.free as i64
    }
}

/// Looks at points (with normals) of one surface in another.
pub(super) fn look(other: &Surface, sampler: &Sampler, points: &[(Vec3, Vec3)], pose: &Se3) -> Seen {
    let voxel = other.tsdf.config().voxel_m;
    let tolerance_m = (0.8 * other.tsdf.band_m()).min(super::ON_M.max(voxel));
    let mut out = Seen { all: points.len(), ..Seen::default() };
    for (p, n) in points {
        let at = *pose * *p;
        let Some(sample) = sampler.at([at.x as f32, at.y as f32, at.z as f32]) else {
            out.free += usize::from(other.occupancy.at(&at) == Occupancy::Free);
            continue;
        };
        let gradient = Vec3::from(sample.gradient.map(f64::from));
        let length = gradient.norm();
        let distance = f64::from(sample.steps) / length.max(32.0) * voxel;
        if distance.abs() <= tolerance_m {
            out.on += usize::from(gradient.dot(&(pose.rotation * *n)) > 0.5 * length);
        } else if distance > 0.0 {
            out.free += 1;
        }
    }
    out
}
