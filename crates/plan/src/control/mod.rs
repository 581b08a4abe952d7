//! Driving along a path: limits of a robot with differential drive (or of a walker), the reference path, the collision
//! check ahead, and two controllers: regulated pure pursuit and model predictive path integral control. [`Navigator`]
//! combines them with planning; it has states and recoveries and gives reasons.

mod ahead;
mod config;
mod delay;
mod motion;
mod mppi;
mod navigator;
mod path_finder;
mod pursuit;
mod reference;
mod step;
pub mod trial;
mod way_out;

pub use ahead::{CollisionCheck, Surroundings};
pub use config::NavigatorConfig;
pub use motion::{Limits, LimitsError, Twist, moved};
pub use mppi::{Mppi, MppiConfig};
pub use navigator::Navigator;
pub use pursuit::{Following, Pursuit, PursuitConfig};
pub use reference::{Projection, ReferencePath};
pub use step::{Reason, State, Step};
pub use way_out::way_out;
