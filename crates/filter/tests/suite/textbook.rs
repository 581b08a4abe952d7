//! The plain EKF-SLAM of a textbook, as a reference that is run beside the filter.
//!
//! Source: Thrun, Burgard, Fox, "Probabilistic robotics" (2005), table 10.1 (EKF SLAM with known correspondences): a dense covariance, all
//! Jacobians at the latest estimate, no gate, each sighting in turn. Written from the table, without any code of the filter.

use cairn_filter::log::{Log, Noise, Step, Target};
use cairn_filter::measure::Kind;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// State `mu` and covariance `sigma`: the pose, then two numbers for each landmark.
pub struct Textbook {
    mu: DVector<f64>,
    sigma: DMatrix<f64>,
    place: BTreeMap<u32, usize>,
}

impl Textbook {
    pub fn new() -> Self {
        Self { mu: DVector::zeros(3), sigma: DMatrix::identity(3, 3) * 1e-12, place: BTreeMap::new() }
    }

    pub fn pose(&self) -> (Vector3<f64>, Matrix3<f64>) {
        (self.mu.fixed_rows::<3>(0).into(), self.sigma.fixed_view::<3, 3>(0, 0).into())
    }

    pub fn landmarks(&self) -> BTreeMap<u32, Vector2<f64>> {
        self.place.iter().map(|(label, at)| (*label, self.mu.fixed_rows::<2>(*at).into())).collect()
    }

    /// Lines 2 to 5.
    pub fn predict(&mut self, step: &Step) {
        let t = step.motion.before_from_after;
        let (s, c) = self.mu[2].sin_cos();
        let moved = Vector2::new(
            c * t.translation.x - s * t.translation.y,
            s * t.translation.x + c * t.translation.y,
        );
        let g = Matrix3::new(1.0, 0.0, -moved.y, 0.0, 1.0, moved.x, 0.0, 0.0, 1.0);
        let v = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        self.mu[0] += moved.x;
        self.mu[1] += moved.y;
        self.mu[2] = short(self.mu[2] + t.rotation.log());
        let top = g * self.sigma.rows(0, 3);
        self.sigma.rows_mut(0, 3).copy_from(&top);
        let left = self.sigma.columns(0, 3) * g.transpose();
        self.sigma.columns_mut(0, 3).copy_from(&left);
        let noisy = self.sigma.fixed_view::<3, 3>(0, 0) + v * step.motion.covariance * v.transpose();
        self.sigma.fixed_view_mut::<3, 3>(0, 0).copy_from(&noisy);
    }

    /// Lines 7 to 20, for ranges with bearings of landmarks with labels.
    pub fn observe(&mut self, step: &Step) {
        for sighting in &step.sightings {
            let (Target::Landmark(label), Kind::RangeBearing) =
                (sighting.target, sighting.measurement.kind())
            else {
                continue;
            };
            let z: Vector2<f64> = sighting.measurement.value().xy();
            let noise: Matrix2<f64> = sighting.measurement.covariance().fixed_view::<2, 2>(0, 0).into();
            let at = self.place.get(&label).copied().unwrap_or_else(|| self.enter(label, &z));
            let d = Vector2::new(self.mu[at] - self.mu[0], self.mu[at + 1] - self.mu[1]);
            let (q, r) = (d.norm_squared(), d.norm());
            let expected = Vector2::new(r, short(d.y.atan2(d.x) - self.mu[2]));
            let mut h = DMatrix::zeros(2, self.mu.len());
            let by_landmark = Matrix2::new(d.x / r, d.y / r, -d.y / q, d.x / q);
            h.fixed_view_mut::<2, 2>(0, at).copy_from(&by_landmark);
            h.fixed_view_mut::<2, 2>(0, 0).copy_from(&-by_landmark);
            h[(1, 2)] = -1.0;
            let cross = &self.sigma * h.transpose();
            let Some(inverse) = (&h * &cross + noise).try_inverse() else { continue };
            let gain = &cross * inverse;
            let innovation = Vector2::new(z.x - expected.x, short(z.y - expected.y));
            self.mu += &gain * innovation;
            self.mu[2] = short(self.mu[2]);
            self.sigma -= &gain * cross.transpose();
            self.sigma = 0.5 * (&self.sigma + self.sigma.transpose());
        }
    }

    /// Lines 9 and 10: a landmark never seen before, of which nothing is known.
    fn enter(&mut self, label: u32, z: &Vector2<f64>) -> usize {
        let at = self.mu.len();
        let direction = self.mu[2] + z.y;
        let (x, y) = (self.mu[0] + z.x * direction.cos(), self.mu[1] + z.x * direction.sin());
        self.mu = self.mu.clone().resize_vertically(at + 2, 0.0);
        (self.mu[at], self.mu[at + 1]) = (x, y);
        self.sigma = self.sigma.clone().resize(at + 2, at + 2, 0.0);
        (self.sigma[(at, at)], self.sigma[(at + 1, at + 1)]) = (1e6, 1e6);
        self.place.insert(label, at);
        at
    }
}

/// The live positions and the map of a robot of a log, with this noise.
pub fn textbook(log: &Log, robot: usize, noise: &Noise) -> (Vec<Vector3<f64>>, BTreeMap<u32, Vector2<f64>>) {
    let mut filter = Textbook::new();
    let steps = log.robots[robot].steps(noise, &[]).unwrap();
    let poses: Vec<Vector3<f64>> = steps
        .iter()
        .map(|step| {
            filter.predict(step);
            filter.observe(step);
            filter.pose().0
        })
        .collect();
    (poses, filter.landmarks())
}

fn short(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
