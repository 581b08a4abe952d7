//! A pose in the numbers of a piece.

use super::super::about::pose;
use cairn_geometry::Se3;
use serde::{Deserialize, Serialize};

/// Steps of one in a quaternion.
const TURN: f64 = 1_048_576.0;

/// Rotation and position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Pose {
    rotation: [i32; 4],
    position: [f32; 3],
}

impl Pose {
    pub fn of(pose: &Se3) -> Self {
        let q = pose.rotation.quaternion();
        let sign = if q.w < 0.0 { -TURN } else { TURN };
        Self {
            rotation: [q.i, q.j, q.k, q.w].map(|v| (v * sign).round() as i32),
            position: std::array::from_fn(|i| pose.translation[i] as f32),
        }
    }

    /// As a pose; `None` where the numbers are none.
    pub fn pose(&self) -> Option<Se3> {
        let q = self.rotation.map(|v| f64::from(v) / TURN);
        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let [i, j, k, w] = q.map(|v| v / norm);
        let [x, y, z] = self.position.map(f64::from);
        pose([i, j, k, w, x, y, z])
    }
}
