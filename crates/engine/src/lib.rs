#![doc = include_str!("../README.md")]

mod assembly;
mod config;
mod dense;
mod depth_link;
mod digest;
mod engine;
mod first_seconds;
pub mod journal;
mod log;
mod mapping;
mod observers;
mod output;
mod record;
mod saved;
mod scale;
mod sensors;
mod status;
mod trajectory;

pub use cairn_inertial::{Gate, GateKind, ImuFault};
pub use cairn_mapping::{Accepted, Joined, Refusal, ScaleCheck, ScaleVerdict, Verdict};
pub use cairn_sensor::{Clock, Host};
pub use cairn_settings::SettingsError as ConfigError;
pub use cairn_tracking::{
    AnchoredPose, Evidence, FlowClocks, HintOutcome, MeasuredMotion, MotionSource, Odometry, PlaceHint, State,
};
pub use cairn_vision::SensorMode;
pub use config::Config;
pub use dense::{
    DenseCounts, DenseMapper, DenseSetupError, Offered, OfferedDepth, RefusedAttempts, Restored,
    SavedDepthError, SearchCounts, Views, saved_dense_map,
};
pub use engine::Engine;
pub use first_seconds::with_found_lens;
pub use journal::{Journal, JournalError, ReplayError};
pub use log::{Log, Logged};
pub use mapping::{Delays, Replayed, Runner, Stopped};
pub use output::{Finished, FramePose, Output, StageEvent, Timings};
pub use record::record_input;
pub use saved::{OpenMapError, UnfitMap};
pub use scale::{Scale, ScaleStretch};
pub use sensors::{Sensors, UnknownSensors, has_colours};
pub use status::{ImuStatus, Phase, Status, StatusEvent, Wait};
pub use trajectory::{CameraPoses, PoseTime};
