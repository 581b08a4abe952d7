//! Whether the readings of an IMU lead where the camera went: the innovation of turn and of motion over three poses that vision gave.
//!
//! In: the poses of a camera at three instants, found without the readings, and the readings preintegrated between them. Out: by how
//! much the turn of the gyroscope differs from that of the images, and the way by the accelerometer from theirs, each with its
//! standard deviation. Three poses tell the velocity that two would leave open (as in Martinelli, "Closed-form solution of visual-inertial
//! structure from motion", IJCV 2014), so that no estimate enters which the readings under test have been part of.
//!
//! The tests of such an innovation are those of Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and
//! Navigation" (2001), section 5.4.

use crate::{Bias, Preintegrated};
use cairn_geometry::{Se3, Vec3};

/// What is known when poses are compared with readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// The biases.
    pub bias: Bias,
    /// Their standard deviations, rad/s and m/s^2 (with the tilt of gravity in that of the accelerometer's).
    pub bias_sigma: [f64; 2],
    /// Free fall in the world, m/s^2, where its direction and the metre are known.
    pub gravity: Option<Vec3>,
    /// Standard deviations of the poses, metres and radians.
    pub pose_sigma: [f64; 2],
    /// The part by which a length or an angle that was gone may be another one: by scale, by alignment.
    pub relative: f64,
}

/// A difference and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Radians or metres.
    pub off: f64,
    /// The same unit.
    pub sigma: f64,
    /// What was measured, radians or metres: of a camera that rests both tell nothing, and agree.
    pub measured: f64,
    /// Seconds in which it came up.
    pub seconds: f64,
}

impl Difference {
    /// In standard deviations.
    pub fn normalised(&self) -> f64 {
        self.off / self.sigma.max(1e-12)
    }

    /// Whether readings of nothing would have been told from what was measured, by so many standard deviations.
    pub fn tells(&self, times: f64) -> bool {
        self.measured > times * self.sigma
    }
}

/// Of turn and of motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// From the second pose to the third.
    pub turn: Difference,
    /// From the first to the third; `None` while gravity and the metre are not known.
    pub motion: Option<Difference>,
}

/// Compares `world_from_imu` at three instants with the readings from the first to the second and from there to the third.
pub fn innovation(poses: &[Se3; 3], sums: [&Preintegrated; 2], known: &Known) -> Innovation {
    Innovation { turn: turn(poses, sums[1], known), motion: motion(poses, sums, known) }
}

fn turn(poses: &[Se3; 3], sum: &Preintegrated, known: &Known) -> Difference {
    let seconds = sum.seconds();
    let (turned, ..) = sum.gained(&known.bias);
    let seen = poses[1].rotation.inverse() * poses[2].rotation;
    let noise = sum.motion_covariance().fixed_view::<3, 3>(0, 0).trace() / 3.0;
    let measured = turned.angle().max(seen.angle());
    let variance = noise
        + (known.bias_sigma[0] * seconds).powi(2)
        + 2.0 * known.pose_sigma[1].powi(2)
        + (known.relative * measured).powi(2);
    let off = (turned.inverse() * seen).angle();
    Difference { off, sigma: variance.sqrt(), measured, seconds }
}

