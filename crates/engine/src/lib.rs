#![doc = include_str!("../README.md")]

mod config;
mod engine;
mod log;
mod mapping;

pub use cairn_vision::SensorMode;
pub use config::{Config, ConfigError};
pub use engine::{Engine, Output};
pub use log::{Log, Logged};
pub use mapping::Runner;
