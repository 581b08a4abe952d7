//! How long the pose has come from motion sensors or rotation alone.
//!
//! Such a pose drifts by the square of time and more, and nothing tells by how much before the map is seen again. A turn on
//! the spot needs only orientation, which lasts: while the walker turns, the time does not count.

use crate::ground::wrap;
use crate::route::Confidence;
use cairn_sensor::Stamp;

/// Turning faster than this is turning on the spot or round a corner, not the sway of a walk, rad/s.
const TURNING_RAD_S: f64 = 0.35;
/// The turn rate is averaged over about this time, so that sway cancels out, seconds.
const AVERAGED_S: f64 = 0.5;
/// Longer gaps between poses than this count as this, seconds.
const LONGEST_STEP_S: f64 = 0.5;

/// Time without seeing the map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Blind {
    last: Option<(Stamp, f64)>,
    rate: f64,
    blind_s: f64,
}

impl Blind {
    /// Takes a pose's confidence and heading; returns for how many seconds the walker has gone without the map in view.
    pub fn step(&mut self, confidence: Confidence, stamp: Stamp, heading: f64) -> f64 {
        let before = self.last.replace((stamp, heading));
        let Some((then, old)) = before else { return self.blind_s };
        let dt = (stamp - then).clamp(0.0, LONGEST_STEP_S);
        if dt > 0.0 {
            let share = (dt / AVERAGED_S).min(1.0);
            self.rate += (wrap(heading - old) / dt - self.rate) * share;
        }
        match confidence {
            Confidence::Good => self.blind_s = 0.0,
            _ if self.rate.abs() < TURNING_RAD_S => self.blind_s += dt,
            _ => {}
        }
        self.blind_s
    }
}
