//! A monocular camera that turns on the spot and has lost its map: rotation carries the orientation from frame to frame.

use super::Tracker;
use super::scale::TURNED_RAD;
use crate::rotation::{Between, SHARE, rotation_between};
use crate::state::{Evidence, Last, State, Tracked, anchored_at};
use cairn_adjust::MotionSince;
use cairn_atlas::Snapshot;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use nalgebra::{Matrix6, SVector, Vector6};
use std::sync::Arc;

/// Seconds between two frames up to which one is tracked from the other.
const GAP_S: f64 = 0.3;
/// Seconds for which rotation alone may carry the pose.
const LONGEST_S: f64 = 8.0;
/// Seconds over which the frames must differ by a rotation alone, too: a person who walks on moves a few centimetres
/// from one frame to the next, which far points do not show, but a third of a metre in this time.
const CHECK_S: f64 = 0.3;

/// Variance of a translation of which nothing is known, in the map's unit squared.
const ANYWHERE_M2: f64 = 1e6;
/// How well the gyroscope tells how far the camera has turned in its pictures where the lens is a guess: radians, and per radian.
const TURNED_BY_GYRO: [f64; 2] = [0.005, 0.05];

impl Tracker {
    /// By how much the camera has turned between two key frames, by the gyroscope, once its clock is known; nothing of how far it has
    /// moved. A map that has no scale by the readings yet would else bend where it turns, and take the bend for a near wall.
    pub(super) fn turned_since(&self, before: Stamp, stamp: Stamp) -> Option<MotionSince> {
        let turned = self.inertial.as_ref().filter(|_| self.flow.is_some())?.turned(before, stamp)?;
        let sigma = TURNED_BY_GYRO[0] + TURNED_BY_GYRO[1] * turned.angle();
        let since_from_now = Se3::new(turned, Vec3::zeros());
        Some(MotionSince { stamp: before, since_from_now, variance: [ANYWHERE_M2, sigma * sigma] })
    }

    /// Carries the orientation forward when the matches with the map are lost: the frame's pose by rotation alone, at
    /// the position of the last known pose. `None` when the frames do not differ by a rotation.
    pub(crate) fn track_rotation(&mut self, frame: &Arc<Frame>, snapshot: &Snapshot) -> Option<Tracked> {
        if self.lost_frames == 0 {
            self.rotation_check = None;
        }
        let last = self.last.as_ref().filter(|_| !self.camera.has_depth())?;
        let elapsed = frame.stamp - last.frame.stamp;
        let since_s = frame.stamp - self.located?;
        if !(0.0 < elapsed && elapsed <= GAP_S) || since_s > LONGEST_S {
            return None;
        }
        let turning = self.velocity.map_or_else(Vec3::zeros, |v| v.fixed_rows::<3>(3).into_owned());
        let guess = So3::exp(&(turning * elapsed));
        let Between::Rotation { rotation: turn, inliers, matched } =
            rotation_between(&self.camera, &last.frame, frame, &guess, SHARE)
        else {
            return None;
        };
        let pose = last.anchored.world_from_camera;
        let rotation = pose.rotation * turn;
        let checked = match self.rotation_check.clone() {
            // Rotation alone begins: later frames are compared with the previous one.
            None => (last.frame.clone(), pose.rotation),
            Some((checked, at)) if frame.stamp - checked.stamp < CHECK_S => (checked, at),
            Some((checked, at)) => {
                let guess = at.inverse() * rotation;
                let Between::Rotation { .. } = rotation_between(&self.camera, &checked, frame, &guess, SHARE)
                else {
                    return None;
                };
                (frame.clone(), rotation)
            }
        };
        let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
        let anchored = anchored_at(snapshot, reference, Se3::new(rotation, pose.translation))?;
        self.rotation_check = Some(checked);
        self.lost = true;
        self.lost_frames += 1;
        let mut velocity = SVector::<f64, 6>::zeros();
        velocity.fixed_rows_mut::<3>(3).copy_from(&(turn.log() / elapsed));
        self.velocity = Some(velocity);
        self.last = Some(Last { frame: frame.clone(), landmarks: vec![None; frame.len()], anchored });
        self.turned_until = Some(frame.stamp);
        self.keep_unsupported(frame.stamp, anchored);
        let sigma = self.on_the_spot_sigma(since_s);
        let variances = Vector6::from_fn(|i, _| [sigma, TURNED_RAD][i / 3].powi(2));
        Some(Tracked {
            stamp: frame.stamp,
            state: State::RotationOnly { since_s, sigma },
            pose: Some(anchored),
            covariance: Some(Matrix6::from_diagonal(&variances)),
            evidence: Evidence { features: frame.len(), expected: 0, matched, inliers },
            request: None,
            earlier: Vec::new(),
            scale_supported: false,
            seen: Vec::new(),
        })
    }
}
