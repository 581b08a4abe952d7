//! The trajectory of a run against ground truth.

use crate::Error;
use cairn_engine::{Engine, PoseTime};
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
    let trajectory = |poses: &[(Stamp, Se3)]| {
        Trajectory::from_unsorted(poses.iter().map(|(t, pose)| (t.0, *pose)).collect())
    };
    let poses = engine.camera_poses(PoseTime::Corrected);
    let align = if poses.is_metric() { Align::Se3 } else { Align::Sim3 };
    let options = EvalOptions { align, ..EvalOptions::default() };
    let (reference, estimate) = (trajectory(&poses.comparable(truth))?, trajectory(&poses.trajectory())?);
    let mut found = evaluate(&reference, &estimate, &options)?;
    let log = engine.log();
    found.coverage = Some(log.tracked() as f64 / log.frames().len().max(1) as f64);
    Ok(found)
}
