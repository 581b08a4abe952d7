//! Adjustment of a whole map: `cargo bench -p cairn-inertial --bench whole_map [inertial|visual]`. Two laps through a
//! corridor around a yard, 4 key frames a second at 1.2 m/s: 2,000 key frames of one camera with IMU factors (a lap of
//! 300 m), and 5,000 of a stereo camera without (a lap of 750 m). Half of the points are met again on the other lap.
//! Prints time, steps, sizes and the peak of resident memory (Linux) of the process, so run one of them to measure its
//! memory.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, Gravity, ImuFactors, ImuLink, MotionFreedom, Preintegrated, SpeedAndBias};
use cairn_random::Random;
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use cairn_solve::{Bundle, BundleConfig, Freedom, NoFactors, Observation, Pinhole};
use std::time::Instant;

/// Seconds between key frames.
const STEP_S: f64 = 0.25;
/// Rate of the IMU, Hz.
const IMU_HZ: f64 = 200.0;
/// Walking pace, m/s.
const PACE_M_S: f64 = 1.2;
/// Laps; real maps drop redundant key frames where a place is visited often.
const LAPS: usize = 2;
/// Share of the points that are met again on another lap.
const MET_AGAIN: f64 = 0.5;
/// Observations of a key frame at most.
const OBSERVATIONS: usize = 300;
const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 2e-5, accel: 2e-3, accel_walk: 3e-3 };

fn main() {
    let only = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_default();
    if "inertial".contains(&only) {
        let course = Course { key_frames: 2000 };
        let mut map = map(&course, 0.0);
        let mut imu = imu_factors(&course);
        disturb(&mut map.bundle, Some(&mut imu));
        map.bundle.freedom[0] = Freedom::Tilt(Vec3::z());
        adjust("2,000 key frames of one camera with IMU factors", map, |bundle, config| {
            bundle.solve_with(&mut imu, config, || false)
        });
    }
    if "visual".contains(&only) {
        let mut map = map(&Course { key_frames: 5000 }, 50.0);
        disturb(&mut map.bundle, None);
        map.bundle.freedom[0] = Freedom::Fixed;
        adjust("5,000 key frames of a stereo camera", map, |bundle, config| {
            bundle.solve_with(&mut NoFactors, config, || false)
        });
    }
}

struct Map {
    bundle: Bundle,
    /// `world_from_camera` of each key frame.
    truth: Vec<Se3>,
}

/// An oval walked for some laps.
struct Course {
    key_frames: usize,
}

impl Course {
    /// Key frames of a lap.
    fn lap(&self) -> usize {
        self.key_frames / LAPS
    }

    /// `world_from_imu` at a time: looking ahead, swaying as a walker does.
    fn world_from_imu(&self, t: f64) -> Se3 {
        let rate = std::f64::consts::TAU / (self.lap() as f64 * STEP_S);
        let radius = PACE_M_S / rate;
        let at = |t: f64| {
            let sway =
                Vec3::new(0.03 * (5.1 * t).sin(), 0.02 * (4.3 * t).cos(), 1.5 + 0.03 * (11.0 * t).sin());
            Vec3::new(1.3 * radius * (rate * t).cos(), 0.7 * radius * (rate * t).sin(), 0.0) + sway
        };
        let ahead = at(t + 0.5) - at(t - 0.5);
        let yaw = ahead.y.atan2(ahead.x) + 0.1 * (1.3 * t).sin();
        let sway = Vec3::new(0.02 * (5.0 * t).sin(), 0.03 * (4.1 * t).cos(), 0.0);
        Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)) * So3::exp(&sway), at(t))
    }
}

/// The camera looks along the IMU's x, its y down.
fn imu_from_camera() -> Se3 {
    let axes = cairn_geometry::Mat3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    Se3::new(So3::from_matrix(&axes), Vec3::new(0.05, 0.02, -0.01))
}

/// A map without error but half a pixel of noise.
fn map(course: &Course, baseline_fx: f64) -> Map {
    let key_frames = course.key_frames;
    let mut rng = Random::new(7);
    let camera = Pinhole { fx: 450.0, fy: 450.0, cx: 320.0, cy: 240.0, baseline_fx };
    let truth: Vec<Se3> =
        (0..key_frames).map(|k| course.world_from_imu(k as f64 * STEP_S) * imu_from_camera()).collect();
    let mut bundle = Bundle {
        camera,
        own_cameras: Vec::new(),
        poses: truth.clone(),
        freedom: vec![Freedom::Free; key_frames],
        points: Vec::new(),
        observations: Vec::new(),
        calibrations: Vec::new(),
    };
    let lap = course.lap();
    let mut left = vec![OBSERVATIONS; key_frames];
    // Points are met on the lap they are made on, and a share of them on the others.
    for first in 0..key_frames {
        for _ in 0..60 {
            let ahead = Vec3::new(rng.uniform(-2.5, 2.5), rng.uniform(-1.2, 1.2), rng.uniform(2.0, 9.0));
            let point = truth[first] * ahead;
            let begin = bundle.observations.len();
            for k in (first % lap..key_frames).step_by(lap) {
                if k == first || rng.uniform(0.0, 1.0) < MET_AGAIN {
                    for frame in k.saturating_sub(6)..(k + 12).min(key_frames) {
                        observe(&mut bundle, &truth[frame], frame, point, &mut left[frame], &mut rng);
                    }
                }
            }
            if bundle.observations.len() < begin + 2 {
                bundle.observations.drain(begin..).for_each(|o| left[o.pose as usize] += 1);
            } else {
                bundle.points.push(point);
            }
        }
    }
    Map { bundle, truth }
}

