//! The time offset between IMU and camera, and the readout time of a camera's rows, from how features move from frame to frame: in the
//! first second of a recording, before there is a map or a pose.
//!
//! Between two frames a feature moves by the camera's rotation, which the gyroscope measures from the exposure of its row in the first
//! to that of its row in the second, and by the camera's motion over the feature's depth. The latter is taken for one that all features
//! have in common: near and far ones scatter around it, which a robust weight allows for (the gyroscope
//! and the rows as in Karpenko et al., "Digital video stabilization and rolling shutter correction using gyroscopes", Stanford 2011, and
//! Jia & Evans, "Online camera-gyroscope autocalibration for cell phones", IEEE TIP 2014). A focal length that is not known stretches
//! what the gyroscope says; it is solved for, and not believed: walking ahead stretches what is seen too.
//!
//! The camera's motion is what the accelerometer says but for its mean, over a depth that is solved for, and a velocity that is linear in
//! time between knots. A walker's body bobs and sways in time with how it pitches and rolls, and features move by both: without the
//! accelerometer the offset of 56 simulated newcomers was 25 ms off in the median, always to the same side, with it 5 ms.
//!
//! The sign: `t_imu + offset = t_image`.

use cairn_geometry::{Mat3, So3, Vec3};
use cairn_sensor::{ImuSample, Stamp};
use nalgebra::{DMatrix, DVector, Vector2};

/// A feature in two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlowPoint {
    /// Its ray `(x, y, 1)` in the camera of each frame, by the lens that is assumed.
    pub rays: [[f64; 2]; 2],
    /// The row of each, from -0.5 at the first that is exposed to 0.5 at the last.
    pub rows: [f64; 2],
}

/// Features of one frame found again in another.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowPair {
    /// The times of the two frames: of their middle rows.
    pub stamps: [Stamp; 2],
    /// What is seen in both.
    pub points: Vec<FlowPoint>,
}

/// The estimate.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FlowClocks {
    /// Seconds to add to the samples' stamps to get the frames' clock, and its standard deviation.
    pub offset_s: [f64; 2],
    /// Seconds from the first row to the last, and its standard deviation.
    pub readout_s: [f64; 2],
}

/// Standard deviations of what is not known before: offset (s), readout (s), logarithm of the focal length, gyroscope's bias (rad/s),
/// the inverse depth (1/m).
const PRIOR: [f64; COMMON] = [0.1, 0.03, 0.1, 0.02, 0.02, 0.02, 0.5];
/// That of the camera's speed over the depth at a knot, 1/s.
const SPEED_PRIOR: f64 = 0.5;
/// Offsets that are tried first: from, to, step, seconds. Hands that hold a phone turn it to and fro within a fifth of a second.
const TRIED: [f64; 3] = [-0.06, 0.14, 0.025];
/// Seconds between two knots of the camera's velocity: two steps. With knots at 0.5 s, which follow a step, the offset of newcomers was
/// 13 ms off in the median, at 1.5 s as at 1 s.
const KNOT_S: f64 = 1.0;
/// A feature moves otherwise than its neighbours by so many pixels where depths differ; those farther off count less.
const SCATTER_PX: f64 = 3.0;
/// Points used while offsets are tried, and afterwards.
const MOST_POINTS: [usize; 2] = [1500, 6000];
/// Steps from each offset that is tried, and from the best.
const STEPS: [usize; 2] = [3, 8];
/// Stretches of time that are compared for the standard deviations: points next to each other err alike.
const STRETCHES: usize = 6;
/// Unknowns before those of the velocity: offset, readout, focal, bias (3), inverse depth.
const COMMON: usize = 7;
/// Unknowns that a point is seen by: these, and the velocities at the knots before and after it.
const SEEN_BY: usize = COMMON + 6;
/// Least standard deviations, seconds: what the model leaves out (depths, the lens) moved offset and readout of 56 newcomers by this much in
/// the median.
const LEAST_SIGMA_S: [f64; 2] = [0.005, 0.02];

