//! How the costs of a team that shares its maps grow with robots and key frames: what one robot pays, measured on this machine,
//! and a model of how much of it comes together.

mod budget;
mod costs;
mod measure;
mod model;

pub use budget::{Budgets, Resource};
pub use costs::{Costs, Power, Straight};
pub use measure::{MeasureError, measure_costs};
pub use model::{Load, Team};
