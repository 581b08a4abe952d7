//! Initialisation at many times of a recording: true poses with noise at key frame rate, in a frame with arbitrary
//! orientation and unit of length, like a monocular map.

use super::data::{ImuRecording, imu_from_camera, links};
use super::drift::median_and_p95;
use super::reference::Reference;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{
    Bias, GateKind, ImuBuffer, Initial, InitialiseConfig, OffsetConfig, Scale, Seen, SeenPose, initialise,
    time_offset,
};
use cairn_random::Random;
use cairn_sensor::{ImuSample, Stamp};
use serde::Serialize;
use std::collections::BTreeMap;

/// Seconds between key frames.
const KEY_FRAME_S: f64 = 0.25;
/// Seconds between images for estimating the offset.
const IMAGE_S: f64 = 0.05;
/// Seconds of images for estimating the offset.
const OFFSET_S: f64 = 10.0;
/// Attempts stop after this time, seconds.
const MOST_S: f64 = 15.0;
/// Seconds between starts.
const START_S: f64 = 2.0;

/// The sampling of the IMU data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// As recorded.
    Whole,
    /// Every second sample unchanged, with aliasing of vibrations above half the new rate.
    Every2nd,
    /// The means of pairs, as from a sensor configured to that rate.
    Pairs,
}

/// How the data are degraded.
#[derive(Clone, Copy, Debug)]
pub struct Condition {
    /// Name of the row.
    pub name: &'static str,
    /// Standard deviation of a camera rotation, degrees, per axis.
    pub rotation_deg: f64,
    /// Standard deviation of a camera position: this fraction of the median step between key frames, plus a millimetre,
    /// per axis.
    pub place_part: f64,
    /// Sampling of the IMU.
    pub rate: Rate,
    /// Fraction of samples lost.
    pub lost: f64,
    /// Offset of the image clock: `t_imu + offset = t_image`.
    pub offset_s: f64,
    /// Whether the offset is estimated and corrected first.
    pub corrects: bool,
    /// Random steps of both biases every ten seconds: rad/s and m/s^2, per axis.
    pub bias_step: [f64; 2],
}

const PLAIN: Condition = Condition {
    name: "0.1 deg, 0.5 %",
    rotation_deg: 0.1,
    place_part: 0.005,
    rate: Rate::Whole,
    lost: 0.0,
    offset_s: 0.0,
    corrects: false,
    bias_step: [0.0; 2],
};

/// All rows.
pub const CONDITIONS: [Condition; 10] = [
    PLAIN,
    Condition { name: "0.3 deg", rotation_deg: 0.3, ..PLAIN },
    Condition { name: "half the IMU rate, pairs", rate: Rate::Pairs, ..PLAIN },
    Condition { name: "half the IMU rate, every 2nd", rate: Rate::Every2nd, ..PLAIN },
    Condition { name: "1 % lost", lost: 0.01, ..PLAIN },
    Condition { name: "bias steps", bias_step: [0.003, 0.05], ..PLAIN },
    Condition { name: "+20 ms, not known", offset_s: 0.02, ..PLAIN },
    Condition { name: "+20 ms, found first", offset_s: 0.02, corrects: true, ..PLAIN },
    Condition { name: "-20 ms, found first", offset_s: -0.02, corrects: true, ..PLAIN },
    Condition { name: "0 ms, found first", corrects: true, ..PLAIN },
];

