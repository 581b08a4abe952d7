#![doc = include_str!("../README.md")]

mod authority;
mod certificate;
mod columns;
mod config;
mod connection;
mod depth;
mod drawn;
mod error;
mod hub;
mod invitation;
mod lens;
mod line;
mod link;
mod page;
mod pulse;
mod requests;
mod server;
mod start;
mod still;
mod surface;
mod survive;
mod tls;
mod token;
mod trust;
mod walk;
mod wire;
mod words;

pub use authority::{Authority, trusted};
pub use certificate::Certificate;
pub use config::{CameraSource, OpenSource, ServeConfig, SlamSetup, StartSlam, StartedSlam, engine_here};
pub use error::WebError;
pub use invitation::{Invitation, lan_address, qr};
pub use server::{Remote, Server};
pub use still::{StillSurface, still};
