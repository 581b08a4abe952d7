#![doc = include_str!("../README.md")]

mod certificate;
mod hub;
mod invitation;
mod lens;
mod link;
mod page;
mod server;
mod tls;
mod walk;
mod wire;
mod words;

pub use certificate::Certificate;
pub use invitation::{Invitation, lan_address};
pub use server::{CameraSource, OpenSource, Remote, ServeConfig, Server, WebError};
