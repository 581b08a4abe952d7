//! One file per command: its arguments and its output.

pub mod bench;
mod cameras;
pub mod completions;
pub mod config;
pub mod doctor;
pub mod ekf;
pub mod eval;
mod eval_doubts;
pub mod fleet;
mod given;
pub mod map;
pub mod mesh;
pub mod page;
pub mod plan;
pub mod rig;
pub mod ros;
pub mod route;
pub mod run;
pub mod serve;
pub mod sim;
pub mod solve;
pub mod team;
pub mod view;
pub mod vocab;
