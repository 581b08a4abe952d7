//! How long the pose has come from motion sensors or rotation alone.
//!
//! Such a pose drifts by the square of time and more, and nothing tells by how much before the map is seen again. A turn on
//! the spot needs only orientation, which lasts: while the walker turns, the time does not count. One who stands where the map was
//! seen last is where he was, and has to go on to see anything new: that time counts little.

use crate::ground::wrap;
use crate::route::Confidence;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// Turning faster than this is turning on the spot or round a corner, not the sway of a walk, rad/s.
const TURNING_RAD_S: f64 = 0.35;
/// The turn rate is averaged over about this time, so that sway cancels out, seconds.
const AVERAGED_S: f64 = 0.5;
/// In longer gaps between poses than this nothing is known of turn and velocity, seconds.
const LONGEST_STEP_S: f64 = 0.5;

/// Within this distance of where the map was seen last, metres, and slower than this, m/s, the walker stands; ...
const STANDS: (f64, f64) = (0.3, 0.2);
/// ... then this share of the time counts.
const STANDING: f64 = 0.1;

/// Time without seeing the map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Blind {
    last: Option<(Stamp, f64)>,
    rate: f64,
    blind_s: f64,
    /// Where the map was seen last, on the ground, and where the walker was at the last pose.
    at: Option<[Vec2; 2]>,
    velocity: Vec2,
}

impl Blind {
    /// Positions from now on have nothing to do with those before.
    pub fn begin_segment(&mut self) {
        self.at = None;
    }

    /// Takes a pose's confidence, its position on the ground in metres and its heading; returns for how many seconds the walker
    /// has gone without the map in view.
    pub fn step(&mut self, confidence: Confidence, stamp: Stamp, position: Vec2, heading: f64) -> f64 {
        let before = self.last.replace((stamp, heading));
        let [seen_at, was_at] = self.at.unwrap_or([position; 2]);
        self.at = Some([if confidence == Confidence::Good { position } else { seen_at }, position]);
        let Some((then, old)) = before else { return self.blind_s };
        let gone_s = (stamp - then).max(0.0);
        let dt = gone_s.min(LONGEST_STEP_S);
        if dt > 0.0 {
            let share = (dt / AVERAGED_S).min(1.0);
            self.rate += (wrap(heading - old) / dt - self.rate) * share;
            self.velocity += ((position - was_at) / dt - self.velocity) * share;
        }
        let stands = (position - seen_at).norm() <= STANDS.0 && self.velocity.norm() <= STANDS.1;
        match confidence {
            Confidence::Good => self.blind_s = 0.0,
            _ if self.rate.abs() >= TURNING_RAD_S => {}
            _ => self.blind_s += if stands { STANDING * gone_s } else { gone_s },
        }
        self.blind_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blind seconds after ten without the map, at this speed and turn rate.
    fn blind_after_ten(speed: f64, turn_rate: f64) -> f64 {
        let mut blind = Blind::default();
        let mut at = |t: f64, confidence| {
            let moved = speed * (t - 1.0).max(0.0);
            blind.step(confidence, Stamp::from_seconds(t), Vec2::new(5.0 + moved, 2.0), wrap(turn_rate * t))
        };
        for n in 0..10 {
            at(0.1 * f64::from(n), Confidence::Good);
        }
        (10..=110).map(|n| at(0.1 * f64::from(n), Confidence::Low)).fold(0.0, f64::max)
    }

    #[test]
    fn one_who_walks_on_is_blind_one_who_stands_has_not_lost_his_place() {
        assert!(blind_after_ten(1.0, 0.0) > 9.0, "{}", blind_after_ten(1.0, 0.0));
        assert!(blind_after_ten(0.1, 0.0) > 6.0, "slow walking: {}", blind_after_ten(0.1, 0.0));
        let stood = blind_after_ten(0.0, 0.0);
        assert!(stood > 0.5 && stood < 1.5, "but not for ever: {stood}");
        assert!(blind_after_ten(0.0, 0.8) < 0.1, "{}", blind_after_ten(0.0, 0.8));
    }
}
