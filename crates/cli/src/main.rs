//! The `cairn` command: arguments in, text or JSON out; what is computed is computed in the crates below.
//!
//! Results go to stdout, everything else to stderr. Exit code 0: done; 1: the work failed (one line that
//! says what, why, and what to do); 2: wrong usage.

mod commands;
mod demo;
mod failure;
mod output;
mod progress;
mod terminal;

use clap::{Parser, Subcommand};
use failure::Failure;
use output::Output;
use std::process::ExitCode;
use std::time::Instant;

/// Remembers the way you came and guides you back: SLAM, evaluation, simulation, guidance.
#[derive(Parser)]
#[command(name = "cairn", version, propagate_version = true)]
struct Arguments {
    /// Print the result as JSON on stdout; logs still go to stderr.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Run(Box<commands::run::Arguments>),
    Eval(commands::eval::Arguments),
    Sim(commands::sim::Arguments),
    Map(commands::map::Arguments),
    Mesh(commands::mesh::Arguments),
    Way(commands::way::Arguments),
    Solve(commands::solve::Arguments),
    Rig(commands::rig::Arguments),
    Vocab(commands::vocab::Arguments),
    Config(commands::config::Arguments),
    Doctor(commands::doctor::Arguments),
    Serve(Box<commands::serve::Arguments>),
}

fn main() -> ExitCode {
    let began = Instant::now();
    // clap prints help (code 0) and wrong usage (code 2) by itself.
    let arguments = Arguments::parse();
    let output = Output::new(arguments.json);
    match run(arguments.command, &output, began) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => output.fail(&failure),
    }
}

fn run(command: Command, output: &Output, began: Instant) -> Result<(), Failure> {
    match command {
        Command::Demo(arguments) => demo::run(&arguments, output),
        Command::Run(arguments) => commands::run::run(&arguments, output, began),
        Command::Eval(arguments) => commands::eval::run(&arguments, output),
        Command::Sim(arguments) => commands::sim::run(&arguments, output),
        Command::Map(arguments) => commands::map::run(&arguments, output),
        Command::Mesh(arguments) => commands::mesh::run(&arguments, output),
        Command::Way(arguments) => commands::way::run(&arguments, output),
        Command::Vocab(arguments) => commands::vocab::run(&arguments, output),
        Command::Solve(arguments) => commands::solve::run(&arguments, output),
        Command::Rig(arguments) => commands::rig::run(&arguments, output),
        Command::Config(arguments) => commands::config::run(&arguments, output),
        Command::Doctor(arguments) => commands::doctor::run(&arguments, output),
        Command::Serve(arguments) => commands::serve::run(&arguments, output),
    }
}
