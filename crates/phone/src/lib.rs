#![doc = include_str!("../README.md")]

#[cfg(target_arch = "wasm32")]
mod exports;
mod message;
mod phone;
mod report;
mod setup;

pub use message::{Answer, Message, MessageError, apply, read, write};
pub use phone::{Phone, PhoneError};
pub use report::Report;
pub use setup::Setup;