/// Finds both from consecutive pairs, in time, and the readings around them; `focal_px` is in pixels. `None` where there is too little.
pub fn flow_clocks(
    pairs: &[FlowPair],
    samples: &[ImuSample],
    camera_from_imu: &So3,
    focal_px: f64,
) -> Option<FlowClocks> {
    let zero = samples.first()?.stamp;
    let span = [pairs.first()?.stamps[0] - zero, pairs.last()?.stamps[1] - zero];
    let imu = Integral::of(samples, camera_from_imu, span)?;
    let reach = [imu.from + TRIED[1], imu.to + TRIED[0]];
    let points: Vec<Point> = pairs
        .iter()
        .filter(|p| p.stamps[0] - zero > reach[0] && p.stamps[1] - zero < reach[1])
        .flat_map(|pair| {
            let at = pair.stamps.map(|stamp| stamp - zero);
            pair.points.iter().map(move |p| Point { at, seen: *p })
        })
        .collect();
    let (first, last) = (points.first()?.at[0], points.last()?.at[1]);
    let thin = |most: usize| -> Vec<Point> {
        points.iter().step_by(points.len().div_ceil(most).max(1)).copied().collect()
    };
    let knots = ((last - first) / KNOT_S).ceil() as usize + 1;
    let problem = |points| Problem { points, imu: &imu, first, knots: knots.max(2), focal_px };
    let coarse = problem(thin(MOST_POINTS[0]));
    if coarse.points.len() < 10 * (COMMON + 3 * coarse.knots) {
        return None;
    }
    let tried = ((TRIED[1] - TRIED[0]) / TRIED[2]).round() as usize;
    let mut best: Option<(f64, DVector<f64>)> = None;
    for k in 0..=tried {
        let mut start = DVector::zeros(COMMON + 3 * coarse.knots);
        start[0] = TRIED[0] + TRIED[2] * k as f64;
        let Some((cost, found)) = coarse.descend(start, STEPS[0]) else { continue };
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, found));
        }
    }
    let fine = problem(thin(MOST_POINTS[1]));
    let (_, found) = fine.descend(best?.1, STEPS[1])?;
    let sigma = fine.sigma(&found)?;
    let known = |k: usize| [found[k], sigma[k].max(LEAST_SIGMA_S[k])];
    let inside = found[0] > TRIED[0] && found[0] < TRIED[1];
    inside.then(|| FlowClocks { offset_s: known(0), readout_s: known(1) })
}

/// The readings in the camera's axes, integrated from the first sample on. Within the tenth of a second between two frames rotations add
/// up as vectors.
struct Integral {
    /// Seconds since the first sample.
    times: Vec<f64>,
    moments: Vec<Moment>,
    from: f64,
    to: f64,
}

/// What the readings have summed up to.
#[derive(Clone, Copy)]
struct Moment {
    /// Angular velocity, and its integral.
    rate: Vec3,
    turned: Vec3,
    /// From the axes now to those at first.
    axes: So3,
    /// By the acceleration but for its mean, in the axes at first: m/s and m.
    speed: Vec3,
    place: Vec3,
}

impl Integral {
    /// With the mean acceleration over a span of seconds since the first sample.
    fn of(samples: &[ImuSample], camera_from_imu: &So3, span: [f64; 2]) -> Option<Self> {
        let zero = samples.first()?.stamp;
        let times: Vec<f64> = samples.iter().map(|s| s.stamp - zero).collect();
        let (mut moments, mut forces) = (Vec::<Moment>::new(), Vec::<Vec3>::new());
        for (k, s) in samples.iter().enumerate() {
            let rate = *camera_from_imu * s.gyro;
            let (turned, axes) = moments.last().map_or((Vec3::zeros(), So3::identity()), |before| {
                let by = (before.rate + rate) * (0.5 * (times[k] - times[k - 1]));
                (before.turned + by, before.axes * So3::exp(&by))
            });
            forces.push(axes * (*camera_from_imu * s.accel));
            moments.push(Moment { rate, turned, axes, speed: Vec3::zeros(), place: Vec3::zeros() });
        }
        let within = || times.iter().zip(&forces).filter(|(t, _)| (span[0]..=span[1]).contains(*t));
        let mean = within().map(|(_, force)| force).sum::<Vec3>() / within().count().max(1) as f64;
        // Speeds from before the span would be those of another motion.
        let first = times.partition_point(|t| *t < span[0] - TRIED[1]).max(1);
        for k in first..times.len() {
            let dt = times[k] - times[k - 1];
            let by = ((forces[k] + forces[k - 1]) * 0.5 - mean) * dt;
            let Moment { speed, place, .. } = moments[k - 1];
            (moments[k].speed, moments[k].place) = (speed + by, place + (speed + by * 0.5) * dt);
        }
        let (from, to) = (*times.first()?, *times.last()?);
        (times.len() > 2).then_some(Self { times, moments, from, to })
    }

