//! The delay of a drive: commands that were given and have not yet taken effect.

use super::motion::{Twist, moved};
use cairn_geometry::Se2;
use std::collections::VecDeque;

/// Commands given within the delay, oldest first.
#[derive(Clone, Debug)]
pub(super) struct PendingCommands {
    period_s: f64,
    pending: VecDeque<Twist>,
}

impl PendingCommands {
    /// A body at rest, commanded once in each period, whose drive follows a command `delay_s` later (seconds).
    pub(super) fn new(delay_s: f64, period_s: f64) -> Self {
        let late = (delay_s / period_s.max(1e-3)).round().clamp(0.0, 100.0) as usize;
        Self { period_s, pending: VecDeque::from(vec![Twist::stop(); late]) }
    }

    /// The next command; the oldest takes effect.
    pub(super) fn push(&mut self, motion: Twist) {
        if self.pending.pop_front().is_some() {
            self.pending.push_back(motion);
        }
    }

    /// The predicted pose and motion at the time when a command given now takes effect.
    pub(super) fn foreseen(&self, world_from_body: &Se2, motion: Twist) -> (Se2, Twist) {
        let step = |pose: Se2, m: &Twist| moved(&pose, *m, self.period_s);
        let pose = self.pending.iter().fold(*world_from_body, step);
        (pose, self.pending.back().copied().unwrap_or(motion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_takes_effect_after_the_delay() {
        let mut commands = PendingCommands::new(0.1, 0.05);
        let at = Se2::identity();
        assert_eq!(commands.foreseen(&at, Twist::new(0.3, 0.0)), (at, Twist::stop()));
        commands.push(Twist::new(1.0, 0.0));
        let (pose, motion) = commands.foreseen(&at, Twist::stop());
        assert_eq!(motion, Twist::new(1.0, 0.0));
        assert!((pose.translation.x - 0.05).abs() < 1e-12, "half of the delay is driven: {pose:?}");
        let immediate = PendingCommands::new(0.0, 0.05);
        assert_eq!(immediate.foreseen(&at, Twist::new(0.3, 0.0)), (at, Twist::new(0.3, 0.0)));
    }
}
