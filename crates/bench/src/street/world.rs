//! A synthetic street, closed to a ring: points on its walls, trees and ground, each seen from a stretch of the way, and
//! the frames that a walker's camera takes of them. Nothing is rendered: a frame is made of the features directly.
//!
//! Points are drawn metre by metre from the seed of that metre, so the street takes no memory however long it is.

use crate::store::camera;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_sensor::Stamp;
use cairn_vision::{Descriptor, Frame, Octaves, RectifiedCamera};
use std::collections::HashMap;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Points on each metre of the street.
const POINTS: u64 = 240;
/// Distance ahead up to which anything is seen, metres.
const FAR_M: f64 = 25.0;
/// Share of the points in view that the detector finds.
const FOUND: f64 = 0.6;
/// Features that show nothing lasting, as a share of all.
const CLUTTER: f64 = 0.1;
/// Standard deviation of a feature's pixel at the finest level.
const NOISE_PX: f64 = 0.4;

/// The scale pyramid of all frames.
pub const OCTAVES: Octaves = Octaves { levels: 8, factor: 1.2 };

/// A point of the street.
#[derive(Clone, Copy, Debug)]
struct Point {
    position: Vec3,
    descriptor: Descriptor,
    angle: f32,
    /// Smallest and greatest distance from which it is found, metres.
    range_m: [f64; 2],
}

/// A frame, and the point that each of its features shows.
#[derive(Clone, Debug)]
pub struct View {
    /// The features.
    pub frame: Arc<Frame>,
    /// For each feature its point, named by metre and number; `None` for clutter.
    pub points: Vec<Option<u64>>,
}

/// The street.
#[derive(Debug)]
pub struct Street {
    length_m: usize,
    features: usize,
    /// The metres in view, drawn once.
    drawn: HashMap<usize, Vec<Point>>,
}

impl Street {
    /// A ring of this length, seen with at most this many features a frame.
    pub fn new(length_m: usize, features: usize) -> Self {
        Self { length_m, features, drawn: HashMap::new() }
    }

    /// The pose at a distance along the way, metres; the camera looks ahead, y is down.
    pub fn pose(&self, along_m: f64) -> Se3 {
        let radius = self.length_m as f64 / std::f64::consts::TAU;
        let turn = along_m / radius;
        let sway = 0.05 * (0.9 * along_m).sin();
        let heading = So3::exp(&Vec3::new(0.0, FRAC_PI_2 - turn + 0.05 * (0.4 * along_m).sin(), 0.0));
        let at = Vec3::new(
            (radius + sway) * turn.sin(),
            0.03 * (5.0 * along_m).sin(),
            radius - (radius + sway) * turn.cos(),
        );
        Se3::new(heading, at)
    }

    /// Where a point is.
    pub fn position(&mut self, point: u64) -> Vec3 {
        let (metre, n) = ((point / POINTS) as usize, (point % POINTS) as usize);
        self.metre(metre)[n].position
    }

    fn metre(&mut self, metre: usize) -> &[Point] {
        let radius = self.length_m as f64 / std::f64::consts::TAU;
        self.drawn.entry(metre).or_insert_with(|| {
            let mut rng = Random::stream(7, metre as u64);
            let mut point = || {
                let side = if rng.chance(0.5) { 1.0 } else { -1.0 };
                let (aside, height) = match rng.unit() {
                    // A wall, the ground, something in between.
                    u if u < 0.6 => (side * rng.uniform(5.0, 6.5), rng.uniform(-6.0, 1.5)),
                    u if u < 0.75 => (side * rng.uniform(0.5, 5.0), 1.5),
                    _ => (side * rng.uniform(1.5, 5.0), rng.uniform(-3.0, 1.5)),
                };
                let turn = (metre as f64 + rng.unit()) / radius;
                let out = radius + aside;
                let words: [u64; 4] = std::array::from_fn(|_| rng.bits());
                let far = rng.uniform(5.0, FAR_M);
                Point {
                    position: Vec3::new(out * turn.sin(), height, radius - out * turn.cos()),
                    descriptor: std::array::from_fn(|i| words[i / 8].to_le_bytes()[i % 8]),
                    angle: rng.uniform_f32(-3.0, 3.0),
                    range_m: [0.5 * far, far],
                }
            };
            (0..POINTS).map(|_| point()).collect()
        })
    }