/// A row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Tried {
    /// Recording.
    pub name: &'static str,
    /// Condition.
    pub condition: &'static str,
    /// Number of starts.
    pub starts: usize,
    /// Starts with an accepted metric estimate within fifteen seconds.
    pub accepted: usize,
    /// Of those, with an initial scale error above 5 %.
    pub wrong: usize,
    /// Seconds to the first estimate: median and 95th percentile.
    pub first_s: [f64; 2],
    /// Scale error in percent at the first estimate, with 5 s and with 15 s of key frames.
    pub scale_percent: [[f64; 2]; 3],
    /// Root mean square of the first scale's error over its standard deviation.
    pub scale_over_sigma: f64,
    /// Error of gravity's direction at the first estimate, degrees.
    pub gravity_deg: [f64; 2],
    /// Error of the gyroscope bias at the first estimate, rad/s.
    pub gyro_bias: [f64; 2],
    /// Error of the accelerometer bias at the first estimate, m/s^2.
    pub accel_bias: [f64; 2],
    /// Fitted noise as a multiple of the data sheet's: medians for gyroscope and accelerometer.
    pub noise_times: [f64; 2],
    /// Error of the offset, ms: median and maximum of those found.
    pub offset_ms: [f64; 2],
    /// Number of offsets found.
    pub offsets: usize,
    /// How often each gate failed in the last attempt of starts that were never accepted.
    pub stopped: BTreeMap<String, usize>,
}

/// Result of one start.
#[derive(Default)]
struct Start {
    first: Option<(f64, Errors)>,
    at: [Option<Errors>; 2],
    offset_ms: Option<f64>,
    stopped: Vec<GateKind>,
}

struct Errors {
    scale_percent: f64,
    over_sigma: f64,
    gravity_deg: f64,
    gyro: f64,
    accel: f64,
    noise: [f64; 2],
}

/// Runs all starts of a recording under a condition.
pub fn measure(motion: &ImuRecording, reference: &Reference, condition: &Condition, every: usize) -> Tried {
    let (first, last) = motion.span();
    let (samples, steps) = degraded(motion, condition);
    let mut sensor = motion.sensor.clone();
    sensor.rate_hz /= if condition.rate == Rate::Whole { 1.0 } else { 2.0 };
    let mut starts = Vec::new();
    let mut from = first.plus_seconds(START_S);
    while last - from > MOST_S + 0.5 {
        starts.push(from);
        from = from.plus_seconds(START_S);
    }
    // Starts with a gap in the ground truth are left out.
    let whole = |from: &Stamp| Case::times(*from).iter().all(|t| reference.pose(motion, *t).is_some());
    starts.retain(whole);
    let run = |(i, from): (usize, &Stamp)| {
        let case = Case { motion, reference, condition, samples: &samples, steps: &steps, sensor: &sensor };
        case.start(*from, i as u64)
    };
    let results: Vec<Start> = starts.iter().enumerate().step_by(every.max(1)).map(run).collect();
    summary(motion.name, condition.name, &results)
}

fn summary(name: &'static str, condition: &'static str, results: &[Start]) -> Tried {
    let firsts = || results.iter().filter_map(|s| s.first.as_ref());
    let of =
        |f: &dyn Fn(&Errors) -> f64| median_and_p95(&mut firsts().map(|(_, e)| f(e)).collect::<Vec<_>>());
    let at = |k: usize| {
        let values = results.iter().filter_map(|s| s.at[k].as_ref());
        median_and_p95(&mut values.map(|e| e.scale_percent.abs()).collect::<Vec<_>>())
    };
    let n = firsts().count();
    let mut offsets: Vec<f64> = results.iter().filter_map(|s| s.offset_ms).collect();
    let mut stopped = BTreeMap::new();
    for kind in results.iter().flat_map(|s| &s.stopped) {
        *stopped.entry(format!("{kind:?}")).or_insert(0) += 1;
    }
    let median = median_and_p95(&mut offsets)[0];
    Tried {
        name,
        condition,
        starts: results.len(),
        accepted: n,
        wrong: firsts().filter(|(_, e)| e.scale_percent.abs() > 5.0).count(),
        first_s: median_and_p95(&mut firsts().map(|(s, _)| *s).collect::<Vec<_>>()),
        scale_percent: [of(&|e| e.scale_percent.abs()), at(0), at(1)],
        scale_over_sigma: (firsts().map(|(_, e)| e.over_sigma.powi(2)).sum::<f64>() / n.max(1) as f64).sqrt(),
        gravity_deg: of(&|e| e.gravity_deg),
        gyro_bias: of(&|e| e.gyro),
        accel_bias: of(&|e| e.accel),
        noise_times: [of(&|e| e.noise[0])[0], of(&|e| e.noise[1])[0]],
        offset_ms: [median, offsets.last().copied().unwrap_or(f64::NAN)],
        offsets: offsets.len(),
        stopped,
    }
}

