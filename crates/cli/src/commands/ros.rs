//! `cairn ros`: the node of ROS 2, which is a program of its own, so that this one has nothing of DDS in it.

use crate::failure::Failure;
use crate::processes::beside_or_in_path;
use std::ffi::OsString;
use std::io::{Error, ErrorKind};
use std::process::Command;

/// The program.
const PROGRAM: &str = "cairn-ros";

/// Runs as a node of ROS 2: pictures in; odometry, tf and map out. Needs the program cairn-ros.
#[derive(clap::Args)]
pub struct Arguments {
    /// The arguments of cairn-ros, such as --camera stereo; cairn-ros --help explains them.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
    arguments: Vec<OsString>,
}

/// Runs the command: this process becomes the node.
///
/// # Errors
/// When the program is not installed or cannot be started.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut command = Command::new(beside_or_in_path(PROGRAM));
    let why = become_it(command.args(&arguments.arguments));
    Err(match why.kind() {
        ErrorKind::NotFound => Failure::new(
            "cairn ros",
            format!("the program {PROGRAM} is not installed"),
            "cargo install --path crates/ros --features dds, in the sources of Cairn",
        ),
        _ => Failure::new(PROGRAM, why.to_string(), "check that it can be executed"),
    })
}

/// Returns only where the program cannot be started.
#[cfg(unix)]
fn become_it(command: &mut Command) -> Error {
    std::os::unix::process::CommandExt::exec(command)
}

/// Returns only where the program cannot be started.
#[cfg(not(unix))]
fn become_it(command: &mut Command) -> Error {
    match command.status() {
        Ok(status) => std::process::exit(status.code().unwrap_or(1)),
        Err(why) => why,
    }
}
