#![doc = include_str!("../README.md")]

mod bag;
mod cancel;
mod decode;
mod euroc;
mod images;
mod imu;
mod kitti;
mod live;
mod open;
mod paced;
mod picked;
mod player;
mod prefetch;
mod recording;
mod rig;
mod seven_scenes;
mod text;
mod tum;
mod validator;

pub use bag::{NamedTopic, TopicRole};
pub use cancel::Cancel;
pub use decode::gray as read_gray;
pub use imu::read_imu;
pub use live::{Motion, PhonePort, PhoneSource, guessed, is_live, phone_imu, waiting_for};
pub use open::{OpenOptions, SourceKind, image_size, open};
pub use paced::Paced;
pub use picked::Picked;
pub use rig::{NAMED_RIGS, NamedRig, named_rig, read_rig, read_rig_for, write_rig};
pub use validator::{ImuWatch, Validator, doubts_of};
