//! What the path recorder is offered of a frame: where the mapping wing hands over to the walking wing.

use crate::Output;
use cairn_geometry::{Pose, Se3};
use cairn_guide::{Anchor, Confidence, RecordInput};
use cairn_tracking::State;

/// The frame's pose with its anchor and how far to trust it; a frame without a pose is offered as lost.
///
/// As long as tracking has no smooth frame of its own, the pose as it was given at the time stands for `odom`.
pub fn record_input(output: &Output) -> RecordInput {
    let lost = RecordInput {
        stamp: output.stamp,
        odom_from_camera: Pose::new(Se3::identity()),
        anchor: Anchor { robot: 0, seq: 0 },
        anchor_from_camera: Se3::identity(),
        confidence: Confidence::Lost,
        quality: 0.0,
    };
    let Some(anchored) = output.anchored else { return lost };
    let evidence = &output.evidence;
    RecordInput {
        odom_from_camera: Pose::new(anchored.world_from_camera),
        // Indices fit in 32 bits; there is one robot so far.
        anchor: Anchor { robot: 0, seq: anchored.reference.index() as u32 },
        anchor_from_camera: anchored.reference_from_camera,
        confidence: match output.state {
            State::Coasting { .. } => Confidence::Low,
            _ => Confidence::Good,
        },
        // A start has no matches yet; its depth or its two views are its evidence.
        quality: match evidence.matched {
            0 => 1.0,
            matched => (evidence.inliers as f32 / matched as f32).clamp(0.0, 1.0),
        },
        ..lost
    }
}
