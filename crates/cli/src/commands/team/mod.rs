//! `cairn team`: several robots with one graph.

mod graph;

use crate::failure::Failure;
use crate::output::Output;

/// Several robots with one graph.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Graph(graph::Arguments),
}

/// Runs the subcommand.
///
/// # Errors
/// Those of the subcommand.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Graph(arguments) => graph::run(arguments, output),
    }
}
