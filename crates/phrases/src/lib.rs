#![doc = include_str!("../README.md")]

mod catalogue;
mod language;
mod page;

pub use catalogue::Arg;
pub use language::{Language, UnknownLanguage};
pub use page::page_messages;
