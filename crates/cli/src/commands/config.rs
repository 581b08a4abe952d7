//! `cairn config`: the complete default configuration, with a comment for each entry.

use crate::failure::Failure;
use crate::output::Output;
use cairn_session::FileConfig;

/// Prints the complete default configuration as TOML, with a comment for each entry.
///
/// Put the entries you want to change into a file and pass it with `cairn run --config FILE`; entries that the file
/// leaves out keep their defaults.
#[derive(clap::Args)]
pub struct Arguments {}

/// Prints the default configuration.
///
/// # Errors
/// When stdout cannot be written.
pub fn run(_: &Arguments, output: &Output) -> Result<(), Failure> {
    output.result(&FileConfig::default(), |_| FileConfig::default_toml())
}
