#![doc = include_str!("../README.md")]

mod certificate;
mod config;
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
pub use config::{CameraSource, OpenSource, ServeConfig};
pub use invitation::{Invitation, lan_address};
pub use server::{Remote, Server, WebError};
