#![doc = include_str!("../README.md")]

mod android;
mod bag;
mod bag_reader;
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
pub mod camera;
mod cancel;
mod csv;
mod decode;
mod euroc;
mod first_image;
mod frames;
mod icl_nuim;
mod images;
mod imu;
mod kitti;
mod live;
mod motion_pair;
mod numbered;
mod open;
mod options;
mod paced;
mod picked;
mod player;
mod prefetch;
mod recording;
mod rig;
mod seven_scenes;
mod std_host;
mod stray;
mod text;
mod tum;
mod uzh;
mod validator;

pub use bag::{Frames, NamedTopic, NamedTopicError, TopicRole};
pub use cancel::Cancel;
pub use decode::{ImageError, depth_in as decode_depth, gray as read_gray, gray_in as decode_gray};
pub use imu::read_imu;
pub use live::{MotionReading, PhonePort, PhoneSource, guessed, is_live, phone_imu, waiting_for};
pub use open::{image_size, open};
pub use options::{OpenOptions, SourceKind};
pub use paced::Paced;
pub use picked::Picked;
pub use rig::{NAMED_RIGS, NamedRig, assumed_in, named_rig, read_rig, read_rig_for, write_rig};
pub use std_host::{background, std_host};
pub use validator::{ImuWatch, Validator, doubts_of};
