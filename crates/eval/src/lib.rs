#![doc = include_str!("../README.md")]

mod chart;
mod coverage;
mod decimal;
mod error;
mod evaluate;
mod figures;
mod header;
mod html;
mod load;
mod percentiles;
mod plan;
pub mod process;
mod read;
mod relative;
mod report;
mod segments;
mod statistics;
mod status_summary;
mod svg;
mod timeline;
mod write;

pub use chart::{Dots, Labels, Mark, Series, dot_chart, histogram, line_chart};
pub use coverage::{coverage_of_frames, coverage_of_reference};
pub use decimal::nanoseconds;
pub use error::{EvalError, FileError};
pub use evaluate::{
    Align, Association, EvalOptions, Evaluation, PairError, evaluate, evaluate_files, reference_for,
    tracked_fraction,
};
pub use figures::{error_over_time, times_histogram, times_over_frames, widest_axes};
pub use header::TrajectoryHeader;
pub use html::{Page, Said};
pub use load::load_trajectory;
pub use percentiles::{Percentiles, StageTimes, Stages};
pub use plan::{Event, Marker, Plan, PlanLine};
pub use read::{
    Format, KITTI_STEP_NS, LineError, TrajectoryFile, parse_stamped_pose, parse_trajectory, pose_from_matrix,
};
pub use relative::Delta;
pub use report::{LiveReport, Lost, RunReport, ScaleReport, SkipReport};
pub use segments::{KittiErrors, SegmentErrors};
pub use statistics::Statistics;
pub use status_summary::{GateSummary, ImuFaultSummary, ImuSummary, StatusSummary};
pub use svg::{Figure, Tone};
pub use timeline::{Moment, Span, Timeline, TimelineRow};
pub use write::{seconds_text, to_euroc, to_kitti, to_tum, to_tum_with, write_bytes_whole, write_whole};
