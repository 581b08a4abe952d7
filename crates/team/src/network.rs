//! A simulated network that loses, delays, reorders and duplicates messages at random, from a seed.

use crate::RobotId;
use cairn_random::Random;

/// How unreliable the network is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkConfig {
    /// Fraction of the messages that never arrive.
    pub loss: f64,
    /// Fraction of the messages that arrive later, after one to [`NetworkConfig::delay_rounds`] exchanges.
    pub delayed: f64,
    /// Greatest delay of a message, in exchanges.
    pub delay_rounds: u32,
    /// Fraction of the messages that arrive twice.
    pub duplicated: f64,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl NetworkConfig {
    /// A network that delivers everything at once, in order.
    pub const PERFECT: Self = Self { loss: 0.0, delayed: 0.0, delay_rounds: 0, duplicated: 0.0, seed: 0 };
}

/// A message in transit.
#[derive(Clone, Debug)]
pub struct Packet {
    /// The sender.
    pub from: RobotId,
    /// The receiver.
    pub to: RobotId,
    /// The content.
    pub bytes: std::sync::Arc<Vec<u8>>,
    due: u64,
}

/// A simulated network.
#[derive(Clone, Debug)]
pub struct Network {
    config: NetworkConfig,
    random: Random,
    round: u64,
    waiting: Vec<Packet>,
}

impl Network {
    /// An empty network.
    pub fn new(config: NetworkConfig) -> Self {
        Self { config, random: Random::new(config.seed), round: 0, waiting: Vec::new() }
    }

    /// Accepts a message for delivery.
    pub fn send(&mut self, from: RobotId, to: RobotId, bytes: &std::sync::Arc<Vec<u8>>) {
        let copies = if self.random.unit() < self.config.duplicated { 2 } else { 1 };
        for _ in 0..copies {
            if self.random.unit() < self.config.loss {
                continue;
            }
            let is_late = self.random.unit() < self.config.delayed;
            let late = 1 + (self.random.unit() * f64::from(self.config.delay_rounds)) as u64;
            let due = self.round + if is_late { late } else { 0 };
            self.waiting.push(Packet { from, to, bytes: bytes.clone(), due });
        }
    }

    /// The messages that arrive in this exchange; a network that is not perfect shuffles them.
    pub fn deliver(&mut self) -> Vec<Packet> {
        let round = self.round;
        self.round += 1;
        let waiting = std::mem::take(&mut self.waiting);
        let (mut arrived, later): (Vec<_>, Vec<_>) = waiting.into_iter().partition(|p| p.due <= round);
        self.waiting = later;
        if self.config.loss + self.config.delayed + self.config.duplicated > 0.0 {
            for k in (1..arrived.len()).rev() {
                let other = (self.random.unit() * (k + 1) as f64) as usize;
                arrived.swap(k, other.min(k));
            }
        }
        arrived
    }
}
