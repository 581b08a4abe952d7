//! Poses as numbers, as messages hold them.

use cairn_atlas::KeyFrameId;
use cairn_geometry::{Se3, So3, Vec3};
use serde::{Deserialize, Serialize};

/// A pose that is anchored to a key frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Anchored {
    /// The key frame's index.
    pub reference: u32,
    /// `reference_from_camera`: quaternion (x y z w) and translation.
    pub reference_from_camera: [f64; 7],
    /// `world_from_camera`, likewise.
    pub world_from_camera: [f64; 7],
}

impl Anchored {
    /// From the engine's.
    pub fn of(pose: &cairn_engine::AnchoredPose) -> Self {
        Self {
            reference: pose.reference.index() as u32,
            reference_from_camera: numbers(&pose.reference_from_camera),
            world_from_camera: numbers(&pose.world_from_camera),
        }
    }

    /// To the engine's; `None` when the numbers are no pose.
    pub fn pose(&self) -> Option<cairn_engine::AnchoredPose> {
        Some(cairn_engine::AnchoredPose {
            reference: KeyFrameId::from_index(self.reference as usize)?,
            reference_from_camera: se3(&self.reference_from_camera)?,
            world_from_camera: se3(&self.world_from_camera)?,
        })
    }
}

/// Quaternion (x y z w) and translation.
pub fn numbers(pose: &Se3) -> [f64; 7] {
    let (q, t) = (pose.rotation.quaternion(), pose.translation);
    [q.i, q.j, q.k, q.w, t.x, t.y, t.z]
}

/// Bit for bit what [`numbers`] was given.
pub fn se3(n: &[f64; 7]) -> Option<Se3> {
    let q = nalgebra::Quaternion::new(n[3], n[0], n[1], n[2]);
    let rotation = So3::from_quaternion(nalgebra::UnitQuaternion::new_unchecked(q));
    let pose = Se3::new(rotation, Vec3::new(n[4], n[5], n[6]));
    ((q.norm() - 1.0).abs() < 1e-6 && pose.is_finite()).then_some(pose)
}
