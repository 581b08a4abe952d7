//! `cairn map`: inspects, checks, exports and merges saved maps.

mod check;
mod export;
mod info;
mod merge;
mod photogrammetry;
mod repair;

use crate::failure::Failure;
use crate::output::Output;
use cairn_atlas::store::{Length, MapFile, StoreError, read_file};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Inspects, checks, exports, merges and repairs saved maps.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Shows maps, key frames, landmarks, routes, the sensor, and the size of each part of the file.
    Info(Files),
    /// Reads every part, checks the map for consistency, and names damaged parts.
    Check(Files),
    Export(export::Arguments),
    Merge(merge::Arguments),
    Repair(repair::Arguments),
}

/// Saved maps.
#[derive(clap::Args)]
struct Files {
    /// The saved maps.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// Runs the subcommand.
///
/// # Errors
/// When a file cannot be read, is damaged or cannot be written.
pub fn run(arguments: &Arguments, output: &Output) -> Result<(), Failure> {
    match &arguments.command {
        Command::Info(a) => info::run(&a.files, output),
        Command::Check(a) => check::run(&a.files, output),
        Command::Export(a) => export::run(a, output),
        Command::Merge(a) => merge::run(a, output),
        Command::Repair(a) => repair::run(a, output),
    }
}

/// Name of the part of a saved map with the doubts about the source it was made from, one a line.
const DOUBTS: &str = "doubts";

/// Attaches doubts to a map, after those of the map it goes on from.
pub fn attach_doubts(file: &mut MapFile, doubts: impl Iterator<Item = String>) {
    let mut all = doubts_of(file);
    for doubt in doubts {
        if !all.contains(&doubt) {
            all.push(doubt);
        }
    }
    if !all.is_empty() {
        file.attached.retain(|name, _| !name.starts_with(DOUBTS));
        file.attached.insert(DOUBTS.into(), all.join("\n").into_bytes());
    }
}

/// What was doubtful of the source of a saved map; of a merged one, of all of them.
pub fn doubts_of(file: &MapFile) -> Vec<String> {
    let parts = file.attached.iter().filter(|(name, _)| name.starts_with(DOUBTS));
    let mut all: Vec<String> = Vec::new();
    for line in parts
        .flat_map(|(_, bytes)| String::from_utf8_lossy(bytes).lines().map(str::to_owned).collect::<Vec<_>>())
    {
        if !all.contains(&line) {
            all.push(line);
        }
    }
    all
}

/// Opens a saved map.
///
/// # Errors
/// When the file cannot be read, is not a map or is damaged.
pub fn open(path: &Path) -> Result<MapFile, Failure> {
    MapFile::load(path).map_err(|e| failed(path, &e))
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, Failure> {
    read_file(path, Length::Any).map_err(|e| failed(path, &e))
}

/// The failure for an error of a map file, with what to do.
pub fn failed(path: &Path, error: &StoreError) -> Failure {
    let shown = path.display().to_string();
    match error {
        StoreError::File { doing: "cannot read", source, .. } => {
            Failure::new(shown, source.to_string(), "check the path")
        }
        StoreError::File { doing, source, .. } => {
            let hint = "check that its folder is there and writable, and that the disk has room; an older file there is unchanged";
            Failure::new(shown, format!("{doing}: {source}"), hint)
        }
        StoreError::Foreign(_) => {
            let mut first = [0; 15];
            let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut first));
            let hint = match read.is_ok() && &first == b"SQLite format 3" {
                true => {
                    "this is a database, such as RTAB-Map's: rtabmap-report --poses exports its poses, rtabmap-export its map; Cairn makes a map of its own from the recording"
                }
                false => "give a file that cairn run --map-out wrote",
            };
            Failure::new(shown, error.to_string(), hint)
        }
        StoreError::Version { .. } => Failure::new(
            shown,
            error.to_string(),
            "open it with the version of cairn that wrote it, or a newer one",
        ),
        StoreError::Descriptors { .. } => Failure::new(
            shown,
            error.to_string(),
            "record the place again with this program, or use the one that made the map",
        ),
        StoreError::Part { .. } => {
            let hint =
                "the file is damaged: use a backup; cairn map repair saves what is whole in a new file";
            Failure::new(shown, error.to_string(), hint)
        }
        StoreError::CombineError(_) => {
            Failure::new(shown, error.to_string(), "report this with the recording")
        }
    }
}