    /// At a time; the axes are those of the reading before.
    fn at(&self, t: f64) -> Moment {
        let after = self.times.partition_point(|s| *s < t).clamp(1, self.times.len() - 1);
        let span = self.times[after] - self.times[after - 1];
        let part = if span > 0.0 { ((t - self.times[after - 1]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let (a, b) = (&self.moments[after - 1], &self.moments[after]);
        let between = |of: fn(&Moment) -> Vec3| of(a) + (of(b) - of(a)) * part;
        Moment {
            rate: between(|m| m.rate),
            turned: between(|m| m.turned),
            axes: a.axes,
            speed: between(|m| m.speed),
            place: between(|m| m.place),
        }
    }
}

/// A point of a pair, with the times of its frames since the first sample.
#[derive(Clone, Copy)]
struct Point {
    at: [f64; 2],
    seen: FlowPoint,
}

struct Problem<'a> {
    points: Vec<Point>,
    imu: &'a Integral,
    first: f64,
    knots: usize,
    focal_px: f64,
}

/// What a point says: its residual in pixels and its derivatives by the common unknowns and by the motion, with the knot before it and
/// the share of the one after.
struct Row {
    residual: Vector2<f64>,
    common: nalgebra::SMatrix<f64, 2, COMMON>,
    motion: nalgebra::SMatrix<f64, 2, 3>,
    knot: usize,
    share: f64,
}

impl Problem<'_> {
    fn row(&self, point: &Point, x: &DVector<f64>) -> Row {
        let Point { at, seen } = point;
        let scale = (-x[2]).exp();
        let ray = |k: usize| Vec3::new(seen.rays[k][0] * scale, seen.rays[k][1] * scale, 1.0);
        let (a, c) = (ray(0), ray(1));
        let times = [0, 1].map(|k| at[k] - x[0] + seen.rows[k] * x[1]);
        let [first, second] = times.map(|t| self.imu.at(t));
        let dt = times[1] - times[0];
        let turned = second.turned - first.turned - Vec3::new(x[3], x[4], x[5]) * dt;
        let place = (0.5 * (at[0] + at[1]) - self.first) / KNOT_S;
        let knot = (place.max(0.0) as usize).min(self.knots - 2);
        let share = (place - knot as f64).clamp(0.0, 1.0);
        let v = |k: usize| Vec3::new(x[COMMON + 3 * k], x[COMMON + 3 * k + 1], x[COMMON + 3 * k + 2]);
        let to_second = second.axes.inverse();
        let swayed = to_second * (second.place - first.place);
        let moved = (v(knot) * (1.0 - share) + v(knot + 1) * share) * dt + swayed * x[6];
        let b = So3::exp(&-turned) * a - moved;
        let f = self.focal_px / scale;
        let residual = Vector2::new(c.x - b.x / b.z, c.y - b.y / b.z) * f;
        // The projection by the point in the second camera.
        let by_b = nalgebra::Matrix2x3::new(1.0, 0.0, -b.x / b.z, 0.0, 1.0, -b.y / b.z) * (-f / b.z);
        let by_turn = by_b * hat(&a);
        let mut common = nalgebra::SMatrix::<f64, 2, COMMON>::zeros();
        // By the times of the second and of the first.
        let by_times = |second_by: f64, first_by: f64| {
            let speed = to_second * (second.speed * second_by - first.speed * first_by);
            by_turn * (second.rate * second_by - first.rate * first_by) - by_b * speed * x[6]
        };
        common.set_column(0, &by_times(-1.0, -1.0));
        common.set_column(1, &by_times(seen.rows[1], seen.rows[0]));
        // Both rays, and the pixels that a ray makes.
        let by_a = by_b * Vec3::new(a.x, a.y, 0.0);
        common.set_column(2, &(-by_a - Vector2::new(b.x / b.z, b.y / b.z) * f));
        common.fixed_view_mut::<2, 3>(0, 3).copy_from(&(-by_turn * dt));
        common.set_column(6, &(-by_b * swayed));
        Row { residual, common, motion: -by_b * dt, knot, share }
    }

    /// Normal equations at a state, with the cost; points may be left out.
    fn linearise(
        &self,
        x: &DVector<f64>,
        points: &[Point],
        prior: bool,
    ) -> (DMatrix<f64>, DVector<f64>, f64) {
        let n = x.len();
        let (mut h, mut g, mut cost) = (DMatrix::zeros(n, n), DVector::zeros(n), 0.0);
        for point in points {
            let row = self.row(point, x);
            let square = row.residual.norm_squared() / (SCATTER_PX * SCATTER_PX);
            // Of Cauchy.
            let weight = 1.0 / (1.0 + square);
            cost += 0.5 * SCATTER_PX * SCATTER_PX * (1.0 + square).ln();
            let mut jacobian = nalgebra::SMatrix::<f64, 2, SEEN_BY>::zeros();
            jacobian.fixed_view_mut::<2, COMMON>(0, 0).copy_from(&row.common);
            jacobian.fixed_view_mut::<2, 3>(0, COMMON).copy_from(&(row.motion * (1.0 - row.share)));
            jacobian.fixed_view_mut::<2, 3>(0, COMMON + 3).copy_from(&(row.motion * row.share));
            let index = |i: usize| if i < COMMON { i } else { i + 3 * row.knot };
            let (normal, right) =
                (jacobian.transpose() * jacobian * weight, jacobian.transpose() * row.residual * weight);
            for i in 0..SEEN_BY {
                g[index(i)] += right[i];
                for j in 0..SEEN_BY {
                    h[(index(i), index(j))] += normal[(i, j)];
                }
            }
        }
        if prior {
            for i in 0..n {
                let sigma = PRIOR.get(i).copied().unwrap_or(SPEED_PRIOR);
                let information = 1.0 / (sigma * sigma);
                h[(i, i)] += information;
                g[i] += information * x[i];
                cost += 0.5 * information * x[i] * x[i];
            }
        }
        (h, g, cost)
    }

    /// Gauss-Newton; the cost at the state before the last step.
    fn descend(&self, mut x: DVector<f64>, steps: usize) -> Option<(f64, DVector<f64>)> {
        let mut last = f64::INFINITY;
        for _ in 0..steps {
            let (h, g, cost) = self.linearise(&x, &self.points, true);
            let mut step = -h.cholesky()?.solve(&g);
            // What is looked for lies between the offsets that are tried.
            let far = (step[0].abs() / TRIED[2]).max(step[2].abs() / 0.2).max(1.0);
            step /= far;
            x += step;
            last = cost;
        }
        x.iter().all(|v| v.is_finite()).then_some((last, x))
    }

    /// Standard deviations of offset and readout: from how far the stretches of time pull them apart.
    fn sigma(&self, x: &DVector<f64>) -> Option<[f64; 2]> {
        let (h, _, _) = self.linearise(x, &self.points, true);
        let inverse = h.cholesky()?.inverse();
        let each = self.points.len().div_ceil(STRETCHES);
        let mut sum = [0.0; 2];
        for stretch in self.points.chunks(each) {
            let (_, g, _) = self.linearise(x, stretch, false);
            let pull = &inverse * g;
            (0..2).for_each(|k| sum[k] += pull[k] * pull[k]);
        }
        let n = STRETCHES as f64;
        // Never better than were all points independent, with the scatter that is allowed for.
        Some([0, 1].map(|k| (sum[k] * n / (n - 1.0)).max(inverse[(k, k)]).sqrt()))
    }
}

fn hat(v: &Vec3) -> Mat3 {
    Mat3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;
    use cairn_sensor::GRAVITY_M_S2;

    const FOCAL_PX: f64 = 450.0;

    /// The rate of a hand that holds a phone and turns it, rad/s.
    fn rate(t: f64) -> Vec3 {
        Vec3::new(0.2 * (9.0 * t).sin(), 0.15 + 0.3 * (5.0 * t).cos(), 0.1 * (7.0 * t).sin())
    }

    fn turned(from: f64, to: f64) -> So3 {
        let steps = 40;
        let h = (to - from) / f64::from(steps);
        (0..steps).fold(So3::identity(), |r, k| r * So3::exp(&(rate(from + h * (f64::from(k) + 0.5)) * h)))
    }

    /// How far walkers who bob by so much are up, and their acceleration, in time with how they pitch.
    fn bob(bob_m: f64, t: f64) -> [Vec3; 2] {
        let (up, w) = (Vec3::y() * (bob_m * (9.0 * t).sin()), 9.0);
        [up, -up * (w * w)]
    }

    /// A second of pictures of points at 1 to 6 m from one who walks ahead, 30 a second, read out row after row, seen with a
    /// focal length that is `focal` times what is assumed; they bob by `bob_m`.
    fn seen(
        [offset_s, readout_s, focal]: [f64; 3],
        bob_m: f64,
        seed: u64,
    ) -> (Vec<FlowPair>, Vec<ImuSample>) {
        let mut random = Random::new(seed);
        let reading = |k: u32| {
            let t = 0.005 * f64::from(k);
            let force = turned(0.0, t).inverse() * (bob(bob_m, t)[1] - Vec3::y() * GRAVITY_M_S2);
            ImuSample::new(Stamp::from_seconds(t), rate(t) + Vec3::new(0.01, -0.01, 0.0), force)
        };
        let samples = (0..300).map(reading).collect();
        let pairs = (0..30).map(|n| {
            let at = [0, 1].map(|k| 0.25 + f64::from(n + k) / 30.0);
            let points = (0..100).map(|_| {
                let [x, y] = [random.uniform(-0.6, 0.6), random.uniform(-0.45, 0.45)];
                let depth = random.uniform(1.0, 6.0);
                let rows = |y: f64| y / 0.9;
                let time = |k: usize, y: f64| at[k] - offset_s + rows(y) * readout_s;
                let (mut y_b, mut b) = (y, Vec3::zeros());
                for _ in 0..4 {
                    let (from, to) = (time(0, y), time(1, y_b));
                    let bobbed = turned(0.0, to).inverse() * (bob(bob_m, to)[0] - bob(bob_m, from)[0]);
                    b = turned(from, to).inverse() * Vec3::new(x, y, 1.0) * depth
                        - Vec3::new(0.1, 0.0, 0.9) * (to - from)
                        - bobbed;
                    y_b = b.y / b.z;
                }
                let noise = 0.4 / FOCAL_PX;
                let mut ray = |x: f64, y: f64| {
                    [
                        x * focal + noise * random.standard_normal(),
                        y * focal + noise * random.standard_normal(),
                    ]
                };
                FlowPoint { rays: [ray(x, y), ray(b.x / b.z, y_b)], rows: [rows(y), rows(y_b)] }
            });
            FlowPair { stamps: at.map(Stamp::from_seconds), points: points.collect() }
        });
        (pairs.collect(), samples)
    }

    #[test]
    fn offset_and_readout_are_found_from_a_second_of_pictures() {
        for (seed, offset_s, readout_s, focal) in
            [(1, 0.037, 0.02, 1.12), (2, -0.05, 0.0, 0.9), (3, 0.12, 0.03, 1.0), (4, 0.0, 0.012, 1.05)]
        {
            let (pairs, samples) = seen([offset_s, readout_s, focal], 0.0, seed);
            let found = flow_clocks(&pairs, &samples, &So3::identity(), FOCAL_PX).expect("an estimate");
            let off = [found.offset_s[0] - offset_s, found.readout_s[0] - readout_s];
            println!("seed {seed}: off by {off:?}, {found:?}");
            assert!(off[0].abs() < 0.004 && off[1].abs() < 0.008, "seed {seed}: {off:?} {found:?}");
            assert!(found.offset_s[1] < 0.01, "{found:?}");
        }
    }

    /// Their bob moves what is seen as a pitch at another time would.
    #[test]
    fn walkers_who_bob_as_they_pitch_have_the_same_clocks() {
        for (seed, offset_s) in [(6, 0.04), (7, -0.02), (8, 0.1)] {
            let (pairs, samples) = seen([offset_s, 0.01, 1.0], 0.015, seed);
            let off = |samples: &[ImuSample]| {
                let found = flow_clocks(&pairs, samples, &So3::identity(), FOCAL_PX).expect("an estimate");
                (found.offset_s[0] - offset_s).abs()
            };
            let level: Vec<_> = samples.iter().map(|s| ImuSample { accel: Vec3::y(), ..*s }).collect();
            let (with, without) = (off(&samples), off(&level));
            println!("seed {seed}: off by {with:.4} s, {without:.4} s by the gyroscope alone");
            assert!(with < 0.006 && without > 0.015, "seed {seed}: {with} s, {without} s");
        }
    }

    #[test]
    fn nothing_is_known_of_the_clocks_of_one_who_does_not_turn() {
        let (pairs, samples) = seen([0.0, 0.0, 1.0], 0.0, 5);
        let still: Vec<ImuSample> = samples.iter().map(|s| ImuSample { gyro: Vec3::zeros(), ..*s }).collect();
        let found = flow_clocks(&pairs[..12], &still, &So3::identity(), FOCAL_PX);
        assert!(found.is_none_or(|f| f.offset_s[1] > 0.02), "{found:?}");
        assert!(flow_clocks(&[], &samples, &So3::identity(), FOCAL_PX).is_none());
        assert!(flow_clocks(&pairs, &[], &So3::identity(), FOCAL_PX).is_none());
    }
}
