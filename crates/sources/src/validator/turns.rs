//! Whether the picture turns as the gyroscope does: a picture that is mirrored, upside down or turned by a quarter, and an IMU that is
//! mounted otherwise than its calibration says.
//!
//! In: pictures of the first camera between which the gyroscope turns by some degrees. The rotation between the two is found from
//! features alone (Wahba's problem over their bearings). What both call one rotation differs by how the two sit on each other:
//! of the 24 ways along axes, another than the calibrated one explains the turns, or none does and nothing is said. A mirrored picture
//! turns as one turned by 180 degrees about its x or y axis: rotations are pseudovectors.

use super::matched::matched;
use super::watch::Watch;
use cairn_geometry::{So3, Vec3, umeyama};
use cairn_random::Random;
use cairn_sensor::{Camera, FramePacket, GrayImage, ImuSample, Rig, Stamp};
use cairn_vision::{Features, OrbConfig, OrbExtractor};
use nalgebra::Vector2;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Seconds between the two pictures, at least and at most: motion in between turns the view less than the camera turns.
const BETWEEN_S: [f64; 2] = [0.09, 0.35];
/// Radians by which the gyroscope turns in between, at least.
const LEAST_TURN: f64 = 0.05;
/// Seconds between two looks, and looks that are needed.
const APART_S: f64 = 0.4;
const LOOKS: usize = 8;
/// Features of each picture.
const FEATURES: usize = 500;
/// Bearings that a rotation explains to that many radians: motion beside the turn moves near things by more.
const AGREE_RAD: f64 = 0.015;
const LEAST_AGREE: usize = 40;
const SAMPLES: usize = 100;
/// The part of the gyroscope's turns by which those of the picture are off, at most all of each: as calibrated, from which on something
/// is wrong; by another way to sit on each other, up to which that explains it, and by how much better. Sound recordings: 0.10 (`house`)
/// to 0.39 (MH_01, moved by hand before near things), data/phone/b, whose gyroscope is 37 ms late, 0.27. Turned over or with an IMU by
/// other axes: 0.84 to 1.00, by the right way 0.16 to 0.47.
const OFF: f64 = 0.6;
const EXPLAINED: f64 = 0.5;
const BETTER: f64 = 0.6;
/// Other ways as good as that are named too: who only turns about one axis cannot tell them apart.
const AS_GOOD: f64 = 0.1;

/// Turns of the picture that have a name, about the camera's axes, in quarters.
const NAMED: [([f64; 3], &str); 5] = [
    ([2.0, 0.0, 0.0], "mirrored left to right"),
    ([0.0, 2.0, 0.0], "mirrored top to bottom"),
    ([0.0, 0.0, 2.0], "upside down"),
    ([0.0, 0.0, 1.0], "turned by a quarter, counterclockwise"),
    ([0.0, 0.0, -1.0], "turned by a quarter, clockwise"),
];

/// Whether the first camera's pictures turn as the gyroscope does.
#[derive(Clone, Debug)]
pub(super) struct TurnWatch {
    name: String,
    camera: Camera,
    camera_from_imu: So3,
    extractor: OrbExtractor,
    features: [Features; 2],
    before: Option<(Stamp, Arc<GrayImage>)>,
    /// How the gyroscope has turned since, in its own axes: `before_from_now`.
    turned: So3,
    reading: Option<ImuSample>,
    last: Option<Stamp>,
    /// Rotation vectors in the camera: by the picture, by the gyroscope.
    turns: Vec<[Vec3; 2]>,
}

impl TurnWatch {
    /// For the first camera and the IMU of a rig; `None` without them.
    pub fn new(rig: &Rig) -> Option<Self> {
        let (camera, imu) = (rig.cameras.first()?, rig.imu.as_ref()?);
        Some(Self {
            name: camera.name.clone(),
            camera: camera.camera,
            camera_from_imu: (camera.body_from_camera.inverse() * imu.body_from_imu).rotation,
            extractor: OrbExtractor::new(OrbConfig { features: FEATURES, levels: 4, ..OrbConfig::default() }),
            features: Default::default(),
            before: None,
            turned: So3::identity(),
            reading: None,
            last: None,
            turns: Vec::new(),
        })
    }

    /// `before_from_now` as two pictures show it.
    fn between(&mut self, before: &GrayImage, now: &GrayImage) -> Option<So3> {
        for (image, features) in [before, now].into_iter().zip(&mut self.features) {
            self.extractor.extract(image, features);
        }
        let [a, b] = &self.features;
        let bearing = |px: [f32; 2]| self.camera.unproject(&Vector2::from(px.map(f64::from)));
        let pairs = matched(a, b).filter_map(|[before, now]| Some([bearing(before)?, bearing(now)?]));
        rotation(&pairs.collect::<Vec<_>>())
    }

