//! `cairn team`: several robots with one graph, or one atlas.

mod agree;
mod fleet;
mod graph;
pub mod join;
pub mod member;
mod paths;
mod scale;
pub mod status;

use crate::failure::Failure;
use crate::output::Output;

/// Several robots with one graph, or one atlas.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Agree(agree::Arguments),
    Graph(graph::Arguments),
    Join(join::Arguments),
    Scale(scale::Arguments),
    Status(status::Arguments),
}

/// Runs the subcommand.
///
/// # Errors
/// Those of the subcommand.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Agree(arguments) => agree::run(arguments, output),
        Command::Graph(arguments) => graph::run(arguments, output),
        Command::Join(arguments) => join::run(arguments, output),
        Command::Scale(arguments) => scale::run(arguments, output),
        Command::Status(arguments) => status::run(arguments, output),
    }
}
