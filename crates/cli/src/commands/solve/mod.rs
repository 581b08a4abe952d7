//! `cairn solve`: runs the solver on files in standard formats.

mod bundle;
mod graph;

pub(in crate::commands) use graph::HINT;

use crate::failure::Failure;
use crate::output::Output;
use cairn_solve::Stop;
use clap::Subcommand;
use std::path::Path;

/// Solves pose graphs (g2o, TORO, iSAM) and bundle adjustment problems (BAL) with the solver that SLAM uses.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    problem: Problem,
}

#[derive(Subcommand)]
enum Problem {
    Graph(graph::Arguments),
    Bundle(bundle::Arguments),
}

/// Solves the problem and prints the cost before and after.
///
/// # Errors
/// When the file cannot be read or is invalid, the solver makes no progress, or the result cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.problem {
        Problem::Graph(arguments) => graph::run(arguments, output),
        Problem::Bundle(arguments) => bundle::run(arguments, output),
    }
}

/// Largest problem: the final Venice of BAL has 0.4 GB.
const MAX_BYTES: u64 = 2048 * cairn_files::MIB;

/// Reads a text file.
pub(in crate::commands) fn text_of(path: &Path, form: &str) -> Result<String, Failure> {
    let name = path.display().to_string();
    cairn_files::read_text(path, MAX_BYTES)
        .map_err(|e| Failure::new(&name, e.to_string(), format!("give a file in {form} format")))
}

/// Why the solver stopped.
fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Converged => "converged",
        Stop::Iterations => "iterations",
        Stop::Interrupted => "interrupted",
        Stop::NoDescent => "no descent",
        Stop::Empty => "nothing to move",
    }
}
