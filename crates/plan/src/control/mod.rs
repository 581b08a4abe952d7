//! Driving along a path: what a robot with two driven wheels (or a walker at walking pace) may do, where the path is, what lies
//! ahead, and two controllers: regulated pure pursuit and model predictive path integral control. [`Navigator`] joins them to
//! planning, with states, recoveries and reasons.

mod ahead;
mod motion;
mod mppi;
mod navigator;
mod pursuit;
mod reference;
pub mod trial;

pub use ahead::{Ahead, Surroundings};
pub use motion::{Limits, LimitsError, Motion, moved};
pub use mppi::{Mppi, MppiConfig};
pub use navigator::{Navigator, NavigatorConfig, Reason, State, Step};
pub use pursuit::{Following, Pursuit, PursuitConfig};
pub use reference::{Projection, ReferencePath};