fn observe(bundle: &mut Bundle, pose: &Se3, frame: usize, point: Vec3, left: &mut usize, rng: &mut Random) {
    let (c, q) = (bundle.camera, pose.inverse() * point);
    let (u, v) = (c.fx * q.x / q.z + c.cx, c.fy * q.y / q.z + c.cy);
    if *left == 0 || q.z < 0.5 || q.z > 12.0 || !(0.0..640.0).contains(&u) || !(0.0..480.0).contains(&v) {
        return;
    }
    *left -= 1;
    let mut noise = || 0.5 * rng.standard_normal();
    let (u, v) = (u + noise(), v + noise());
    let right = if c.baseline_fx > 0.0 { u - c.baseline_fx / q.z + noise() } else { f64::NAN };
    let pixel = [u, v, right];
    let point = bundle.points.len() as u32;
    bundle.observations.push(Observation { pose: frame as u32, point, pixel, weight: 1.0 });
}

/// Links between all neighbours, from the true motion's readings with white noise.
fn imu_factors(course: &Course) -> ImuFactors {
    let mut rng = Random::new(8);
    let at = |t: f64| course.world_from_imu(t);
    let velocity = |t: f64| (at(t + 1e-3).translation - at(t - 1e-3).translation) / 2e-3;
    let gravity = Gravity::level();
    let reading = |i: i64, rng: &mut Random| {
        let (t, h) = (i as f64 / IMU_HZ, 1e-3);
        let back = at(t).rotation.inverse();
        let gyro = (at(t - h).rotation.inverse() * at(t + h).rotation).log() / (2.0 * h);
        let accel = back * ((velocity(t + h) - velocity(t - h)) / (2.0 * h) - gravity.vector());
        let mut white = |density: f64| {
            let sigma = density * IMU_HZ.sqrt();
            Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma
        };
        let stamp = Stamp((i as f64 / IMU_HZ * 1e9).round() as i64);
        ImuSample::new(stamp, gyro + white(NOISE.gyro), accel + white(NOISE.accel))
    };
    let motions = (0..course.key_frames).map(|k| SpeedAndBias {
        velocity: velocity(k as f64 * STEP_S),
        bias: Bias::default(),
        freedom: MotionFreedom::Free,
    });
    let mut imu = ImuFactors::new(imu_from_camera(), gravity, motions.collect());
    let per_link = (STEP_S * IMU_HZ) as i64;
    for k in 1..course.key_frames {
        let samples = (k as i64 - 1) * per_link..=k as i64 * per_link;
        let samples = samples.map(|i| reading(i, &mut rng)).collect();
        let sum = Preintegrated::of(NOISE, Bias::default(), samples);
        imu.links.push(ImuLink { from: k - 1, to: k, sum });
    }
    imu
}

/// Moves everything off: a slow drift of poses as odometry has it, points and velocities at random.
fn disturb(bundle: &mut Bundle, imu: Option<&mut ImuFactors>) {
    let mut rng = Random::new(9);
    let mut random =
        |sigma: f64| Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma;
    let mut drift = Se3::identity();
    let before = bundle.poses.clone();
    for pose in bundle.poses.iter_mut().skip(1) {
        drift = Se3::new(
            So3::exp(&(drift.rotation.log() * 0.98 + random(2e-4))),
            drift.translation * 0.98 + random(4e-3),
        );
        *pose = *pose * drift;
    }
    // A point goes with the first key frame that observes it.
    let mut first = vec![None; bundle.points.len()];
    for o in &bundle.observations {
        first[o.point as usize].get_or_insert(o.pose as usize);
    }
    for (point, first) in bundle.points.iter_mut().zip(first) {
        let k = first.unwrap_or(0);
        *point = bundle.poses[k] * (before[k].inverse() * *point) + random(0.02);
    }
    for motion in imu.into_iter().flat_map(|imu| &mut imu.motions) {
        motion.velocity += random(0.02);
    }
}

fn adjust(name: &str, map: Map, mut solve: impl FnMut(&mut Bundle, &BundleConfig) -> cairn_solve::Report) {
    let Map { mut bundle, truth } = map;
    let (points, observations) = (bundle.points.len(), bundle.observations.len());
    println!(
        "{name}: {points} points, {observations} observations, resident {:.0} MB before",
        resident("VmRSS")
    );
    let (from, ran) = (Instant::now(), cpu_s());
    let mut cost_before = None;
    for iterations in [10, 10] {
        let config = BundleConfig { iterations, tolerance: 1e-4, first_damping: 1e-6, robust: true };
        let report = solve(&mut bundle, &config);
        let before = *cost_before.get_or_insert(report.cost_before);
        println!(
            "    {} steps ({:?}), cost {before:.4e} to {:.4e}, {:.1} s, {:.1} s on the processor",
            report.iterations,
            report.stop,
            report.cost_after,
            from.elapsed().as_secs_f64(),
            cpu_s() - ran
        );
    }
    let (first, rms) = (truth[0] * bundle.poses[0].inverse(), |s: f64, n: usize| (s / n as f64).sqrt());
    let apart = bundle.poses.iter().zip(&truth).map(|(p, t)| (first * *p).translation - t.translation);
    let error = rms(apart.map(|d| d.norm_squared()).sum(), truth.len());
    println!("    places {error:.4} m RMS off the truth; resident {:.0} MB at most", resident("VmHWM"));
}

/// Megabytes from `/proc/self/status`, not a number where the system does not say.
fn resident(key: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix(key));
    let kib =
        line.and_then(|l| l.trim_start_matches(':').trim().strip_suffix(" kB")?.trim().parse::<f64>().ok());
    kib.map_or(f64::NAN, |k| k * 1024.0 / 1e6)
}

/// Seconds that this thread has run, not a number where the system does not say.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|t| t.parse().ok()).map_or(f64::NAN, |ns: f64| ns * 1e-9)
}
