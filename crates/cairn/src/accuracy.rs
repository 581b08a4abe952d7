//! The trajectory of a run against ground truth.

use crate::Error;
use cairn_engine::Engine;
use cairn_eval::{Align, EvalOptions, Evaluation, evaluate};
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::Stamp;

/// Absolute and relative error and coverage of an engine's trajectory against true poses `world_from_body`: aligned by
/// SE3, or by Sim3 where lengths are not metres.
///
/// # Errors
/// [`Error::Trajectory`] when the truth has two poses at one time or a number that is not finite, [`Error::Evaluation`]
/// when no times agree or the poses do not determine an alignment.
pub fn accuracy(engine: &Engine, truth: &[(Stamp, Se3)]) -> Result<Evaluation, Error> {
    let trajectory = |poses: &[(Stamp, Se3)]| {
        Trajectory::from_unsorted(poses.iter().map(|(t, pose)| (t.0, *pose)).collect())
    };
    let align = if engine.is_metric() { Align::Se3 } else { Align::Sim3 };
    let options = EvalOptions { align, ..EvalOptions::default() };
    let (reference, estimate) = (trajectory(&engine.comparable(truth))?, trajectory(&engine.trajectory())?);
    Ok(evaluate(&reference, &estimate, &options)?)
}
