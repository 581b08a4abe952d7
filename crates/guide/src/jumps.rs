//! A pose that lies farther from the one before than anyone goes in that time is not believed before it has lasted.
//!
//! A single one is a mistake of tracking, and would move the walker's place on the route for good. One that lasts is true, and the
//! place before was not: it is looked for anew.

use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// Nobody who is guided walks or is pushed along faster, m/s (as in `runaway.rs`), and poses are off by so much, metres.
const FASTEST_M_S: f64 = 3.0;
const NOISE_M: f64 = 0.5;
/// It is believed once it has lasted this long, seconds.
const LASTS_S: f64 = 0.5;

/// Where the walker was at the last pose that was believed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Jumps {
    believed: Option<(Stamp, Vec2)>,
    /// The first and the last of the poses elsewhere.
    elsewhere: Option<(Stamp, Stamp, Vec2)>,
    has_landed: bool,
}

impl Jumps {
    /// Takes a position on the ground, in metres, or the last one again.
    pub fn step(&mut self, stamp: Stamp, position: Vec2) {
        let is_reached = |(then, from): (Stamp, Vec2)| {
            (position - from).norm() <= NOISE_M + FASTEST_M_S * (stamp - then).max(0.0)
        };
        if self.believed.is_none_or(is_reached) {
            (self.believed, self.elsewhere) = (Some((stamp, position)), None);
            return;
        }
        let since = match self.elsewhere {
            Some((since, then, at)) if is_reached((then, at)) => since,
            _ => stamp,
        };
        self.elsewhere = Some((since, stamp, position));
        if stamp - since >= LASTS_S {
            *self = Self { believed: Some((stamp, position)), elsewhere: None, has_landed: true };
        }
    }

    /// Whether the last pose is not believed.
    pub fn is_doubted(&self) -> bool {
        self.elsewhere.is_some()
    }

    /// Whether the walker turned out to be elsewhere since this was asked last.
    pub fn has_landed(&mut self) -> bool {
        std::mem::take(&mut self.has_landed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of ten poses a second are doubted, and whether the walker turned out to be elsewhere.
    fn doubted(xs: &[f64]) -> (usize, bool) {
        let mut jumps = Jumps::default();
        let mut at = |(k, x): (usize, &f64)| {
            jumps.step(Stamp::from_seconds(0.1 * k as f64), Vec2::new(*x, 0.0));
            jumps.is_doubted()
        };
        let n = xs.iter().enumerate().filter(|x| at(*x)).count();
        (n, jumps.has_landed())
    }

    #[test]
    fn a_single_pose_elsewhere_is_doubted_and_one_that_lasts_is_not() {
        assert_eq!(doubted(&[0.0, 0.1, 0.2, 2.9, 0.3, 0.4]), (1, false));
        let walks = |from: f64| (0..8).map(move |k| from + 0.1 * f64::from(k));
        let jumps: Vec<f64> = walks(0.0).chain(walks(9.0)).collect();
        assert_eq!(doubted(&jumps), (5, true));
    }
}