/// The samples under the condition, and the added biases by time.
fn degraded(motion: &ImuRecording, c: &Condition) -> (Vec<ImuSample>, Vec<(Stamp, Bias)>) {
    let mut rng = Random::stream(7, 1);
    let mut added = Bias::default();
    let mut steps = Vec::new();
    let mut next = motion.samples.first().map_or(Stamp(0), |s| s.stamp);
    let mut out = Vec::with_capacity(motion.samples.len());
    for (i, sample) in motion.samples.iter().enumerate() {
        if sample.stamp >= next {
            let mut draw =
                |s: f64| Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s;
            added.gyro += draw(c.bias_step[0]);
            added.accel += draw(c.bias_step[1]);
            steps.push((next, added));
            next = next.plus_seconds(10.0);
        }
        if (c.rate != Rate::Whole && i % 2 == 1) || rng.unit() < c.lost {
            continue;
        }
        let mut sample = *sample;
        if let (Rate::Pairs, Some(next)) = (c.rate, motion.samples.get(i + 1)) {
            sample.stamp = sample.stamp.plus_seconds(0.5 * (next.stamp - sample.stamp));
            sample.gyro = (sample.gyro + next.gyro) * 0.5;
            sample.accel = (sample.accel + next.accel) * 0.5;
        }
        out.push(ImuSample { gyro: sample.gyro + added.gyro, accel: sample.accel + added.accel, ..sample });
    }
    (out, steps)
}

struct Case<'a> {
    motion: &'a ImuRecording,
    reference: &'a Reference,
    condition: &'a Condition,
    samples: &'a [ImuSample],
    steps: &'a [(Stamp, Bias)],
    sensor: &'a cairn_sensor::ImuSensor,
}

