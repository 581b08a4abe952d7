//! Peers that share what they published: whatever the network does, all have the same in the end, and nothing is
//! believed that its robot did not sign.

mod maps;
mod places;
mod team;
mod words;
