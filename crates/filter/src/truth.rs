//! Judges a run by true poses, where a log has them.
//!
//! In: true poses with their times, and a finished run from a known start. Out: the error of its positions after a rigid alignment (ATE;
//! Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012), and the normalised estimation error squared of its
//! poses (NEES; Bar-Shalom, Li, Kirubarajan 2001, 5.4.2), for which the true pose at the start is the origin of the filter.

use crate::angle::wrap;
use crate::run::{Run, align};
use cairn_geometry::{Se2, Vec2};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// How far a run is from the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgement {
    /// Number of poses within the time of the truth.
    pub poses: usize,
    /// Root mean square error of their positions after a rigid alignment, in metres; `None` where they lie on a line.
    pub ate_m: Option<f64>,
    /// Mean of the normalised error squared of the poses at the snapshots, 3 is right; `None` where the truth begins after the run.
    pub nees: Option<f64>,
}

/// Judges a run by true poses (seconds, `world_from_body`), which need not be in order; `None` where no pose is within their time.
pub fn judge(truth: &[(f64, Se2)], run: &Run) -> Option<Judgement> {
    let mut truth = truth.to_vec();
    truth.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut to, mut from) = (BTreeMap::new(), BTreeMap::new());
    for ((k, time_s), pose) in (0u32..).zip(&run.times_s).zip(&run.poses) {
        if let Some(at) = at(&truth, *time_s) {
            to.insert(k, at.translation);
            from.insert(k, Vec2::new(pose.x, pose.y));
        }
    }
    if to.is_empty() {
        return None;
    }
    Some(Judgement { poses: to.len(), ate_m: align(&to, &from).map(|a| a.1), nees: nees(&truth, run) })
}

fn nees(truth: &[(f64, Se2)], run: &Run) -> Option<f64> {
    let start_from_world = at(truth, run.began_s)?.inverse();
    let errors: Vec<f64> = run
        .snapshots
        .iter()
        .filter_map(|s| {
            let at = s.map_from_start * start_from_world * at(truth, s.time_s)?;
            let mut error = s.pose - Vector3::new(at.translation.x, at.translation.y, at.rotation.log());
            error.z = wrap(error.z);
            Some(error.dot(&s.covariance.cholesky()?.solve(&error)))
        })
        .collect();
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
}

/// The true pose at a time, between two rows in proportion; `None` outside their time.
fn at(truth: &[(f64, Se2)], time_s: f64) -> Option<Se2> {
    let after = truth.partition_point(|t| t.0 < time_s);
    let (t1, b) = *truth.get(after)?;
    if t1 == time_s {
        return Some(b);
    }
    let (t0, a) = *truth.get(after.checked_sub(1)?)?;
    let part = (time_s - t0) / (t1 - t0);
    let position = a.translation.lerp(&b.translation, part);
    let angle = a.rotation.log() + part * wrap(b.rotation.log() - a.rotation.log());
    Some(Se2::from_xy_angle(position.x, position.y, angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_truth_between_two_rows_is_in_proportion() {
        let rows = [(0.0, Se2::from_xy_angle(0.0, 0.0, 3.0)), (2.0, Se2::from_xy_angle(2.0, 4.0, -3.0))];
        let middle = at(&rows, 1.0).unwrap();
        assert!((middle.translation - Vec2::new(1.0, 2.0)).norm() < 1e-12);
        assert!((wrap(middle.rotation.log() - std::f64::consts::PI)).abs() < 1e-9, "the short way round");
        assert_eq!(at(&rows, 0.0).unwrap().translation, rows[0].1.translation);
        assert!(at(&rows, 2.1).is_none() && at(&rows, -0.1).is_none());
    }
}
