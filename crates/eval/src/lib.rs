#![doc = include_str!("../README.md")]

mod coverage;
mod decimal;
mod error;
mod evaluate;
mod load;
mod percentiles;
pub mod process;
mod read;
mod relative;
mod report;
mod statistics;
mod write;

pub use coverage::{coverage_of_frames, coverage_of_reference};
pub use error::{EvalError, FileError};
pub use evaluate::{
    Align, Association, EvalOptions, Evaluation, PairError, evaluate, evaluate_files, tracked_fraction,
};
pub use load::load_trajectory;
pub use percentiles::{Percentiles, StageTimes, Stages};
pub use read::{Format, KITTI_STEP_NS, TrajectoryFile, parse_trajectory};
pub use relative::Delta;
pub use report::{Lost, RunReport};
pub use statistics::Statistics;
pub use write::{seconds_text, to_euroc, to_kitti, to_tum, write_whole};
