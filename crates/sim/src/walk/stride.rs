//! The gait of a body that is moved by the caller: from positions frame by frame to camera poses that bob.

use super::Walker;
use cairn_geometry::{Se3, Vec2};
use std::f64::consts::TAU;

/// Carries the phase of the steps from frame to frame.
#[derive(Clone, Debug)]
pub struct Stride {
    walker: Walker,
    last: Option<Vec2>,
    phase: f64,
    strength: f64,
}

/// Seconds in which the gait grows when the walker starts, and fades when he stops.
const SETTLES_S: f64 = 0.25;

impl Stride {
    /// With the camera height, pitch and gait of this walker; standing.
    pub fn new(walker: Walker) -> Self {
        Self { walker, last: None, phase: 0.0, strength: 0.0 }
    }

    /// The camera's pose `dt` seconds after the one before: the walker stands at `place` (metres on the floor)
    /// and the camera looks along `heading` (radians, counter-clockwise from x).
    pub fn pose(&mut self, place: Vec2, heading: f64, dt: f64) -> Se3 {
        let moved = self.last.replace(place).map_or(0.0, |last| (place - last).norm());
        if dt > 0.0 {
            let pace = moved / dt;
            self.phase = (self.phase + TAU * Walker::steps_per_s(pace) * dt).rem_euclid(2.0 * TAU);
            let keep = (-dt / SETTLES_S).exp();
            self.strength = keep * self.strength + (1.0 - keep) * (pace / 0.8).clamp(0.0, 1.0);
        }
        self.walker.body(place, heading, self.phase, self.strength)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bobs_while_walking_and_stands_still() {
        let mut stride = Stride::new(Walker::default());
        let standing = stride.pose(Vec2::zeros(), 0.3, 0.0);
        let heights: Vec<f64> = (1..200)
            .map(|k| stride.pose(Vec2::new(0.05 * f64::from(k), 0.0), 0.3, 0.05).translation.z)
            .collect();
        let (low, high) = heights.iter().fold((f64::MAX, f64::MIN), |(l, h), z| (l.min(*z), h.max(*z)));
        assert!(high - low > 0.02 && high - low < 0.04, "{low} to {high}");
        let place = Vec2::new(9.95, 0.0);
        let still = (0..60).map(|_| stride.pose(place, 0.3, 0.05)).last().unwrap();
        assert!(
            (still.translation - standing.translation - cairn_geometry::Vec3::new(9.95, 0.0, 0.0)).norm()
                < 1e-4
        );
        assert!((still.rotation.inverse() * standing.rotation).angle() < 1e-4);
    }
}
