#![doc = include_str!("../README.md")]

mod consistency;
mod digest;
mod envelope;
mod exchange;
pub mod files;
mod graph_peer;
mod graphs;
mod ids;
mod joint;
mod judge;
mod keep;
mod message;
mod network;
pub mod peer;
mod requests;
mod robot;
mod viewpoints;
mod words;

/// Greatest number of robots in a team that a robot keeps track of, itself included.
pub const MAX_ROBOTS: usize = 256;

pub use envelope::{Refused, VERSION};
pub use exchange::{Exchange, Round};
pub use graph_peer::{GraphPeer, Update};
pub use graphs::{CentralGraph, GraphsError, Measurement, RobotGraph, split};
pub use ids::{LoopId, PoseId, RobotId};
pub use judge::{JudgeConfig, Judgement, Verdict};
pub use message::{Estimate, MAX_BYTES, Message, Shared};
pub use network::{Network, NetworkConfig, Packet};
pub use requests::{MAX_REQUESTED, MAX_REQUESTS_BYTES, PlaceRequests};
pub use robot::{Robot, RobotError};
pub use viewpoints::{MAX_VIEWPOINTS, MAX_VIEWPOINTS_BYTES, Viewpoint, Viewpoints};
pub use words::{KeyFrameWords, MAX_WORDS_BYTES};
