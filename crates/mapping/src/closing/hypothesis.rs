//! A loop or a merge that waits for another key frame to confirm it.

use crate::triangulation::median_depth;
use cairn_atlas::{KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Sim3;

/// A recognised place that waits for confirmation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hypothesis {
    pub(super) key_frame: KeyFrameId,
    pub(super) old: KeyFrameId,
    /// Correction from the current estimate to the pose relative to the earlier visit.
    pub(super) shift: Sim3,
}

impl Hypothesis {
    /// Whether it confirms a correction of another key frame, near its own in time: both need the same.
    pub(super) fn agrees(&self, snapshot: &Snapshot, here: &KeyFrame, old: KeyFrameId, shift: &Sim3) -> bool {
        let map = |id| snapshot.key_frame(id).map(|k| k.map);
        if self.key_frame == here.id || map(self.old) != map(old) || map(self.key_frame) != Some(here.map) {
            return false;
        }
        if here.id.index().abs_diff(self.key_frame.index()) > 8 {
            return false;
        }
        let (a, b) =
            (*shift * here.world_from_camera.translation, self.shift * here.world_from_camera.translation);
        let turned = (shift.rotation.inverse() * self.shift.rotation).angle();
        let depth = median_depth(snapshot, here).unwrap_or(0.0);
        (a - b).norm() < 0.1 * depth * shift.scale
            && turned < 0.1
            && (shift.scale / self.shift.scale).ln().abs() < 0.15
    }
}
