//! `cairn config`: the whole default configuration, with a comment at each entry.

use crate::failure::Failure;
use crate::output::Output;
use cairn_engine::Config;

/// The whole default configuration as TOML, with a comment at each entry.
///
/// Save what you change to a file and give it to `cairn run --config FILE`; what a file leaves out keeps its default.
#[derive(clap::Args)]
pub struct Arguments {}

/// Prints it.
pub fn run(_: &Arguments, output: &Output) -> Result<(), Failure> {
    output.result(&Config::default(), |_| Config::default_toml().to_owned())
}
