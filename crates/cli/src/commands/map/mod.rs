//! `cairn map`: what is in saved maps, whether they are whole, their points and key frames for others, several in one.

mod check;
mod export;
mod info;
mod merge;

use crate::failure::Failure;
use crate::output::Output;
use cairn_atlas::store::{MapFile, StoreError};
use std::path::{Path, PathBuf};

/// Saved maps: what is in them, whether they are whole; export, and several sessions in one file.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Key frames, landmarks, worlds, ways, what it was made with, and bytes of each part.
    Info(Files),
    /// Reads every part and checks the rules of a map; names what is damaged.
    Check(Files),
    Export(export::Arguments),
    Merge(merge::Arguments),
}

/// Saved maps.
#[derive(clap::Args)]
struct Files {
    /// The saved maps.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// What the names of attached recorded ways begin with.
pub const WAY: &str = "way/";

/// Runs the subcommand.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Info(a) => info::run(&a.files, output),
        Command::Check(a) => check::run(&a.files, output),
        Command::Export(a) => export::run(a, output),
        Command::Merge(a) => merge::run(a, output),
    }
}

/// Opens a saved map.
pub fn open(path: &Path) -> Result<MapFile, Failure> {
    MapFile::load(path).map_err(|e| failed(path, &e))
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|e| Failure::new(path.display().to_string(), e.to_string(), "check the path"))
}

/// What went wrong with a map file, and what to do.
pub fn failed(path: &Path, error: &StoreError) -> Failure {
    let shown = path.display().to_string();
    match error {
        StoreError::File { doing: "cannot read", source, .. } => {
            Failure::new(shown, source.to_string(), "check the path")
        }
        StoreError::File { doing, source, .. } => {
            let hint =
                "check that its folder exists, may be written, and has room; what was there before still is";
            Failure::new(shown, format!("{doing}: {source}"), hint)
        }
        StoreError::Foreign(_) => {
            Failure::new(shown, error.to_string(), "give a file that cairn run --map-out wrote")
        }
        StoreError::Version { .. } => {
            Failure::new(shown, error.to_string(), "open it with the cairn that wrote it, or a newer one")
        }
        StoreError::Part { .. } => {
            let hint = "the file is damaged: take a copy; cairn map check tells which parts are whole";
            Failure::new(shown, error.to_string(), hint)
        }
        StoreError::Unfit(_) => Failure::new(shown, error.to_string(), "report it with the recording"),
    }
}
