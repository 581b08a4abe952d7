//! A pose that moves faster than anyone walks is wrong, whatever its tracker says of it.

use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// Nobody who is guided walks or is pushed along faster, m/s.
const FASTEST_M_S: f64 = 3.0;
/// Velocity is averaged over about this time, so that noise from pose to pose cancels out, seconds.
const AVERAGED_S: f64 = 0.5;
/// A single jump is none: it must last this long, seconds.
const LASTS_S: f64 = 0.4;
/// After a gap of this length velocity is measured anew, seconds.
const GAP_S: f64 = 1.0;

/// The velocity of the poses, averaged.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Runaway {
    last: Option<(Stamp, Vec2)>,
    velocity: Vec2,
    /// Since when it is too fast.
    since: Option<Stamp>,
}

impl Runaway {
    /// Takes a position on the ground, in metres; returns whether it moves as no walker does.
    pub fn step(&mut self, stamp: Stamp, position: Vec2) -> bool {
        let before = self.last.replace((stamp, position));
        if let Some((then, old)) = before {
            let dt = stamp - then;
            if dt >= GAP_S {
                self.velocity = Vec2::zeros();
            } else if dt > 0.0 {
                self.velocity += ((position - old) / dt - self.velocity) * (dt / AVERAGED_S).min(1.0);
            }
        }
        self.since = (self.velocity.norm() > FASTEST_M_S).then(|| self.since.unwrap_or(stamp));
        self.since.is_some_and(|since| stamp - since > LASTS_S)
    }
}