fn motion(poses: &[Se3; 3], sums: [&Preintegrated; 2], known: &Known) -> Option<Difference> {
    let gravity = known.gravity?;
    let [a, b] = sums.map(Preintegrated::seconds);
    if a <= 0.0 || b <= 0.0 {
        return None;
    }
    let ((_, va, pa), (.., pb)) = (sums[0].gained(&known.bias), sums[1].gained(&known.bias));
    let ratio = b / a;
    let place = |i: usize| poses[i].translation;
    // The second difference of the way: what the velocity at the first pose has no part in.
    let seen = place(2) - place(1) - (place(1) - place(0)) * ratio;
    let by_first = poses[0].rotation * (va * b - pa * ratio);
    let felt = by_first + poses[1].rotation * pb + gravity * (0.5 * b * (a + b));
    let covariance =
        |sum: &Preintegrated, at: usize| sum.motion_covariance().fixed_view::<3, 3>(at, at).trace() / 3.0;
    let noise =
        covariance(sums[0], 3) * b * b + covariance(sums[0], 6) * ratio * ratio + covariance(sums[1], 6);
    let places = 1.0 + (1.0 + ratio).powi(2) + ratio * ratio;
    // Of both parts of the force, which are off by the same angle: all of it counts as one.
    let force = (va * b - pa * ratio).norm() + pb.norm();
    let variance = noise
        + known.pose_sigma[0].powi(2) * places
        + (known.pose_sigma[1] * force).powi(2)
        + (known.bias_sigma[1] * 0.5 * b * (a + b)).powi(2)
        + (known.relative * seen.norm().max(felt.norm())).powi(2);
    let measured = seen.norm().max(felt.norm());
    Some(Difference { off: (seen - felt).norm(), sigma: variance.sqrt(), measured, seconds: a + b })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;
    use cairn_random::Random;
    use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, Stamp};

    const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 2e-5, accel: 2e-3, accel_walk: 3e-3 };

    /// Pose and acceleration of a hand that swings.
    fn pose(t: f64) -> Se3 {
        let turn = So3::exp(&Vec3::new(0.4 * (2.3 * t).sin(), 0.3 * (3.1 * t).cos(), 0.5 * t));
        Se3::new(turn, Vec3::new(0.4 * (2.0 * t).sin(), 0.3 * (3.0 * t).cos(), 0.2 * (4.0 * t).sin()))
    }

    fn reading(t: f64, noise: &mut impl FnMut() -> Vec3) -> ImuSample {
        let h = 1e-4;
        let place = |t: f64| pose(t).translation;
        let acceleration = (place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h);
        let rate = (pose(t - h).rotation.inverse() * pose(t + h).rotation).log() / (2.0 * h);
        let force = pose(t).rotation.inverse() * (acceleration + Vec3::z() * GRAVITY_M_S2);
        ImuSample::new(Stamp::from_seconds(t), rate + noise() * 0.0024, force + noise() * 0.028)
    }

    /// Normalised differences of turn and motion where readings are changed, at many moments.
    fn normalised(change: impl Fn(f64) -> f64, of: impl Fn(&mut ImuSample)) -> Vec<[f64; 2]> {
        let known = Known {
            bias: Bias::default(),
            bias_sigma: [0.003, 0.05],
            gravity: Some(Vec3::z() * -GRAVITY_M_S2),
            pose_sigma: [0.003, 0.002],
            relative: 0.02,
        };
        let mut random = Random::new(3);
        let at = |i: usize| {
            let mut noise = || Vec3::from_fn(|_, _| random.standard_normal());
            let from = 0.1 * i as f64;
            let instants = [from, from + 0.25, from + 0.5];
            let poses = instants.map(|t| {
                let own = pose(t);
                Se3::new(own.rotation * So3::exp(&(noise() * 0.002)), own.translation + noise() * 0.003)
            });
            let sums = [0, 1].map(|part: usize| {
                let readings = (0..=50).map(|k| {
                    let t = instants[part] + 0.005 * f64::from(k);
                    let mut sample = reading(change(t), &mut noise);
                    sample.stamp = Stamp::from_seconds(t);
                    of(&mut sample);
                    sample
                });
                Preintegrated::of(NOISE, Bias::default(), readings.collect())
            });
            let told = innovation(&poses, [&sums[0], &sums[1]], &known);
            [told.turn.normalised(), told.motion.expect("gravity").normalised()]
        };
        (0..100).map(at).collect()
    }

    fn greatest(all: &[[f64; 2]], which: usize) -> f64 {
        all.iter().map(|n| n[which]).fold(0.0, f64::max)
    }

    #[test]
    fn readings_of_the_motion_agree_with_it() {
        let all = normalised(|t| t, |_| {});
        // The norm of three errors of a standard deviation each.
        assert!(greatest(&all, 0) < 4.5 && greatest(&all, 1) < 4.5, "{all:?}");
        assert!(greatest(&all, 0) > 1.0 && greatest(&all, 1) > 1.0, "{all:?}");
    }

    #[test]
    fn readings_of_another_motion_do_not() {
        let dead = normalised(|t| t, |s| s.accel = Vec3::zeros());
        assert!(dead.iter().all(|n| n[1] > 10.0), "{dead:?}");
        let dead = normalised(|t| t, |s| s.gyro = Vec3::zeros());
        assert!(dead.iter().filter(|n| n[0] > 10.0).count() > 90, "{dead:?}");
        let late = normalised(|t| t - 0.5, |_| {});
        assert!(late.iter().filter(|n| n[0] > 10.0).count() > 90, "{late:?}");
        let degrees = normalised(|t| t, |s| s.gyro *= 57.3);
        assert!(degrees.iter().filter(|n| n[0] > 10.0).count() > 90, "{degrees:?}");
    }
}
