#![doc = include_str!("../README.md")]

mod camera;
mod error;
mod host;
mod image;
mod lens;
mod live;
mod merge;
mod motion_profile;
mod packet;
mod rig;
mod skips;
mod source;
mod stamp;

pub use camera::Camera;
pub use error::RigError;
pub use host::{Clock, Host, Spawn, Task, Work};
pub use image::{DepthImage, GrayImage, Image};
pub use lens::Distortion;
pub use live::{ClockReading, Live};
pub use merge::{DropReason, Dropped, ImuGap, Merge, MergeConfig, MergeCounts, Merged, Stream};
pub use motion_profile::MotionProfile;
pub use packet::{FramePacket, GRAVITY_M_S2, ImuSample};
pub use rig::{DepthSensor, ImuNoise, ImuSensor, Rig, RigCamera, check_rotation, is_registered};
pub use skips::{SkipCount, SkipKind, Skipped, Skips};
pub use source::{Source, SourceError, SourceInfo};
pub use stamp::Stamp;
