//! A monocular camera that turns on the spot and has lost its map: rotation carries the orientation from frame to frame.

use super::scale::TURNED_RAD;
use super::{Now, Tracker};
use crate::rotation::{Between, Conclusion, rotation_between};
use crate::state::{Evidence, Last, State, Tracked, anchored_at};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_vision::Frame;
use nalgebra::{Matrix6, Vector6};

/// Seconds between two frames up to which one is tracked from the other.
const GAP_S: f64 = 0.3;
/// Seconds for which rotation alone may carry the pose.
const LONGEST_S: f64 = 8.0;
/// Seconds over which the frames must differ by a rotation alone, too: a person who walks on moves a few centimetres
/// from one frame to the next, which far points do not show, but a third of a metre in this time.
const CHECK_S: f64 = 0.3;

impl Tracker {
    /// Carries the orientation forward when the matches with the map are lost: the frame's pose by rotation alone, at
    /// the position of the last known pose. `None` when the frames do not differ by a rotation.
    pub(crate) fn track_rotation(&mut self, now: &Now) -> Option<Tracked> {
        let Now { frame, snapshot, .. } = *now;
        let last = self.last.as_ref().filter(|_| !self.setup.camera.has_depth())?;
        let elapsed = frame.stamp - last.frame.stamp;
        let since_s = frame.stamp - self.clock.located?;
        if !(0.0 < elapsed && elapsed <= GAP_S) || since_s > LONGEST_S {
            return None;
        }
        let turning = self.priors.velocity.turning().unwrap_or(Vec3::zeros());
        let guess = So3::exp(&(turning * elapsed));
        let camera = &self.setup.camera;
        let turned_from = |before: &Frame, guess: &So3| match rotation_between(
            camera,
            before,
            frame,
            guess,
            Conclusion::Turned,
        ) {
            Between::Rotation { rotation, inliers, matched } => Some((rotation, inliers, matched)),
            Between::Parallax | Between::TooFew => None,
        };
        let (turn, inliers, matched) = turned_from(&last.frame, &guess)?;
        let pose = last.anchored.world_from_camera;
        let rotation = pose.rotation * turn;
        let checked = match self.mode.checked().cloned() {
            // Rotation alone begins: later frames are compared with the previous one.
            None => (last.frame.clone(), pose.rotation),
            Some((checked, at)) if frame.stamp - checked.stamp < CHECK_S => (checked, at),
            Some((checked, at)) => {
                turned_from(&checked, &(at.inverse() * rotation))?;
                (frame.clone(), rotation)
            }
        };
        let anchored =
            anchored_at(snapshot, last.reference(snapshot)?, Se3::new(rotation, pose.translation))?;
        self.mode.rotate(checked);
        self.priors.velocity.turns(turn.log() / elapsed);
        self.last = Some(Last::without_landmarks(frame.clone(), anchored));
        self.unit.turned_on_the_spot(frame.stamp, anchored);
        let sigma = self.unit.on_the_spot_sigma(since_s);
        let variances = Vector6::from_fn(|i, _| [sigma, TURNED_RAD][i / 3].powi(2));
        let state = State::RotationOnly { since_s, sigma };
        let evidence = Evidence { features: frame.len(), expected: 0, matched, inliers };
        Some(Tracked {
            pose: Some(anchored),
            covariance: Some(Matrix6::from_diagonal(&variances)),
            scale_supported: false,
            ..Tracked::without_pose(frame.stamp, state, evidence)
        })
    }
}
