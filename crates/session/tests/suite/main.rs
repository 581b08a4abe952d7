//! The integration tests of this crate, as one program.

// For `small`, which unit tests include too.
use cairn_guide::Durable;
use cairn_session::Medium;

mod library;
mod scale;
mod small;
mod take_me;
mod walk;
mod wheels;