    fn words(&self) -> Option<String> {
        let off = |way: &So3| {
            let off =
                self.turns.iter().map(|[seen, felt]| ((*way * *seen - felt).norm() / felt.norm()).min(1.0));
            off.sum::<f64>() / self.turns.len() as f64
        };
        let as_calibrated = off(&So3::identity());
        let best = ways().map(|way| off(&way)).fold(f64::INFINITY, f64::min);
        if as_calibrated < OFF || best > f64::min(EXPLAINED, BETTER * as_calibrated) {
            return None;
        }
        let quarters = |turn: &[f64; 3]| So3::exp(&(Vec3::from(*turn) * FRAC_PI_2));
        let named = NAMED.iter().filter(|(turn, _)| off(&quarters(turn)) < best + AS_GOOD);
        let mut names: Vec<&str> = named.map(|(_, name)| *name).collect();
        if names.is_empty() {
            names.push("of a camera that sits on the IMU by other axes than calibrated");
        }
        Some(format!(
            "the picture of {} turns otherwise than the gyroscope, as if it were {}: give the picture as the camera delivers it, or \
             correct the IMU's calibration; until then the IMU only misleads",
            self.name,
            names.join(", or ")
        ))
    }
}

impl Watch for TurnWatch {
    fn packet(&mut self, packet: &FramePacket) -> Option<String> {
        if self.turns.len() >= LOOKS {
            return None;
        }
        for reading in &packet.imu {
            if let Some(before) = self.reading.replace(*reading) {
                let middle = (before.gyro + reading.gyro) * 0.5;
                self.turned =
                    self.turned * So3::exp(&(middle * (reading.stamp - before.stamp).clamp(0.0, 0.1)));
            }
        }
        let image = packet.images.first()?;
        let since = self.before.as_ref().map_or(f64::INFINITY, |(stamp, _)| packet.stamp - *stamp);
        let turns = since >= BETWEEN_S[0] && self.turned.angle() >= LEAST_TURN;
        if !turns && since < BETWEEN_S[1] {
            return None;
        }
        let (now, turned) =
            ((packet.stamp, image.clone()), std::mem::replace(&mut self.turned, So3::identity()));
        let (_, before) = self.before.replace(now).filter(|_| turns && since < BETWEEN_S[1])?;
        if self.last.is_some_and(|last| packet.stamp - last < APART_S)
            || !turned.log().iter().all(|v| v.is_finite())
        {
            return None;
        }
        self.last = Some(packet.stamp);
        let seen = self.between(&before, image)?;
        self.turns.push([seen.log(), self.camera_from_imu * turned.log()]);
        if self.turns.len() < LOOKS { None } else { self.words() }
    }
}

/// The 24 rotations that map axes to axes.
fn ways() -> impl Iterator<Item = So3> {
    let quarter = |axis: Vec3, k: usize| So3::exp(&(axis * FRAC_PI_2 * k as f64));
    let faces = (0..4).map(move |k| quarter(Vec3::y(), k)).chain([1, 3].map(|k| quarter(Vec3::x(), k)));
    faces.flat_map(move |face| (0..4).map(move |k| face * quarter(Vec3::z(), k)))
}

/// The rotation that maps second bearings to first ones for the most pairs.
fn rotation(pairs: &[[Vec3; 2]]) -> Option<So3> {
    let agrees = |r: &So3| pairs.iter().filter(|[a, b]| (a - *r * *b).norm() < AGREE_RAD).collect::<Vec<_>>();
    let mut random = Random::new(pairs.len() as u64);
    let mut best = Vec::new();
    for _ in 0..SAMPLES {
        let sample = random.sample::<3>(pairs.len())?.map(|k| &pairs[k]);
        let found = wahba(&sample).map(|r| agrees(&r)).unwrap_or_default();
        if found.len() > best.len() {
            best = found;
        }
    }
    (best.len() >= LEAST_AGREE).then(|| wahba(&best))?
}

/// The rotation between directions: between these and their opposites, whose mean is zero, as points.
fn wahba(pairs: &[&[Vec3; 2]]) -> Option<So3> {
    let both = |k: usize| pairs.iter().flat_map(move |pair| [pair[k], -pair[k]]).collect::<Vec<_>>();
    umeyama(&both(0), &both(1), false).ok().map(|found| found.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ways_are_the_24_rotations_of_a_cube() {
        let all: Vec<So3> = ways().collect();
        assert_eq!(all.len(), 24);
        for (k, way) in all.iter().enumerate() {
            assert!(all[..k].iter().all(|other| (other.inverse() * *way).angle() > 1.0), "{k} is another");
            assert!(way.matrix().iter().all(|v| (v.abs() - v.abs().round()).abs() < 1e-9), "along axes");
        }
    }
}
