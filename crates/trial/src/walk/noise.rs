//! Errors between the true poses and the guide's input: noise, drift, corrections, losses.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_guide::Confidence;
use cairn_random::Random;
use cairn_sensor::Stamp;

/// The guide's input at one instant.
pub(crate) struct Reading {
    pub stamp: Stamp,
    pub odom_from_camera: Se3,
    pub confidence: Confidence,
    /// The odom frame relative to the world, when the map was corrected just now.
    pub corrected: Option<Se3>,
}

/// The level of pose errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// Exact.
    None,
    /// White noise of 2 cm and half a degree; drift of 0.5 % of the distance and 0.1 degrees a metre, removed
    /// by a correction every 10 m; once or twice in 100 m tracking is lost or the camera silent for 1 to 3 s.
    Usual,
    /// The same, but each loss lasts for 3 to 40 s, and the first pose comes as late: what whoever waits hears.
    LongLosses,
}

/// Makes noisy readings from true poses.
pub struct PoseNoise {
    noise: Noise,
    random: Random,
    odom_from_world: Se3,
    last: Option<Vec3>,
    walked_m: f64,
    corrected_at_m: f64,
    outage_at_m: f64,
    /// The least and the most.
    lasts_s: [f64; 2],
    outage: Option<(Stamp, bool)>,
    held: Option<(Stamp, Se3)>,
    drift: Vec3,
}

impl PoseNoise {
    /// Noise from a seed.
    pub fn new(noise: Noise, seed: u64) -> Self {
        let mut random = Random::new(seed ^ 0xA015E);
        let outage_at_m = random.uniform(10.0, 90.0);
        let (outage_at_m, lasts_s) = match noise {
            Noise::LongLosses => (-1.0, [3.0, 40.0]),
            Noise::None | Noise::Usual => (outage_at_m, [1.0, 3.0]),
        };
        let drift = Vec3::new(
            random.normal(0.0, 0.004),
            random.normal(0.0, 0.004),
            random.normal(0.0, 0.1_f64.to_radians()),
        );
        let odom_from_world = Se3::identity();
        Self {
            noise,
            random,
            odom_from_world,
            last: None,
            walked_m: 0.0,
            corrected_at_m: 0.0,
            outage_at_m,
            lasts_s,
            outage: None,
            held: None,
            drift,
        }
    }

    pub(crate) fn read(&mut self, world_from_camera: &Se3, now: Stamp) -> Reading {
        let good = |pose| Reading {
            stamp: now,
            odom_from_camera: pose,
            confidence: Confidence::Good,
            corrected: None,
        };
        if self.noise == Noise::None {
            return good(*world_from_camera);
        }
        let step = self
            .last
            .replace(world_from_camera.translation)
            .map_or(0.0, |l| (world_from_camera.translation - l).norm());
        self.walked_m += step;
        let at = world_from_camera.translation;
        let twist = So3::exp(&(Vec3::z() * self.drift.z * step));
        // Drift rotates the odom frame about the walker, and shifts it.
        let about = Se3::new(twist, at - twist * at + Vec3::new(self.drift.x, self.drift.y, 0.0) * step);
        self.odom_from_world = self.odom_from_world * about;
        let corrected = (self.walked_m - self.corrected_at_m > 10.0).then_some(self.odom_from_world);
        if corrected.is_some() {
            self.corrected_at_m = self.walked_m;
        }
        let mut white = |s: f64| self.random.normal(0.0, s);
        let shake = Vec3::new(white(0.02), white(0.02), white(0.02));
        let turn = So3::exp(&(Vec3::new(white(1.0), white(1.0), white(1.0)) * 0.5_f64.to_radians()));
        let pose = self.odom_from_world * *world_from_camera;
        let pose = Se3::new(pose.rotation * turn, pose.translation + shake);
        let mut reading = Reading { corrected, ..good(pose) };
        if self.walked_m > self.outage_at_m {
            self.outage_at_m = self.walked_m + self.random.uniform(30.0, 100.0);
            let until = now.plus_seconds(self.random.uniform(self.lasts_s[0], self.lasts_s[1]));
            self.outage = Some((until, self.random.chance(0.5)));
        }
        let (stamp, held) = *self.held.get_or_insert((now, pose));
        match self.outage {
            Some((until, silent)) if now < until => {
                reading.odom_from_camera = held;
                reading.stamp = if silent { stamp } else { now };
                reading.confidence = if silent { Confidence::Good } else { Confidence::Lost };
            }
            _ => {
                self.outage = None;
                self.held = Some((now, pose));
            }
        }
        reading
    }
}
