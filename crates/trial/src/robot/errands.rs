//! The goals of a robot, in order. One that was missed because others were in the way comes once more, after all the rest: they may
//! be elsewhere by then.
//!
//! In: how each try ended. Out: the goal that comes next, and all ends.

use super::GoalEnd;
use cairn_plan::control::State;
use std::collections::VecDeque;

/// Goals that are left, and how tries ended.
#[derive(Clone, Debug, Default)]
pub(super) struct Errands {
    left: VecDeque<usize>,
    ends: Vec<GoalEnd>,
}

impl Errands {
    /// With this many goals, in their order.
    pub fn new(count: usize) -> Self {
        Self { left: (0..count).collect(), ends: Vec::new() }
    }

    /// The goal that comes next.
    pub fn next(&mut self) -> Option<usize> {
        self.left.pop_front()
    }

    /// A try has ended; others had been in its way, or not.
    pub fn end(&mut self, end: GoalEnd, held_up: bool) {
        let is_first = self.ends.iter().all(|e| e.goal != end.goal);
        if is_first && held_up && end.state != State::Reached.to_string() {
            self.left.push_back(end.goal);
        }
        self.ends.push(end);
    }

    /// How each try ended, in order.
    pub fn ends(&self) -> &[GoalEnd] {
        &self.ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_made_it_miss_comes_once_more_after_the_rest() {
        let end = |goal, state: State| GoalEnd { goal, state: state.to_string(), reason: None, seconds: 1.0 };
        let mut errands = Errands::new(4);
        let mut order = Vec::new();
        while let Some(goal) = errands.next() {
            order.push(goal);
            // Someone is always in the way of the first, and was met on the way to the third; the second has no way at all.
            let (state, held_up) = match goal {
                0 => (State::Executing, true),
                1 => (State::NoPath, false),
                2 => (State::Reached, true),
                _ => (State::Reached, false),
            };
            errands.end(end(goal, state), held_up);
        }
        assert_eq!(order, [0, 1, 2, 3, 0]);
        assert_eq!(errands.ends().len(), 5);
    }
}
