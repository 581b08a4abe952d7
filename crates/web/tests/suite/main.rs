//! The integration tests of this crate, as one program.

mod browser;
mod client;
mod network;
mod orbit;
mod paced;
mod page;
mod plain;
mod played;
mod requests;
mod strangers;
mod walked;
