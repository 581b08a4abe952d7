//! When a fault is on: spells of it, with rests between them, until all is calm.

use cairn_random::Random;
use cairn_sensor::Stamp;

/// The spells of one fault.
#[derive(Clone, Debug)]
pub(crate) struct Spells {
    random: Random,
    rests_s: [f64; 2],
    lasts_s: [f64; 2],
    /// The present or next one.
    from: Stamp,
    to: Stamp,
    /// Nothing begins from then on, and nothing lasts longer.
    calm: Stamp,
}

impl Spells {
    /// Spells of a length between rests of a length (the least and the most), in seconds.
    pub fn new(random: Random, begins: Stamp, calm: Stamp, rests_s: [f64; 2], lasts_s: [f64; 2]) -> Self {
        let mut spells = Self { random, rests_s, lasts_s, from: begins, to: begins, calm };
        spells.next();
        spells
    }

    fn next(&mut self) {
        let mut draw = |[least, most]: [f64; 2]| self.random.uniform(least, most);
        self.from = self.to.plus_seconds(draw(self.rests_s));
        self.to = self.from.plus_seconds(draw(self.lasts_s)).min(self.calm);
    }

    /// When the spell that is on now began. Times never go back.
    pub fn since(&mut self, now: Stamp) -> Option<Stamp> {
        if now >= self.calm {
            return None;
        }
        while now >= self.to && self.from < self.calm {
            self.next();
        }
        (now >= self.from && now < self.to).then_some(self.from)
    }
}

/// The spells of a fault that a walk may not have.
pub(crate) trait Since {
    /// As [`Spells::since`].
    fn since(&mut self, now: Stamp) -> Option<Stamp>;
}

impl Since for Option<Spells> {
    fn since(&mut self, now: Stamp) -> Option<Stamp> {
        self.as_mut().and_then(|spells| spells.since(now))
    }
}
