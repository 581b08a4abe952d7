#![doc = include_str!("../README.md")]

mod clock;
#[cfg(target_arch = "wasm32")]
mod exports;
mod message;
mod phone;
mod report;
mod setup;
mod shown;
mod start;

pub use message::{Answer, Message, MessageError, apply, read, write};
pub use phone::{Phone, PhoneError};
pub use report::{Report, Spoken};
pub use setup::{Library, Setup};
pub use shown::Shown;