    /// What the camera sees at a distance along the way; `seed` draws the noise.
    pub fn see(&mut self, along_m: f64, stamp_s: f64, seed: u64) -> View {
        let (camera, camera_from_world) = (camera(), self.pose(along_m).inverse());
        let mut rng = Random::stream(seed, along_m.to_bits());
        let mut frame = Frame::default();
        frame.stamp = Stamp::from_seconds(stamp_s);
        let mut points = Vec::new();
        let most = (self.features as f64 * (1.0 - CLUTTER)) as usize;
        let first = along_m.floor() as usize;
        for metre in first..=first + FAR_M as usize {
            let metre = metre % self.length_m;
            for n in 0..POINTS {
                let point = self.metre(metre)[n as usize];
                let p = camera_from_world * point.position;
                let distance = p.norm();
                let in_range = point.range_m[0] < distance && distance < point.range_m[1];
                let Some([u, v, _]) =
                    camera.project(&p).filter(|[u, v, _]| in_range && camera.contains(*u, *v))
                else {
                    continue;
                };
                if frame.len() >= most || !rng.chance(FOUND) {
                    continue;
                }
                let level = ((point.range_m[1] / distance).ln() / OCTAVES.factor.ln()).floor();
                let mut descriptor = point.descriptor;
                for _ in 0..rng.below(24) {
                    let bit = rng.below(256);
                    descriptor[bit / 8] ^= 1 << (bit % 8);
                }
                let noise = NOISE_PX * OCTAVES.scale(level as u8);
                let at = [u + rng.normal(0.0, noise), v + rng.normal(0.0, noise)];
                let right = u - camera.baseline_fx / p.z + rng.normal(0.0, noise);
                let disparity = (at[0] - right).max(0.1);
                push(
                    &mut frame,
                    at,
                    level as u8,
                    point.angle,
                    descriptor,
                    camera.baseline_fx / disparity,
                    &camera,
                );
                points.push(Some(metre as u64 * POINTS + n));
            }
        }
        let clutter = (frame.len() as f64 * CLUTTER / (1.0 - CLUTTER)) as usize;
        for _ in 0..clutter {
            let words: [u64; 4] = std::array::from_fn(|_| rng.bits());
            let at = [752.0 * rng.unit(), 480.0 * rng.unit()];
            let descriptor = std::array::from_fn(|i| words[i / 8].to_le_bytes()[i % 8]);
            let angle = rng.uniform_f32(-3.0, 3.0);
            push(&mut frame, at, rng.below(8) as u8, angle, descriptor, f64::NAN, &camera);
            points.push(None);
        }
        frame.index(&camera);
        // Metres that lie behind are not seen again until the ring is closed.
        self.drawn.retain(|metre, _| (*metre + self.length_m - first % self.length_m) % self.length_m < 80);
        // A clone takes no more memory than it needs.
        View { frame: Arc::new(frame.clone()), points }
    }
}

fn push(
    frame: &mut Frame,
    at: [f64; 2],
    octave: u8,
    angle: f32,
    descriptor: Descriptor,
    depth: f64,
    camera: &RectifiedCamera,
) {
    let px = at.map(|v| v as f32);
    frame.raw.push(px);
    frame.px.push(px);
    frame.octave.push(octave);
    frame.angle.push(angle);
    frame.descriptors.push(descriptor);
    let depth = if depth < 10.0 * camera.close_depth { depth } else { f64::NAN };
    frame.depth.push(depth as f32);
    frame.right_x.push((at[0] - camera.baseline_fx / depth) as f32);
}
