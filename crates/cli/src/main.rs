//! The `cairn` command: arguments in, text or JSON out. All computation happens in the library crates.
//!
//! Results go to stdout, everything else to stderr. Exit code 0: done; 1: the work failed (one line that
//! says what failed, why, and what to do); 2: wrong usage; 3: an unknown place; 130: interrupted, and everything until then is written.

mod commands;
mod demo;
mod failure;
mod help;
mod interrupt;
mod log;
mod map_lock;
mod number;
mod output;
mod outputs;
mod processes;
mod progress;
mod socket;
mod speaking;
mod style;
mod surface;
mod terminal;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use failure::Failure;
use output::Output;
use std::process::ExitCode;
use std::time::Instant;

/// Visual-inertial SLAM that records your route and guides you along it; evaluation and simulation tools.
#[derive(Parser)]
#[command(name = "cairn", version, propagate_version = true)]
struct Arguments {
    /// Print the result as JSON on stdout; log messages still go to stderr.
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
    Bench(commands::bench::Arguments),
    Ekf(commands::ekf::Arguments),
    Sim(commands::sim::Arguments),
    Map(commands::map::Arguments),
    #[command(alias = "way")]
    Route(commands::route::Arguments),
    Plan(commands::plan::Arguments),
    Mesh(commands::mesh::Arguments),
    View(commands::view::Arguments),
    Solve(commands::solve::Arguments),
    Team(commands::team::Arguments),
    Fleet(commands::fleet::Arguments),
    Rig(commands::rig::Arguments),
    Vocab(commands::vocab::Arguments),
    Config(commands::config::Arguments),
    Doctor(commands::doctor::Arguments),
    Serve(Box<commands::serve::Arguments>),
    Page(commands::page::Arguments),
    Ros(commands::ros::Arguments),
    Completions(commands::completions::Completions),
    #[command(hide = true)]
    Man(commands::completions::Man),
}

fn main() -> ExitCode {
    let began = Instant::now();
    if commands::rig::list_is_asked_for() {
        return commands::rig::list();
    }
    // clap handles help (code 0) and wrong usage (code 2).
    let matches = help::grouped(Arguments::command()).get_matches();
    let arguments = Arguments::from_arg_matches(&matches).unwrap_or_else(|e| e.exit());
    let output = Output::new(arguments.json);
    if let Some(wrong) = log::start() {
        tracing::warn!("{wrong}");
    }
    interrupt::listen();
    match run(arguments.command, &output, began) {
        Ok(()) if interrupt::requested() => ExitCode::from(output::INTERRUPTED),
        Ok(()) => ExitCode::SUCCESS,
        Err(_) if interrupt::requested() && !interrupt::is_in_order() => output.interrupted(),
        Err(failure) => output.fail(&failure),
    }
}

fn run(command: Command, output: &Output, began: Instant) -> Result<(), Failure> {
    match command {
        Command::Demo(arguments) => demo::run(&arguments, output),
        Command::Run(arguments) => commands::run::run(&arguments, output, began),
        Command::Eval(arguments) => commands::eval::run(&arguments, output),
        Command::Bench(arguments) => commands::bench::run(&arguments, output),
        Command::Ekf(arguments) => commands::ekf::run(&arguments, output),
        Command::Sim(arguments) => commands::sim::run(&arguments, output),
        Command::Map(arguments) => commands::map::run(&arguments, output),
        Command::Route(arguments) => commands::route::run(&arguments, output),
        Command::Mesh(arguments) => commands::mesh::run(&arguments, output),
        Command::View(arguments) => commands::view::run(&arguments, output),
        Command::Vocab(arguments) => commands::vocab::run(&arguments, output),
        Command::Plan(arguments) => commands::plan::run(&arguments, output),
        Command::Solve(arguments) => commands::solve::run(&arguments, output),
        Command::Team(arguments) => commands::team::run(&arguments, output),
        Command::Fleet(arguments) => commands::fleet::run(&arguments, output),
        Command::Rig(arguments) => commands::rig::run(&arguments, output),
        Command::Config(arguments) => commands::config::run(&arguments, output),
        Command::Doctor(arguments) => commands::doctor::run(&arguments, output),
        Command::Serve(arguments) => commands::serve::run(&arguments, output),
        Command::Page(arguments) => commands::page::run(&arguments, output),
        Command::Ros(arguments) => commands::ros::run(&arguments),
        Command::Completions(arguments) => commands::completions::completions(&arguments),
        Command::Man(arguments) => commands::completions::man(&arguments, output),
    }
}
