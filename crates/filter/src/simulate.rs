//! Simulated worlds with ground truth: a robot on a loop among landmarks, with noise drawn from the models.
//!
//! They serve to test consistency: the filter's covariance can be judged only where the noise is known.

use crate::angle::wrap;
use crate::log::{Sighting, Step, Target};
use crate::measure::{Kind, Measurement, expected};
use crate::motion::VelocityModel;
use cairn_geometry::{Se2, Vec2};
use cairn_random::Random;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Description of a world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct World {
    /// Number of landmarks, spread evenly over the ring that the robot drives through.
    pub landmarks: usize,
    /// Radius of the robot's circle in metres.
    pub radius_m: f64,
    /// Half the width of the ring of landmarks, in metres.
    pub margin_m: f64,
    /// Forward velocity in m/s.
    pub speed_m_s: f64,
    /// Duration in seconds.
    pub duration_s: f64,
    /// Steps per second.
    pub rate_hz: f64,
    /// Range of the sensor, in metres, in all directions.
    pub reach_m: f64,
    /// Greatest number of sightings per step; the nearest landmarks are seen.
    pub most: usize,
    /// What the sensor measures: range and bearing, range, or bearing.
    pub kind: Kind,
    /// Standard deviation of a range in metres.
    pub range_m: f64,
    /// Standard deviation of a bearing in radians.
    pub bearing_rad: f64,
    /// Noise of the robot's velocities.
    pub velocity: VelocityModel,
}

impl Default for World {
    fn default() -> Self {
        Self {
            landmarks: 200,
            radius_m: 30.0,
            margin_m: 8.0,
            speed_m_s: 1.0,
            duration_s: 600.0,
            rate_hz: 2.0,
            reach_m: 8.0,
            most: 10,
            kind: Kind::RangeBearing,
            range_m: 0.1,
            bearing_rad: 0.02,
            velocity: VelocityModel {
                speed: 0.05,
                speed_by_speed: 0.0,
                speed_by_turn: 0.0,
                turn: 0.02,
                turn_by_speed: 0.0,
                turn_by_turn: 0.0,
            },
        }
    }
}

/// A run through a world.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulated {
    /// Input of the filter; the first motion starts at the origin, which is the frame of the truth.
    pub steps: Vec<Step>,
    /// True poses at the steps.
    pub truth: Vec<Vector3<f64>>,
    /// True landmarks, by label.
    pub landmarks: Vec<Vec2>,
}

impl World {
    /// Drives through the world once, with the noise of this seed.
    pub fn drive(&self, seed: u64) -> Simulated {
        let mut random = Random::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d).wrapping_add(1));
        // The circle's centre is to the left of the start.
        let centre = Vec2::new(0.0, self.radius_m);
        let mut spread = Random::new(77);
        let landmarks: Vec<Vec2> = (0..self.landmarks)
            .map(|k| {
                let angle = TAU * (k as f64 + spread.unit()) / self.landmarks as f64;
                let radius = self.radius_m + self.margin_m * (2.0 * spread.unit() - 1.0);
                centre + Vec2::new(angle.cos(), angle.sin()) * radius
            })
            .collect();
        let dt = 1.0 / self.rate_hz;
        let count = (self.duration_s * self.rate_hz).round() as usize;
        let (mut pose, mut steps, mut truth) = (Se2::identity(), Vec::new(), Vec::new());
        for k in 0..count {
            // The driver keeps to the circle. The command is known; the driven motion differs from it by the noise.
            let turn_rad_s = self.steer(&pose, &centre);
            let (speed, turn) = (self.velocity.speed / dt.sqrt(), self.velocity.turn / dt.sqrt());
            let driven = self.velocity.motion(
                self.speed_m_s + speed * random.standard_normal(),
                turn_rad_s + turn * random.standard_normal(),
                dt,
            );
            pose = pose * driven.before_from_after;
            let at = Vector3::new(pose.translation.x, pose.translation.y, pose.rotation.log());
            truth.push(at);
            let motion = self.velocity.motion(self.speed_m_s, turn_rad_s, dt);
            let sightings = self.seen(&at, &landmarks, &mut random);
            steps.push(Step { time_s: (k + 1) as f64 * dt, motion, sightings });
        }
        Simulated { steps, truth, landmarks }
    }

    /// Angular velocity that returns the robot to the circle, critically damped.
    fn steer(&self, pose: &Se2, centre: &Vec2) -> f64 {
        let out = pose.translation - centre;
        let off_m = out.norm() - self.radius_m;
        let heading = wrap(pose.rotation.log() - out.y.atan2(out.x) - FRAC_PI_2);
        self.speed_m_s / self.radius_m + 0.16 * off_m.clamp(-4.0, 4.0) - 0.8 * heading
    }

    fn seen(&self, pose: &Vector3<f64>, landmarks: &[Vec2], random: &mut Random) -> Vec<Sighting> {
        let distance = |p: &Vec2| (p - pose.xy()).norm();
        let mut near: Vec<usize> = (0..landmarks.len())
            .filter(|k| (0.5..self.reach_m).contains(&distance(&landmarks[*k])))
            .collect();
        near.sort_by(|a, b| distance(&landmarks[*a]).total_cmp(&distance(&landmarks[*b])));
        near.truncate(self.most);
        let measured = |k: usize, random: &mut Random| {
            let z = expected(self.kind, pose, &landmarks[k].push(0.0));
            match self.kind {
                Kind::Range => {
                    Measurement::range((z.x + self.range_m * random.standard_normal()).max(0.0), self.range_m)
                }
                Kind::Bearing => {
                    Measurement::bearing(z.x + self.bearing_rad * random.standard_normal(), self.bearing_rad)
                }
                _ => {
                    let polar = expected(Kind::RangeBearing, pose, &landmarks[k].push(0.0));
                    let range = (polar.x + self.range_m * random.standard_normal()).max(0.0);
                    let bearing = polar.y + self.bearing_rad * random.standard_normal();
                    Measurement::range_bearing(range, bearing, self.range_m, self.bearing_rad)
                }
            }
        };
        let sighting =
            |k| Some(Sighting { target: Target::Landmark(k as u32), measurement: measured(k, random).ok()? });
        near.into_iter().filter_map(sighting).collect()
    }
}
