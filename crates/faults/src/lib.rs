#![doc = include_str!("../README.md")]

mod estimator;
mod many;
mod modelled;
mod network;
mod page;
mod person;
mod plan;
mod rules;
mod scenario;
mod server;
mod setup;
mod shrink;
mod spells;
mod storage;
mod time_line;
mod walk;

pub use many::{Tally, walks};
pub use rules::{Rule, Violation};
pub use scenario::{Fault, Faults, Scenario};
pub use shrink::shrink;
pub use time_line::{Line, What, page, text};
pub use walk::{Outcome, walk, watched};
