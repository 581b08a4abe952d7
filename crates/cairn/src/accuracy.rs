//! The trajectory of a run against ground truth.

use crate::Error;
use cairn_engine::{CameraPoses, Engine, PoseTime};
use cairn_eval::{Align, EvalOptions, Evaluation, evaluate};
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::Stamp;

/// Absolute and relative error and coverage of an engine's trajectory against true poses `world_from_body`: aligned by
/// SE3, or by Sim3 and at the first camera where lengths are not metres.
///
/// # Errors
/// [`Error::Trajectory`] when the truth has two poses at one time or a number that is not finite, [`Error::Evaluation`]
/// when no times agree or the poses do not determine an alignment.
pub fn accuracy(engine: &Engine, truth: &[(Stamp, Se3)]) -> Result<Evaluation, Error> {
    let poses = engine.camera_poses(PoseTime::Corrected);
    accuracy_of(&poses, engine.log().frames().len(), &poses.body_from_frame(), truth)
}

/// The same of poses of so many frames, as poses of what is mounted at `body_from_frame`.
///
/// # Errors
/// As [`accuracy`].
pub fn accuracy_of(
    poses: &CameraPoses,
    frames: usize,
    body_from_frame: &Se3,
    truth: &[(Stamp, Se3)],
) -> Result<Evaluation, Error> {
    let trajectory = |poses: Vec<(Stamp, Se3)>| {
        Trajectory::from_unsorted(poses.into_iter().map(|(t, pose)| (t.0, pose)).collect())
    };
    let truth = truth.iter().map(|(t, body)| (*t, *body * *body_from_frame)).collect();
    let align = if poses.is_metric() { Align::Se3 } else { Align::Sim3 };
    let options = EvalOptions { align, ..EvalOptions::default() };
    let estimate = trajectory(poses.of_mounted(body_from_frame))?;
    let mut found = evaluate(&trajectory(truth)?, &estimate, &options)?;
    found.coverage = Some(poses.poses.len() as f64 / frames.max(1) as f64);
    Ok(found)
}
