//! What makes an error large that is none of the trajectory: another unit of length, another clock, quaternions in another order,
//! poses the other way round. Each is tried; what explains most of the error is told.

use cairn_eval::{Align, EvalOptions, Evaluation, TrajectoryFile, evaluate_files};
use cairn_geometry::{Se3, So3, Trajectory};

/// What is left of an error where its cause is found, as a part of it: of fr2/desk half a second of another clock makes 0.085 m of
/// 0.008 m.
const LEFT: f64 = 0.34;
/// Errors below are of no other cause, metres and degrees.
const LEAST: (f64, f64) = (0.01, 15.0);
/// Scales nearer to one are errors of a map, not of a unit.
const LEAST_SCALE: f64 = 1.1;
/// Clocks are tried up to so far apart in steps of the second and then of the third, seconds.
const CLOCKS_S: (f64, f64, f64) = (2.0, 0.1, 0.01);
/// More poses would take seconds.
const MOST_POSES: usize = 50_000;

/// What is told of a comparison.
pub fn doubts(
    reference: &TrajectoryFile,
    estimate: &TrajectoryFile,
    options: &EvalOptions,
    found: &Evaluation,
) -> Vec<String> {
    if reference.trajectory.len().max(estimate.trajectory.len()) > MOST_POSES {
        return Vec::new();
    }
    let compare = Compare { reference, estimate, options, found };
    let of_length = compare.inverted().or_else(|| compare.unit()).or_else(|| compare.clock());
    of_length.into_iter().chain(compare.order()).collect()
}

struct Compare<'a> {
    reference: &'a TrajectoryFile,
    estimate: &'a TrajectoryFile,
    options: &'a EvalOptions,
    found: &'a Evaluation,
}