impl Case<'_> {
    /// One start: first the offset if the condition corrects it, then attempts with more and more key frames.
    fn start(&self, from: Stamp, stream: u64) -> Start {
        let mut rng = Random::stream(3, stream);
        let c = self.condition;
        let mut out = Start::default();
        let camera = imu_from_camera();
        let sigma = c.rotation_deg.to_radians();
        let mut corrected = 0.0;
        if c.corrects {
            let mut seen = |sigma: f64| -> Vec<(Stamp, So3)> {
                let times = (0..(OFFSET_S / IMAGE_S) as usize).map(|k| from.plus_seconds(IMAGE_S * k as f64));
                let mut pose = |t: Stamp| {
                    let turned = self.motion.pose(t)?.rotation * camera.rotation;
                    Some((t.plus_seconds(c.offset_s), turned * So3::exp(&vector(&mut rng, sigma))))
                };
                times.filter_map(&mut pose).collect()
            };
            let near = self.near(from, from.plus_seconds(OFFSET_S));
            let find =
                |poses: &[_]| time_offset(poses, near, &camera.rotation, &OffsetConfig::default()).ok();
            // The clocks of the recording drift by milliseconds: the estimate from exact poses of these seconds is the
            // reference.
            let exact = find(&seen(0.0));
            if let (Some(found), Some(exact)) = (find(&seen(sigma)), exact) {
                out.offset_ms = Some((found.offset_s - exact.offset_s).abs() * 1e3);
                corrected = found.offset_s;
            }
        }
        // A map with its own unit of length and axes.
        let unit = rng.uniform(-1.5, 1.5).exp();
        let turn = So3::exp(&vector(&mut rng, 1.0));
        let Some((poses, place_sigma)) = self.poses(from, unit, &turn, &mut rng) else { return out };
        let mut buffer = ImuBuffer::new(self.sensor, 0.1);
        let moved = |s: &ImuSample| ImuSample { stamp: s.stamp.plus_seconds(corrected), ..*s };
        buffer.push(&self.near(from, from.plus_seconds(MOST_S)).iter().map(moved).collect::<Vec<_>>());
        let stamps: Vec<Stamp> = poses.iter().map(|p| p.stamp).collect();
        let Some(links) = links(&buffer, Bias::default(), &stamps) else { return out };
        let with = |n: usize| {
            let seen = Seen {
                poses: &poses[..n],
                rotation_sigma: sigma.max(1e-3),
                position_sigma: place_sigma / unit,
            };
            let config = InitialiseConfig::default();
            let attempt = initialise(&seen, &links[..n - 1], &camera, Scale::Free, &config);
            let good = attempt.accepted().is_some();
            let stopped: Vec<GateKind> = attempt.failed().map(|g| g.kind).collect();
            let errors = attempt.found.map(|f| self.errors(&f, unit, &turn, stamps[0], stamps[n - 1]));
            (good, errors, stopped)
        };
        for n in (7..=poses.len()).step_by(2) {
            let (good, errors, stopped) = with(n);
            out.stopped = stopped;
            if let (true, Some(errors)) = (good, errors) {
                out.first = Some((stamps[n - 1] - stamps[0], errors));
                break;
            }
        }
        if out.first.is_some() {
            for (slot, seconds) in out.at.iter_mut().zip([5.0, 15.0]) {
                let n = ((seconds / KEY_FRAME_S) as usize + 1).min(poses.len());
                let (good, errors, _) = with(n);
                *slot = errors.filter(|_| good);
            }
        }
        out
    }

    /// The times of the key frames of a start.
    fn times(from: Stamp) -> Vec<Stamp> {
        (0..=(MOST_S / KEY_FRAME_S) as usize).map(|k| from.plus_seconds(KEY_FRAME_S * k as f64)).collect()
    }

    fn near(&self, from: Stamp, to: Stamp) -> &[ImuSample] {
        let a = self.samples.partition_point(|s| s.stamp < from.plus_seconds(-0.3));
        let b = self.samples.partition_point(|s| s.stamp < to.plus_seconds(0.3));
        &self.samples[a..b]
    }

    /// Key frames with noise, and the standard deviation of a position in metres.
    fn poses(&self, from: Stamp, unit: f64, turn: &So3, rng: &mut Random) -> Option<(Vec<SeenPose>, f64)> {
        let c = self.condition;
        let times: Vec<Stamp> = (0..=(MOST_S / KEY_FRAME_S) as usize)
            .map(|k| from.plus_seconds(KEY_FRAME_S * k as f64))
            .collect();
        let truth: Option<Vec<Se3>> =
            times.iter().map(|t| Some(self.motion.pose(*t)? * imu_from_camera())).collect();
        let truth = truth?;
        let mut steps: Vec<f64> =
            truth.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).collect();
        let sigma = c.place_part * median_and_p95(&mut steps)[0] + 0.001;
        let poses = times.iter().zip(&truth).map(|(t, camera)| {
            let rotation = *turn * camera.rotation * So3::exp(&vector(rng, c.rotation_deg.to_radians()));
            let place = *turn * (camera.translation + vector(rng, sigma)) / unit;
            SeenPose { stamp: t.plus_seconds(c.offset_s), world_from_camera: Se3::new(rotation, place) }
        });
        Some((poses.collect(), sigma))
    }

    fn errors(&self, found: &Initial, unit: f64, turn: &So3, from: Stamp, to: Stamp) -> Errors {
        let log = (found.scale / unit).ln();
        let middle = from.plus_seconds(0.5 * (to - from));
        let mut bias = self.reference.bias(middle);
        if let Some((_, added)) = self.steps.iter().rev().find(|(t, _)| *t <= middle) {
            bias.gyro += added.gyro;
            bias.accel += added.accel;
        }
        Errors {
            scale_percent: 100.0 * (log.exp() - 1.0),
            over_sigma: log / found.scale_sigma,
            gravity_deg: found.gravity.vector().angle(&(*turn * self.reference.gravity)).to_degrees(),
            gyro: (found.bias.gyro - bias.gyro).norm(),
            accel: (found.bias.accel - bias.accel).norm(),
            noise: found.noise_times,
        }
    }
}

fn vector(rng: &mut Random, sigma: f64) -> Vec3 {
    Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma
}
