//! The integration tests of this crate, as one program.

mod browser;
mod client;
mod network;
mod orbit;
mod paced;
mod page;
mod pairing;
mod plain;
mod played;
mod requests;
mod script;
mod strangers;
mod walked;
