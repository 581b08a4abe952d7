//! Ready-made figures of an evaluation and of a run.

use crate::chart::{Labels, Mark, Series, histogram, line_chart};
use crate::evaluate::Evaluation;
use crate::percentiles::Percentiles;
use crate::svg::Figure;
use cairn_geometry::Vec3;

/// The axes of a top view: the two with the largest extent of the points, in the order x, y, z.
pub fn widest_axes(points: impl IntoIterator<Item = Vec3>) -> (usize, usize) {
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for p in points {
        (low, high) = (low.inf(&p), high.sup(&p));
    }
    let size = high - low;
    let smallest = if size.z <= size.x && size.z <= size.y {
        2
    } else if size.y <= size.x {
        1
    } else {
        0
    };
    match smallest {
        2 => (0, 1),
        1 => (0, 2),
        _ => (1, 2),
    }
}

/// Distance to the ground truth over time.
pub fn error_over_time(title: &str, evaluation: &Evaluation) -> Figure {
    let start = evaluation.errors.first().map_or(0, |e| e.stamp_ns);
    let mut points = Vec::with_capacity(evaluation.errors.len());
    let mut last = 0.0;
    for e in &evaluation.errors {
        let t = e.stamp_ns.abs_diff(start) as f64 * 1e-9;
        if t - last > 1.0 {
            points.push((t, f64::NAN));
        }
        last = t;
        points.push((t, e.error_m));
    }
    let ate = &evaluation.ate_m;
    let labels = Labels {
        title: title.to_owned(),
        description: format!(
            "Error over time: RMSE {:.4} m, median {:.4} m, maximum {:.4} m.",
            ate.rmse, ate.median, ate.max
        ),
        x: "time from the first pair [s]".into(),
        y: "distance to the ground truth [m]".into(),
    };
    let mark = Mark { label: format!("RMSE {:.4} m", ate.rmse), value: ate.rmse };
    line_chart(&labels, &[Series { points, ..Series::default() }], &[mark])
}

/// Processing time of each frame in milliseconds, in order, with p50 and p99.
pub fn times_over_frames(title: &str, ms: &[f64]) -> Figure {
    let points = ms.iter().enumerate().map(|(i, v)| (i as f64, *v)).collect();
    let labels = Labels {
        title: title.to_owned(),
        description: format!("Time of each of {} frames{}", ms.len(), percentiles_text(ms)),
        x: "frame".into(),
        y: "step [ms]".into(),
    };
    line_chart(&labels, &[Series { points, ..Series::default() }], &percentile_marks(ms, false))
}

/// Histogram of the processing times in milliseconds, with p50, p95 and p99.
pub fn times_histogram(title: &str, ms: &[f64]) -> Figure {
    let labels = Labels {
        title: title.to_owned(),
        description: format!("Distribution of the time of {} frames{}", ms.len(), percentiles_text(ms)),
        x: "step [ms]".into(),
        y: "frames".into(),
    };
    histogram(&labels, ms, &percentile_marks(ms, true))
}

fn percentiles_text(ms: &[f64]) -> String {
    Percentiles::of(ms).map_or_else(|| ".".into(), |p| format!(": {p} ms."))
}

fn percentile_marks(ms: &[f64], with_p95: bool) -> Vec<Mark> {
    let Some(p) = Percentiles::of(ms) else { return Vec::new() };
    let all = [("p50", p.p50), ("p95", p.p95), ("p99", p.p99)];
    let wanted = all.into_iter().filter(|(name, _)| with_p95 || *name != "p95");
    wanted.map(|(name, value)| Mark { label: format!("{name} {value:.2} ms"), value }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EvalOptions, evaluate};
    use cairn_geometry::{Se3, So3, Trajectory};

    #[test]
    fn gaps_are_not_connected() {
        let (mut truth, mut estimate) = (Trajectory::new(), Trajectory::new());
        for i in 0..100i64 {
            let a = i as f64 * 0.1;
            let pose = Se3::new(So3::identity(), Vec3::new(a, 0.01 * a, a.sin()));
            truth.push(i * 100_000_000, pose).unwrap();
            if !(40..60).contains(&i) {
                estimate.push(i * 100_000_000, pose).unwrap();
            }
        }
        let result = evaluate(&truth, &estimate, &EvalOptions::default()).unwrap();
        let over_time = error_over_time("error", &result).standalone();
        assert_eq!(over_time.matches("line sa").count(), 2);
    }

    #[test]
    fn figures_without_frames_are_valid() {
        assert!(times_over_frames("t", &[]).description.contains("0 frames."));
        assert!(times_histogram("t", &[2.0, 4.0]).description.contains("p50 3.00"));
    }
}
