#![doc = include_str!("../README.md")]

mod authority;
mod beside;
mod certificate;
mod columns;
mod config;
mod connection;
mod depth;
mod doors;
mod error;
mod hub;
mod in_order;
mod invitation;
mod line;
mod link;
mod local_name;
mod page;
mod pair_requests;
mod pairing;
mod phones;
mod places;
mod pulse;
mod requests;
mod server;
mod site;
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

use cairn_session::lens_watch as lens;

pub use authority::{Authority, trusted};
pub use certificate::Certificate;
pub use config::{
    Aloud, CameraSource, MOST_CONNECTIONS, OpenSource, ServeConfig, SlamSetup, StartSlam, StartedSlam, Tell,
    engine_here,
};
pub use error::WebError;
pub use in_order::InOrder;
pub use invitation::{Invitation, lan_address, qr};
pub use server::{Remote, Server};
pub use site::{NoModule, site};
pub use still::{StillSurface, still};
