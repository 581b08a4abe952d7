//! The input of the path recorder for a frame: the interface between mapping and guidance.

use crate::{FramePose, Output};
use cairn_atlas::Snapshot;
use cairn_geometry::{Camera, Pose, Se3, World};
use cairn_guide::{Anchor, Confidence, RecordInput};
use cairn_tracking::State;

/// The frame's pose in the odometry frame and its unit, with its anchor and a confidence; a frame without a pose is
/// recorded as lost. The snapshot knows the lasting name of the key frame that it is anchored to; any version since that
/// key frame will do.
pub fn record_input(output: &Output, snapshot: &Snapshot) -> RecordInput {
    let lost = RecordInput {
        stamp: output.stamp,
        odom_from_camera: Pose::new(Se3::identity()),
        segment: 0,
        anchor: Anchor { robot: 0, seq: 0 },
        anchor_from_camera: Se3::identity(),
        confidence: Confidence::Lost,
        quality: 0.0,
    };
    let Some(FramePose { anchored, odometry, .. }) = output.pose else { return lost };
    let world_from_camera: Pose<World, Camera> = Pose::new(anchored.world_from_camera);
    let evidence = &output.evidence;
    let name = snapshot.key_frame_name(anchored.reference);
    RecordInput {
        odom_from_camera: odometry.world_from_odom.inverse().then(&world_from_camera),
        segment: odometry.segment,
        anchor: Anchor { robot: name.robot, seq: name.seq },
        anchor_from_camera: anchored.reference_from_camera,
        confidence: match output.state {
            State::Coasting { .. } | State::RotationOnly { .. } => Confidence::Low,
            _ => Confidence::Good,
        },
        // The first frame of a map has no matches yet; its depth or its two views are its evidence.
        quality: match evidence.matched {
            0 => 1.0,
            matched => (evidence.inliers as f32 / matched as f32).clamp(0.0, 1.0),
        },
        ..lost
    }
}
