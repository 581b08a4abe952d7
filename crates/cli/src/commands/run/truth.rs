//! A run against the ground truth of its source, as it was given and stretch by stretch; [`Poses::accuracy`] has the whole.

use super::poses::Poses;
use cairn_engine::{Engine, PoseTime, ScaleStretch};
use cairn_eval::{Align, EvalOptions, LiveReport, PairError, Percentiles, ScaleReport, evaluate};
use cairn_geometry::{Se3, Trajectory};
use cairn_sensor::Stamp;

/// Alignment by Sim3 where the scale is not metric.
fn options(metric: bool) -> EvalOptions {
    EvalOptions { align: if metric { Align::Se3 } else { Align::Sim3 }, ..EvalOptions::default() }
}

fn trajectory(poses: &[(Stamp, Se3)]) -> Option<Trajectory> {
    Trajectory::from_unsorted(poses.iter().map(|(t, pose)| (t.0, *pose)).collect()).ok()
}

/// A jump of the live trajectory worth counting, metres.
pub const JUMP_M: f64 = 0.1;

/// The trajectory as it was estimated at the time, against the ground truth.
pub fn live(truth: &[(Stamp, Se3)], poses: &Poses) -> Option<LiveReport> {
    let e = poses.accuracy(truth)?;
    let error = |p: &PairError| p.estimate - p.reference;
    let changes: Vec<f64> = e.errors.windows(2).map(|w| (error(&w[1]) - error(&w[0])).norm()).collect();
    let steps = Percentiles::of(&changes)?;
    let jumps = changes.iter().filter(|step| **step > JUMP_M).count();
    Some(LiveReport { ate_m: e.ate_m.rmse, jump_p99_m: steps.p99, jump_max_m: steps.max, jumps })
}

/// The stretches of the run in one unit of length, each compared with the ground truth by itself.
pub fn scale(truth: &[(Stamp, Se3)], engine: &Engine) -> Vec<ScaleReport> {
    let of_camera = engine.camera_poses(PoseTime::Corrected);
    let (reference, poses) = (trajectory(&of_camera.comparable(truth)), of_camera.trajectory());
    let (snapshot, camera) = (engine.snapshot(), engine.front_end().model());
    let report = |s: ScaleStretch| {
        let own: Vec<(Stamp, Se3)> =
            poses.iter().filter(|(t, _)| (s.from..=s.to).contains(t)).copied().collect();
        let compared = reference.as_ref().zip(trajectory(&own));
        let sim3 = compared.as_ref().and_then(|(r, e)| evaluate(r, e, &options(false)).ok());
        let se3 = compared.and_then(|(r, e)| evaluate(r, &e, &options(true)).ok());
        let ate_m = if s.scale.metric { &se3 } else { &sim3 };
        ScaleReport {
            map: s.scale.map.root().index(),
            from_s: s.from.seconds(),
            to_s: s.to.seconds(),
            poses: s.poses,
            metric: s.scale.metric,
            sigma_log: s.scale.sigma_log,
            metres_sigma_log: snapshot.scale_of(s.scale.map, camera).metric_sigma(),
            supported: s.scale.supported,
            ate_m: ate_m.as_ref().map(|e| e.ate_m.rmse),
            metres_per_unit: sim3.map(|e| e.scale),
            metres_by_imu: None,
        }
    };
    engine.scale_stretches().into_iter().map(report).collect()
}
