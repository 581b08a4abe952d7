//! The poses of a run as they are written and as they are compared with the ground truth: both are of the same thing.

use cairn_engine::CameraPoses;
use cairn_eval::{Evaluation, TrajectoryHeader};
use cairn_geometry::{Se3, Trajectory, TrajectoryError};
use cairn_sensor::Stamp;

/// Poses of the body; of the first camera where it is asked for or not all lengths are metres.
pub struct Poses {
    pub of_camera: CameraPoses,
    /// Where the first camera is on the body, if it is asked for.
    pub cam0: Option<Se3>,
    /// Frames with and without a pose.
    pub frames: usize,
}

impl Poses {
    fn body_from_frame(&self) -> Se3 {
        self.cam0.unwrap_or(self.of_camera.body_from_frame())
    }

    /// What they are of.
    pub fn header(&self) -> TrajectoryHeader {
        let metric = self.of_camera.is_metric();
        TrajectoryHeader {
            frame: if self.cam0.is_none() && metric { "body" } else { "cam0" }.into(),
            body_from_frame: self.body_from_frame(),
            metric,
            frames: Some(self.frames),
        }
    }

    /// Each once and in order.
    ///
    /// # Errors
    /// When two are of one time, or numbers are not finite.
    pub fn trajectory(&self) -> Result<Trajectory, TrajectoryError> {
        let poses = self.of_camera.of_mounted(&self.body_from_frame());
        Trajectory::from_unsorted(poses.into_iter().map(|(t, pose)| (t.0, pose)).collect())
    }

    /// Against true poses of the body: aligned by SE3, by Sim3 where lengths are not metres.
    pub fn accuracy(&self, truth: &[(Stamp, Se3)]) -> Option<Evaluation> {
        cairn::accuracy_of(&self.of_camera, self.frames, &self.body_from_frame(), truth).ok()
    }
}
