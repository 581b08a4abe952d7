//! A smooth motion of the body with its exact velocity, acceleration and turning rate.
//!
//! Position and quaternion are seven splines of time; the quaternion is divided by its norm. For a unit
//! quaternion `q = Q / |Q|` the body's rate is `omega = 2 vec(conj(q) Q') / |Q|`, since the part of `Q'` along `q`
//! only changes the norm (Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, eq. 201).
//! Uniform quintic B-splines: de Boor, "A practical guide to splines" (1978).

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{SourceError, Stamp};
use nalgebra::{Quaternion, SVector, UnitQuaternion};

type Row = SVector<f64, 7>;

/// The body at one instant.
#[derive(Clone, Copy, Debug)]
pub struct BodyState {
    /// Its pose.
    pub world_from_body: Se3,
    /// Velocity in the world, m/s.
    pub velocity: Vec3,
    /// Acceleration in the world without gravity, m/s^2.
    pub acceleration: Vec3,
    /// Turning rate in the body frame, rad/s.
    pub rate: Vec3,
}

/// A continuous-time trajectory, which can be evaluated at any time; before its start and after its end the body stays at the end poses.
#[derive(Clone, Debug)]
pub struct ContinuousTrajectory {
    curve: Curve,
    start: f64,
    end: f64,
}

#[derive(Clone, Debug)]
enum Curve {
    /// Quintic B-spline with control points `dt` apart; four times continuously differentiable.
    Uniform { first: f64, dt: f64, control: Vec<Row> },
    /// Natural cubic spline through the given rows; twice continuously differentiable.
    Through { times: Vec<f64>, rows: Vec<Row>, second: Vec<Row> },
}

