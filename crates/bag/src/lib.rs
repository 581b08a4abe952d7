#![doc = include_str!("../README.md")]

mod area;
mod bag;
mod calibration;
mod compression;
mod error;
mod index;
mod mcap;
mod message;
mod pixels;
mod protobuf;
mod rosbag1;
mod rosbag2;
mod rvl;
mod sqlite;
mod wire;
mod write;

pub use bag::{Bag, is_bag};
pub use calibration::{CameraInfo, stereo_left_from_right};
pub use error::{BagError, DecodeError};
pub use index::{Entry, Topic};
pub use message::{CompressedImage, ImageMessage, ImuMessage, MessageKind, TransformStamped};
pub use message::{float32, key_value, stamped_pose, static_transforms, string, transform};
pub use pixels::bits_in_use;
pub use wire::{Header, Wire, WireFormat};
pub use write::{Channel, McapWriter, foxglove};
