//! The motion sensors of a phone: readings at uneven times, from where the sensors are, with noise, bias and rounding.

use super::PhoneTraits;
use crate::walk::ContinuousTrajectory;
use cairn_geometry::Vec3;
use cairn_random::Random;
use cairn_sensor::{GRAVITY_M_S2, ImuSample, Stamp};

/// Half the interval of the difference that gives the angular acceleration, seconds.
const HALF_S: f64 = 1e-3;

/// Takes readings along a motion.
pub struct MotionSensors {
    traits: PhoneTraits,
    random: Random,
    gyro_bias: Vec3,
    accel_bias: Vec3,
    /// The time of the next reading, seconds.
    next_s: f64,
    nth: u64,
}

impl MotionSensors {
    /// Of this phone; `seed` selects the noise.
    pub fn new(traits: &PhoneTraits, seed: u64) -> Self {
        Self {
            traits: *traits,
            random: Random::stream(seed, 0x5E45),
            gyro_bias: traits.gyro_bias,
            accel_bias: traits.accel_bias,
            next_s: traits.imu_start_s,
            nth: 0,
        }
    }

    /// The readings whose time is before `until_s` and that were not taken yet; stamps are times of the motion.
    pub fn until(&mut self, motion: &ContinuousTrajectory, until_s: f64) -> Vec<ImuSample> {
        let mut out = Vec::new();
        while self.next_s < until_s {
            out.push(self.reading(motion, self.next_s));
            self.nth += 1;
            // A reading is late or early by less than half an interval, so that they stay in order.
            let t = &self.traits;
            let jitter =
                (t.imu_jitter_s * self.random.standard_normal()).clamp(-0.4 / t.imu_hz, 0.4 / t.imu_hz);
            self.next_s = t.imu_start_s + self.nth as f64 / t.imu_hz + jitter;
        }
        out
    }

    /// A point at `r` of a body that turns feels `a + alpha x r + omega x (omega x r)` (Goldstein, Classical mechanics,
    /// eq. 4.91, without the terms of a point that moves in the body).
    fn reading(&mut self, motion: &ContinuousTrajectory, t: f64) -> ImuSample {
        let state = motion.state(t);
        let alpha = (motion.state(t + HALF_S).rate - motion.state(t - HALF_S).rate) / (2.0 * HALF_S);
        let (omega, r) = (state.rate, self.traits.imu_in_camera);
        let lever = alpha.cross(&r) + omega.cross(&omega.cross(&r));
        let force = state.world_from_body.rotation.inverse()
            * (state.acceleration + Vec3::z() * GRAVITY_M_S2)
            + lever;
        let (n, root) = (self.traits.noise, self.traits.imu_hz.sqrt());
        let random = &mut self.random;
        let mut vector = |s: f64| {
            Vec3::new(
                random.standard_normal() * s,
                random.standard_normal() * s,
                random.standard_normal() * s,
            )
        };
        let gyro = omega + self.gyro_bias + vector(n.gyro * root);
        let accel = force + self.accel_bias + vector(n.accel * root);
        self.gyro_bias += vector(n.gyro_walk / root);
        self.accel_bias += vector(n.accel_walk / root);
        let [g, a] = self.traits.rounding;
        ImuSample::new(Stamp::from_seconds(t), rounded(gyro, g), rounded(accel, a))
    }
}

fn rounded(v: Vec3, step: f64) -> Vec3 {
    if step > 0.0 { v.map(|x| (x / step).round() * step) } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phone::PhoneMotion;
    use cairn_geometry::{Se3, So3};

    #[test]
    fn readings_start_late_come_unevenly_and_feel_the_lever() {
        let traits = PhoneTraits {
            imu_start_s: 1.0,
            imu_in_camera: Vec3::new(0.1, 0.0, 0.0),
            gyro_bias: Vec3::new(0.0, 0.0, 0.02),
            accel_bias: Vec3::zeros(),
            noise: cairn_sensor::ImuNoise { gyro: 0.0, gyro_walk: 0.0, accel: 0.0, accel_walk: 0.0 },
            rounding: [0.0, 0.0],
            ..PhoneTraits::new(3, 640, 480)
        };
        // Upright axes that turn about the vertical by 2 rad/s.
        let turned = |k: usize| Se3::new(So3::exp(&Vec3::new(0.0, 0.0, 0.04 * k as f64)), Vec3::zeros());
        let mut motion = PhoneMotion::new(0.02, &turned(0));
        (1..200).for_each(|k| motion.step(&turned(k)));
        let mut sensors = MotionSensors::new(&traits, 3);
        let mut readings = sensors.until(motion.motion(), 2.0);
        let before = readings.len();
        readings.extend(sensors.until(motion.motion(), 3.0));
        assert!((before as i64 - 60).abs() < 3 && (readings.len() as i64 - 120).abs() < 3);
        assert!(readings[0].stamp.seconds() >= 0.99);
        let steps: Vec<f64> = readings.windows(2).map(|w| w[1].stamp - w[0].stamp).collect();
        assert!(steps.iter().all(|s| *s > 0.0) && steps.iter().any(|s| (s - 1.0 / 60.0).abs() > 1e-3));
        let mid = readings[80];
        assert!((mid.gyro - Vec3::new(0.0, 0.0, 2.02)).norm() < 1e-3, "{mid:?}");
        // The sensors are 10 cm off the axis: 0.4 m/s^2 towards it.
        assert!((mid.accel - Vec3::new(-0.4, 0.0, GRAVITY_M_S2)).norm() < 5e-3, "{mid:?}");
    }

    #[test]
    fn readings_are_rounded_as_browsers_do() {
        let traits = PhoneTraits::new(4, 640, 480);
        let motion = PhoneMotion::new(0.02, &Se3::identity());
        for r in MotionSensors::new(&traits, 4).until(motion.motion(), 5.0) {
            for v in r.accel.iter() {
                assert!((v / 0.1 - (v / 0.1).round()).abs() < 1e-6, "{r:?}");
            }
        }
    }
}