fn row(pose: &Se3) -> Row {
    let (p, q) = (pose.translation, pose.rotation.quaternion().coords);
    Row::from([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
}

/// Selects the sign of each quaternion that is nearer to the previous one.
fn same_sign(rows: &mut [Row]) {
    for i in 1..rows.len() {
        let before = rows[i - 1];
        let dot: f64 = (3..7).map(|k| before[k] * rows[i][k]).sum();
        if dot < 0.0 {
            (3..7).for_each(|k| rows[i][k] = -rows[i][k]);
        }
    }
}

impl ContinuousTrajectory {
    /// From poses sampled every `dt` seconds from `start` on: the spline follows them closely (it smooths what is
    /// faster than a few samples).
    pub(crate) fn sampled(start: f64, dt: f64, poses: &[Se3]) -> Self {
        let mut control: Vec<Row> = poses.iter().map(row).collect();
        same_sign(&mut control);
        // Two more at each end, so that the motion starts and ends at the given poses.
        if let (Some(&a), Some(&z)) = (control.first(), control.last()) {
            control.splice(0..0, [a; 3]);
            control.extend([z; 3]);
        }
        let end = start + dt * poses.len().saturating_sub(1) as f64;
        Self { curve: Curve::Uniform { first: start - 3.0 * dt, dt, control }, start, end }
    }

    /// One more sample at the end of a motion from [`ContinuousTrajectory::sampled`]; what lies more than two samples before the end does
    /// not change by it.
    pub(crate) fn extend(&mut self, pose: &Se3) {
        let Curve::Uniform { dt, control, .. } = &mut self.curve else { return };
        // The end stands there three times more; it is put behind the new sample.
        control.truncate(control.len().saturating_sub(3));
        let mut next = row(pose);
        if let Some(last) = control.last()
            && (3..7).map(|k| last[k] * next[k]).sum::<f64>() < 0.0
        {
            (3..7).for_each(|k| next[k] = -next[k]);
        }
        control.extend([next; 4]);
        self.end += *dt;
    }

    /// Through given body poses in time.
    ///
    /// # Errors
    /// Fewer than three poses, times that do not increase, values that are not finite.
    pub fn through(poses: &[(Stamp, Se3)]) -> Result<Self, SourceError> {
        let fail = |why: String| {
            Err(SourceError::new("trajectory", why, "give at least three poses in increasing time"))
        };
        if poses.len() < 3 {
            return fail(format!("has {} poses", poses.len()));
        }
        for (i, w) in poses.windows(2).enumerate() {
            if w[1].0 <= w[0].0 {
                return fail(format!(
                    "pose {} at {} s is not later than the previous one at {} s",
                    i + 1,
                    w[1].0,
                    w[0].0
                ));
            }
        }
        if let Some(i) = poses.iter().position(|p| !p.1.is_finite()) {
            return fail(format!("pose {i} has a value that is not finite"));
        }
        let origin = poses[0].0;
        let times: Vec<f64> = poses.iter().map(|p| p.0 - origin).collect();
        let mut rows: Vec<Row> = poses.iter().map(|p| row(&p.1)).collect();
        same_sign(&mut rows);
        let second = natural_spline(&times, &rows);
        let end = times.last().copied().unwrap_or(0.0);
        Ok(Self { curve: Curve::Through { times, rows, second }, start: 0.0, end })
    }

    /// The same motion with its clock moved by some seconds.
    pub(crate) fn shifted(mut self, seconds: f64) -> Self {
        match &mut self.curve {
            Curve::Uniform { first, .. } => *first += seconds,
            Curve::Through { times, .. } => times.iter_mut().for_each(|t| *t += seconds),
        }
        self.start += seconds;
        self.end += seconds;
        self
    }

    /// Seconds at which it starts.
    pub fn start(&self) -> f64 {
        self.start
    }

    /// Seconds at which it ends.
    pub fn end(&self) -> f64 {
        self.end
    }

    /// The body's pose at a time in seconds.
    pub fn pose(&self, t: f64) -> Se3 {
        self.state(t).world_from_body
    }

    /// The body's pose, velocity, acceleration and rate at a time in seconds.
    pub fn state(&self, t: f64) -> BodyState {
        let outside = t < self.start || t > self.end;
        let (y, mut d1, mut d2) = self.rows(t.clamp(self.start, self.end));
        if outside {
            (d1, d2) = (Row::zeros(), Row::zeros());
        }
        let quaternion = Quaternion::new(y[6], y[3], y[4], y[5]);
        let unit = UnitQuaternion::from_quaternion(quaternion);
        let turning = unit.conjugate().into_inner() * Quaternion::new(d1[6], d1[3], d1[4], d1[5]);
        let rate = turning.imag() * (2.0 / quaternion.norm());
        BodyState {
            world_from_body: Se3::new(So3::from_quaternion(unit), Vec3::new(y[0], y[1], y[2])),
            velocity: Vec3::new(d1[0], d1[1], d1[2]),
            acceleration: Vec3::new(d2[0], d2[1], d2[2]),
            rate,
        }
    }

    /// The seven values with first and second derivative.
    fn rows(&self, t: f64) -> (Row, Row, Row) {
        match &self.curve {
            Curve::Uniform { first, dt, control } => {
                let s = (t - first) / dt;
                let last = control.len().saturating_sub(4).max(2);
                let i = (s.floor().max(2.0) as usize).min(last);
                let (b, d1, d2) = quintic(s - i as f64);
                let (mut y, mut y1, mut y2) = (Row::zeros(), Row::zeros(), Row::zeros());
                for k in 0..6 {
                    let c = control[(i + k).saturating_sub(2).min(control.len() - 1)];
                    y += c * b[k];
                    y1 += c * (d1[k] / dt);
                    y2 += c * (d2[k] / (dt * dt));
                }
                (y, y1, y2)
            }
            Curve::Through { times, rows, second } => {
                let i = times.partition_point(|v| *v <= t).clamp(1, times.len() - 1);
                let h = times[i] - times[i - 1];
                let (a, b) = ((times[i] - t) / h, (t - times[i - 1]) / h);
                let (ya, yb, ma, mb) = (rows[i - 1], rows[i], second[i - 1], second[i]);
                let y = ya * a + yb * b + (ma * (a * a * a - a) + mb * (b * b * b - b)) * (h * h / 6.0);
                let y1 = (yb - ya) / h + (mb * (3.0 * b * b - 1.0) - ma * (3.0 * a * a - 1.0)) * (h / 6.0);
                (y, y1, ma * a + mb * b)
            }
        }
    }
}

/// The six quintic B-spline weights at `u` in 0..1 with first and second derivative.
fn quintic(u: f64) -> ([f64; 6], [f64; 6], [f64; 6]) {
    // By the Cox-de Boor recursion on uniform knots, degree by degree.
    let raise = |b: &[f64], degree: usize| -> Vec<f64> {
        let mut out = vec![0.0; degree + 1];
        for (k, v) in b.iter().enumerate() {
            // Weight k of the lower degree feeds k and k + 1 of the next.
            let left = (u + (degree - 1 - k) as f64) / degree as f64;
            out[k + 1] += v * left;
            out[k] += v * (1.0 - left);
        }
        out
    };
    let mut levels = vec![vec![1.0]];
    for degree in 1..=5 {
        let next = raise(&levels[degree - 1], degree);
        levels.push(next);
    }
    // d/du of degree n is the difference of degree n - 1.
    let differ = |b: &[f64]| -> Vec<f64> {
        (0..=b.len())
            .map(|k| if k > 0 { b[k - 1] } else { 0.0 } - if k < b.len() { b[k] } else { 0.0 })
            .collect()
    };
    let (b, d1, d2) = (&levels[5], differ(&levels[4]), differ(&differ(&levels[3])));
    let six = |v: &[f64]| -> [f64; 6] { std::array::from_fn(|k| v[k]) };
    (six(b), six(&d1), six(&d2))
}

/// Second derivatives at the knots of the natural cubic spline (tridiagonal elimination).
fn natural_spline(t: &[f64], y: &[Row]) -> Vec<Row> {
    let n = t.len();
    let mut second = vec![Row::zeros(); n];
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let (h0, h1) = (t[i] - t[i - 1], t[i + 1] - t[i]);
        let right = ((y[i + 1] - y[i]) / h1 - (y[i] - y[i - 1]) / h0) * 6.0;
        let pivot = 2.0 * (h0 + h1) - h0 * upper[i - 1];
        upper[i] = h1 / pivot;
        second[i] = (right - second[i - 1] * h0) / pivot;
    }
    second[n - 1] = Row::zeros();
    for i in (1..n - 1).rev() {
        let next = second[i + 1];
        second[i] -= next * upper[i];
    }
    second
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quintic_weights_and_derivatives() {
        for u in [0.0, 0.3, 0.99] {
            let (b, d1, d2) = quintic(u);
            assert!((b.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let h = 1e-5;
            let (p, p1, _) = quintic(u + h);
            let (m, m1, _) = quintic(u - h);
            for k in 0..6 {
                assert!(((p[k] - m[k]) / (2.0 * h) - d1[k]).abs() < 1e-8, "first, weight {k}");
                assert!(((p1[k] - m1[k]) / (2.0 * h) - d2[k]).abs() < 1e-8, "second, weight {k}");
            }
        }
        // The middle weights at a knot are 1/120 * (1, 26, 66, 26, 1, 0).
        let (b, _, _) = quintic(0.0);
        assert!((b[2] - 66.0 / 120.0).abs() < 1e-12 && b[5].abs() < 1e-12, "{b:?}");
    }

    #[test]
    fn grows_sample_by_sample() {
        let pose = |i: usize| {
            let turn = So3::exp(&Vec3::new(0.0, 0.0, 1.5 * i as f64));
            Se3::new(turn, Vec3::new((0.3 * i as f64).sin(), i as f64 * 0.1, 1.0))
        };
        let poses: Vec<Se3> = (0..12).map(pose).collect();
        let whole = ContinuousTrajectory::sampled(0.0, 0.05, &poses);
        let mut grown = ContinuousTrajectory::sampled(0.0, 0.05, &poses[..1]);
        for (n, p) in poses.iter().enumerate().skip(1) {
            grown.extend(p);
            assert!((grown.end() - 0.05 * n as f64).abs() < 1e-12);
            // Two samples before the end nothing changes any more.
            let Some(settled) = n.checked_sub(2) else { continue };
            let t = 0.05 * settled as f64;
            let (a, b) = (grown.state(t), whole.state(t));
            assert!((a.world_from_body.translation - b.world_from_body.translation).norm() < 1e-12, "{n}");
            assert!((a.acceleration - b.acceleration).norm() < 1e-9 && (a.rate - b.rate).norm() < 1e-9);
        }
    }

    #[test]
    fn passes_through_given_poses() {
        let pose = |i: i64| {
            Se3::new(
                So3::exp(&Vec3::new(0.1 * i as f64, 0.3, -0.2)),
                Vec3::new(i as f64, (i * i) as f64 * 0.1, 1.0),
            )
        };
        let poses: Vec<(Stamp, Se3)> = (0..6).map(|i| (Stamp(100_000_000 * i), pose(i))).collect();
        let m = ContinuousTrajectory::through(&poses).unwrap();
        for (t, p) in &poses {
            let got = m.pose(t.seconds());
            assert!((got.translation - p.translation).norm() < 1e-12);
            assert!((got.rotation.inverse() * p.rotation).angle() < 1e-9);
        }
        assert!(ContinuousTrajectory::through(&poses[..2]).is_err());
    }
}
