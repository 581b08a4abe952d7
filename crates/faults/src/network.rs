//! The way between phone and server: messages arrive in order, late, and not at all for a while.

use crate::scenario::{Fault, Scenario};
use crate::spells::{Since, Spells};
use cairn_random::Random;
use cairn_sensor::Stamp;

/// One direction of a connection.
pub(crate) struct Line {
    random: Random,
    base_s: f64,
    jitter_s: f64,
    stalls: Option<Spells>,
    calm: Stamp,
    /// When the message before arrives.
    last: Stamp,
}

impl Line {
    /// A line with a number; both stall at the same times.
    pub fn new(scenario: &Scenario, number: u64, begins: Stamp, calm: Stamp) -> Self {
        let mut random = scenario.random(1010 + number);
        let slow = scenario.faults.has(Fault::SlowNetwork);
        let (base_s, jitter_s) =
            if slow { (random.uniform(0.02, 0.15), random.uniform(0.0, 0.4)) } else { (0.005, 0.02) };
        let stalls = scenario.faults.has(Fault::Stalls).then(|| {
            let random = scenario.random(Fault::Stalls as u64);
            Spells::new(random, begins, calm, [3.0, 40.0], [0.3, 8.0])
        });
        Self { random, base_s, jitter_s, stalls, calm, last: Stamp(i64::MIN) }
    }

    /// When a message that is sent now arrives.
    pub fn arrives(&mut self, now: Stamp) -> Stamp {
        let calm = now >= self.calm;
        let jitter_s = if calm { 0.01 } else { self.jitter_s };
        let base_s = if calm { 0.01 } else { self.base_s };
        // Most messages are hardly held up, a few for long.
        let delay_s = base_s + jitter_s * self.random.unit().powi(4);
        let mut at = now.plus_seconds(delay_s);
        while self.stalls.since(at).is_some() {
            at = at.plus_seconds(0.02);
        }
        self.last = self.last.max(at);
        self.last
    }
}
