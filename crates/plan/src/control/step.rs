//! What a step of the navigator says: its state, the motion to command, and why.

use super::motion::{LimitsError, Twist};
use super::pursuit::Following;
use crate::search::NoPath;

/// What the navigator is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// No goal.
    Idle,
    /// Searching for a path.
    Planning,
    /// Following the path.
    Executing,
    /// The goal is reached.
    Reached,
    /// No path leads to the goal.
    NoPath,
    /// Something is in the way.
    Blocked,
}

impl std::fmt::Display for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            State::Idle => "IDLE",
            State::Planning => "PLANNING",
            State::Executing => "EXECUTING",
            State::Reached => "REACHED",
            State::NoPath => "NO_PATH",
            State::Blocked => "BLOCKED",
        })
    }
}

/// Why the navigator is in its state.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A goal was set.
    #[error("a new goal")]
    NewGoal,
    /// There is no path.
    #[error(transparent)]
    NoPath(NoPath),
    /// The pose holds NaN or infinity.
    #[error("the pose is not a number")]
    PoseInvalid,
    /// The measured motion holds NaN or infinity.
    #[error("the motion is not a number")]
    MotionInvalid,
    /// The limits of the body hold a value that is not a positive number.
    #[error("{0}")]
    LimitsInvalid(LimitsError),
    /// The pose is farther from the last one than the motion explains, by this distance in metres.
    #[error("the pose jumped by {0:.2} m")]
    PoseJumped(f64),
    /// The path is no longer free.
    #[error("the map changed: the path is blocked in {0:.1} m")]
    MapChanged(f64),
    /// The body is off its path.
    #[error("{0:.2} m beside the path")]
    OffPath(f64),
    /// A wall is within the stop distance.
    #[error("a wall {0:.2} m ahead")]
    Wall(f64),
    /// A moving object is within the stop distance.
    #[error("something that moves {0:.2} m ahead")]
    Moving(f64),
    /// Recovery: turning towards the path.
    #[error("blocked: turning")]
    Turning,
    /// Recovery: backing up.
    #[error("blocked: backing up")]
    BackingUp,
    /// Recovery: planning around the obstacle.
    #[error("blocked: planning around it")]
    PlanningAround,
    /// All recoveries were tried as often as allowed.
    #[error("blocked: given up after {0} attempts")]
    GivenUp(u32),
}

/// Result of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The state after the step.
    pub state: State,
    /// The motion to command.
    pub motion: Twist,
    /// The reason, unless the path is simply being followed.
    pub reason: Option<Reason>,
    /// How the path is followed, while executing.
    pub following: Option<Following>,
}
