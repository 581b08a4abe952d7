//! A robot explores an apartment that it does not know and is sent to three rooms.
//!
//! The pieces: [`Household`] is the apartment with its people and doors, the body is `cairn_plan`'s simulated one,
//! [`Localiser`] lays the engine's poses onto the ground, [`Pilot`] maps, explores and drives, [`Judge`] judges by the
//! truth. [`Trial`] runs them together. Only the judge, the renderer and the people know the truth.

mod config;
mod errands;
mod household;
mod judge;
mod localiser;
mod once_open;
mod pilot;
mod run;

pub use config::RobotConfig;
pub use household::{Household, PERSON_RADIUS_M};
pub use judge::{Collision, Judge, Touched};
pub use localiser::{Localiser, Located};
pub use pilot::{Decision, Pilot};
pub use run::{End, Goal, Moment, Progress, Trial};

use cairn_plan::ground::GroundError;
use cairn_sensor::SourceError;

/// What the robot says of a goal when a try has ended.
#[derive(Clone, Debug, PartialEq)]
pub struct GoalEnd {
    /// Its place among the goals.
    pub goal: usize,
    /// REACHED, NO_PATH, or the state in which time ran out.
    pub state: String,
    /// Why it was not reached.
    pub reason: Option<String>,
    /// From the order to the end, seconds.
    pub seconds: f64,
}

/// Why a trial could not be run.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The rig does not serve.
    #[error("the robot's rig: {0}")]
    Rig(String),
    /// The renderer failed.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The engine failed.
    #[error("the engine: {0}")]
    Engine(String),
    /// The map of the ground failed.
    #[error(transparent)]
    Ground(#[from] GroundError),
}
