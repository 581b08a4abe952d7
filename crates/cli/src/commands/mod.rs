//! One file for each command: its arguments, and what it prints.

pub mod config;
pub mod doctor;
pub mod eval;
pub mod map;
pub mod mesh;
pub mod rig;
pub mod run;
pub mod serve;
pub mod sim;
pub mod solve;
pub mod vocab;
pub mod way;