impl Compare<'_> {
    fn of(&self, estimate: Option<Trajectory>, align: Align) -> Option<Evaluation> {
        let changed = TrajectoryFile { trajectory: estimate?, ..self.estimate.clone() };
        evaluate_files(self.reference, &changed, &EvalOptions { align, ..*self.options }).ok()
    }

    fn is_explained_by(&self, other: &Evaluation) -> bool {
        let ate = self.found.ate_m.rmse;
        ate > LEAST.0 && other.ate_m.rmse < LEFT * ate && 2 * other.pairs > self.found.pairs
    }

    fn unit(&self) -> Option<String> {
        let same = Some(self.estimate.trajectory.clone());
        let other = self.of(same, Align::Sim3).filter(|other| self.is_explained_by(other))?;
        let times = other.scale.max(1.0 / other.scale);
        let size = if other.scale > 1.0 { "small" } else { "large" };
        (self.found.align != Align::Sim3 && times > LEAST_SCALE).then(|| {
            format!(
                "the estimate is {times:.2} times too {size}: with its scale aligned (--align sim3) the ATE is {:.6} m; are both in \
                 metres?",
                other.ate_m.rmse
            )
        })
    }

    fn inverted(&self) -> Option<String> {
        let inverse = self.estimate.trajectory.map(Se3::inverse);
        let other = self.of(Some(inverse), self.found.align).filter(|other| self.is_explained_by(other))?;
        let ate = other.ate_m.rmse;
        Some(format!(
            "with the poses of the estimate inverted the ATE is {ate:.6} m: are they camera from world?"
        ))
    }

    fn clock(&self) -> Option<String> {
        if self.reference.nominal_times || self.estimate.nominal_times {
            return None;
        }
        let (most, coarse, fine) = CLOCKS_S;
        let best = |around: f64, reach: f64, step: f64| {
            let count = (reach / step).round() as i32;
            let all = (-count..=count).map(|k| around + step * f64::from(k));
            let all = all.filter_map(|by| Some((by, self.of(self.shifted(by), self.found.align)?)));
            all.filter(|(_, e)| 2 * e.pairs > self.found.pairs)
                .min_by(|a, b| a.1.ate_m.rmse.total_cmp(&b.1.ate_m.rmse))
        };
        if self.found.ate_m.rmse < LEAST.0 {
            return None;
        }
        let (by, other) = best(best(0.0, most, coarse)?.0, coarse, fine)?;
        self.is_explained_by(&other).then(|| {
            let sense = if by > 0.0 { "later" } else { "earlier" };
            format!(
                "with the times of the estimate {:.2} s {sense} the ATE is {:.6} m: are both of one clock?",
                by.abs(),
                other.ate_m.rmse
            )
        })
    }

    fn shifted(&self, by_s: f64) -> Option<Trajectory> {
        let by_ns = (1e9 * by_s).round() as i64;
        let all =
            self.estimate.trajectory.iter().map(|(ns, pose)| (ns.saturating_add(by_ns), *pose)).collect();
        Trajectory::from_unsorted(all).ok()
    }

    /// The quaternions of one of both written with w at the other end.
    fn order(&self) -> Option<String> {
        let error = self.found.ate_deg.as_ref().map(|e| e.rmse).filter(|deg| *deg > LEAST.1)?;
        let reordered = |w_first: bool, pose: &Se3| {
            let q = pose.rotation.quaternion();
            let [x, y, z, w] = if w_first { [q.j, q.k, q.w, q.i] } else { [q.w, q.i, q.j, q.k] };
            Se3::new(So3::from_xyzw(x, y, z, w).unwrap_or(pose.rotation), pose.translation)
        };
        let all = [(true, true), (true, false), (false, true), (false, false)];
        all.into_iter().find_map(|(of_estimate, w_first)| {
            let changed = |file: &TrajectoryFile| TrajectoryFile {
                trajectory: file.trajectory.map(|pose| reordered(w_first, pose)),
                ..file.clone()
            };
            let files = match of_estimate {
                true => (self.reference.clone(), changed(self.estimate)),
                false => (changed(self.reference), self.estimate.clone()),
            };
            let other = evaluate_files(&files.0, &files.1, self.options).ok()?.ate_deg?;
            let name = if of_estimate { &self.estimate.name } else { &self.reference.name };
            let order = if w_first { "w first" } else { "w last" };
            (other.rmse < LEFT * error).then(|| {
                let deg = other.rmse;
                format!("with the quaternions of {name} read as {order} the rotation error is {deg:.3} deg: are they?")
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_eval::parse_trajectory;

    /// A walk of 20 s around with a nod, its line of `t x y z qx qy qz qw` changed.
    fn walk(rate_hz: f64, change: impl Fn(f64, [f64; 7]) -> (f64, [f64; 7])) -> TrajectoryFile {
        let mut text = String::new();
        for k in 0..(20.0 * rate_hz) as i32 {
            let t = f64::from(k) / rate_hz;
            let (yaw, nod) = (0.4 * t, 0.6 + 0.3 * (0.7 * t).sin());
            let rotation = So3::exp(&[0.0, 0.0, yaw].into()) * So3::exp(&[nod, 0.0, 0.0].into());
            let q = rotation.quaternion();
            let at = [2.0 * yaw.cos(), 3.0 * yaw.sin(), 0.3 * (0.9 * t).sin(), q.i, q.j, q.k, q.w];
            let (t, line) = change(t, at);
            text += &format!("{:.6} {}\n", 100.0 + t, line.map(|v| v.to_string()).join(" "));
        }
        parse_trajectory(&text, "walk.txt", None).unwrap()
    }

    fn told(change: impl Fn(f64, [f64; 7]) -> (f64, [f64; 7])) -> String {
        let noisy = |t: f64, mut line: [f64; 7]| {
            line[1] += 0.004 * (11.0 * t).sin();
            change(t, line)
        };
        let (reference, estimate) = (walk(100.0, |t, line| (t, line)), walk(10.0, noisy));
        let options = EvalOptions::default();
        let found = evaluate_files(&reference, &estimate, &options).unwrap();
        doubts(&reference, &estimate, &options, &found).join("; ")
    }

    #[test]
    fn causes_that_are_none_of_the_trajectory_are_told() {
        assert_eq!(told(|t, line| (t, line)), "");
        let doubled = told(|t, [x, y, z, a, b, c, d]| (t, [2.0 * x, 2.0 * y, 2.0 * z, a, b, c, d]));
        assert!(doubled.starts_with("the estimate is 2.00 times too large"), "{doubled}");
        let late = told(|t, line| (t + 0.53, line));
        assert!(late.starts_with("with the times of the estimate 0.53 s earlier"), "{late}");
        let w_first = told(|t, [x, y, z, a, b, c, d]| (t, [x, y, z, d, a, b, c]));
        assert!(w_first.starts_with("with the quaternions of walk.txt read as w first"), "{w_first}");
        let inverted = told(|t, [x, y, z, a, b, c, d]| {
            let pose = Se3::new(So3::from_xyzw(a, b, c, d).unwrap(), [x, y, z].into()).inverse();
            let (p, q) = (pose.translation, pose.rotation.quaternion());
            (t, [p.x, p.y, p.z, q.i, q.j, q.k, q.w])
        });
        assert!(inverted.starts_with("with the poses of the estimate inverted"), "{inverted}");
        // A trajectory that is bad in its own way has no such cause.
        let drifts = told(|t, [x, y, z, a, b, c, d]| (t, [x + 0.1 * t, y - 0.05 * t * t, z, a, b, c, d]));
        assert_eq!(drifts, "");
    }
}
