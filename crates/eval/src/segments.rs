//! The error of the KITTI odometry benchmark: how much a trajectory drifts over segments of 100 to 800 m.
//!
//! Geiger, Lenz and Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012,
//! section 3.1, with the lengths and the step between segments of the benchmark's development kit.

use cairn_geometry::Se3;
use serde::Serialize;

/// Path lengths of the segments in metres, along the reference.
const LENGTHS_M: [f64; 8] = [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0];
/// A segment begins at every tenth frame.
const STEP: usize = 10;

/// Means over segments: of one length, or of all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SegmentErrors {
    /// Number of segments.
    pub segments: usize,
    /// Error of the motion over a segment as a fraction of its length, in percent.
    pub translation_percent: f64,
    /// Error of the rotation over a segment, in degrees per 100 m.
    pub rotation_deg_per_100m: f64,
}

/// The errors of the KITTI odometry benchmark.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KittiErrors {
    /// Over all segments: the figures of the benchmark's table.
    #[serde(flatten)]
    pub all: SegmentErrors,
    /// Over the segments of each length in metres that fits in the trajectory.
    pub by_length: Vec<(f64, SegmentErrors)>,
}

/// The errors of a trajectory against its reference, pose by pose; `None` where it is shorter than 100 m.
pub(crate) fn kitti_errors(reference: &[Se3], estimate: &[Se3]) -> Option<KittiErrors> {
    let mut path_m = vec![0.0];
    for w in reference.windows(2) {
        path_m.push(path_m[path_m.len() - 1] + (w[1].translation - w[0].translation).norm());
    }
    let by_length: Vec<(f64, SegmentErrors)> = LENGTHS_M
        .into_iter()
        .filter_map(|length_m| {
            let ends = (0..reference.len()).step_by(STEP).filter_map(|first| {
                let last = path_m.partition_point(|d| *d <= path_m[first] + length_m);
                (last < reference.len()).then_some((first, last))
            });
            let errors: Vec<(f64, f64)> = ends
                .map(|(i, j)| {
                    let truth = reference[i].inverse() * reference[j];
                    let error = (estimate[i].inverse() * estimate[j]).inverse() * truth;
                    (error.translation.norm() / length_m, error.rotation.angle() / length_m)
                })
                .collect();
            (!errors.is_empty()).then(|| (length_m, mean(&errors)))
        })
        .collect();
    let segments: usize = by_length.iter().map(|(_, e)| e.segments).sum();
    let over_all = |value: fn(&SegmentErrors) -> f64| {
        by_length.iter().map(|(_, e)| value(e) * e.segments as f64).sum::<f64>() / segments as f64
    };
    let all = SegmentErrors {
        segments,
        translation_percent: over_all(|e| e.translation_percent),
        rotation_deg_per_100m: over_all(|e| e.rotation_deg_per_100m),
    };
    (segments > 0).then_some(KittiErrors { all, by_length })
}

/// The mean of fractions and of radians per metre, in percent and degrees per 100 m.
fn mean(errors: &[(f64, f64)]) -> SegmentErrors {
    let n = errors.len() as f64;
    SegmentErrors {
        segments: errors.len(),
        translation_percent: 100.0 * errors.iter().map(|e| e.0).sum::<f64>() / n,
        rotation_deg_per_100m: 100.0 * errors.iter().map(|e| e.1.to_degrees()).sum::<f64>() / n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    /// Straight along x, a pose each metre.
    fn straight(metres: usize, scale: f64, turn_rad_per_m: f64) -> Vec<Se3> {
        let pose = |i: usize| {
            let x = i as f64;
            Se3::new(So3::exp(&(Vec3::z() * turn_rad_per_m * x)), Vec3::x() * x * scale)
        };
        (0..=metres).map(pose).collect()
    }

    #[test]
    fn a_wrong_unit_is_its_percentage_and_a_slow_turn_its_degrees() {
        let truth = straight(260, 1.0, 0.0);
        let errors = kitti_errors(&truth, &straight(260, 1.02, 0.0)).unwrap();
        // The end of a segment is the first pose beyond its length: 101 and 201 m.
        assert_eq!(
            errors.by_length.iter().map(|(l, e)| (*l, e.segments)).collect::<Vec<_>>(),
            [(100.0, 16), (200.0, 6)]
        );
        assert!((errors.by_length[0].1.translation_percent - 2.02).abs() < 1e-9, "{errors:?}");
        assert!(errors.all.rotation_deg_per_100m < 1e-9);
        let turned = kitti_errors(&truth, &straight(260, 1.0, 1e-4)).unwrap();
        let expected = 1e-4_f64.to_degrees() * 100.0;
        assert!((turned.by_length[1].1.rotation_deg_per_100m / expected - 1.005).abs() < 1e-6, "{turned:?}");
        assert_eq!(kitti_errors(&truth, &truth).unwrap().all.translation_percent, 0.0);
    }

    #[test]
    fn short_trajectories_have_none() {
        let truth = straight(100, 1.0, 0.0);
        assert_eq!(kitti_errors(&truth, &truth), None);
        assert_eq!(kitti_errors(&[], &[]), None);
    }
}
