//! `cairn fleet`: many recorded walks into one atlas, and a tile of it by place.

mod build;
mod fetch;

use crate::failure::Failure;
use crate::output::Output;
use cairn_fleet::FleetError;

/// Many recorded walks into one atlas, over several machines; a tile of it by place.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Build(build::Arguments),
    Fetch(fetch::Arguments),
}

/// Runs the subcommand.
///
/// # Errors
/// Those of the subcommand.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Build(arguments) => build::run(arguments, output),
        Command::Fetch(arguments) => fetch::run(arguments, output),
    }
}

fn failed(e: FleetError) -> Failure {
    Failure::new(e.what, e.why, e.cure)
}
