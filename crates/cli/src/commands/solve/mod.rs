//! `cairn solve`: the solver in the open, on files of the field.

mod bundle;
mod graph;

use crate::failure::Failure;
use crate::output::Output;
use cairn_solve::Stop;
use clap::Subcommand;
use std::path::Path;

/// Pose graphs and bundle adjustment on files: the same solver that closing loops uses.
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

/// Solves, and prints the costs before and after.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.problem {
        Problem::Graph(arguments) => graph::run(arguments, output),
        Problem::Bundle(arguments) => bundle::run(arguments, output),
    }
}

/// The text of a file.
fn text_of(path: &Path, form: &str) -> Result<String, Failure> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path)
        .map_err(|e| Failure::new(&name, e.to_string(), format!("give a file in {form} form")))?;
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Failure::new(
            &name,
            format!("is no text (byte {at} is not UTF-8)"),
            format!("give a file in {form} form"),
        )
    })
}

/// The reason in a word.
fn stop_name(stop: Stop) -> &'static str {
    match stop {
        Stop::Converged => "converged",
        Stop::Iterations => "iterations",
        Stop::Interrupted => "interrupted",
        Stop::NoDescent => "no descent",
        Stop::Empty => "nothing to move",
    }
}

/// A positive, finite number.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err("must be a number above 0".into()),
    }
}
