//! `cairn map check`: reads every part of saved maps and checks them for consistency.

use super::{bytes_of, failed};
use crate::failure::Failure;
use crate::output::Output;
use cairn_atlas::store::{MapFile, inspect};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
struct Checked {
    file: PathBuf,
    good: bool,
    /// What is wrong, if anything.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
    parts: Vec<PartReport>,
    #[serde(skip)]
    failure: Option<Failure>,
}

#[derive(Serialize)]
struct PartReport {
    name: String,
    bytes: u64,
    good: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
}

/// All files, in the order given.
#[derive(Serialize)]
struct AllChecked {
    maps: Vec<Checked>,
}

/// Checks the maps.
///
/// # Errors
/// When one of them cannot be read, is damaged or inconsistent.
pub fn run(files: &[PathBuf], output: &Output) -> Result<(), Failure> {
    let mut all = AllChecked { maps: files.iter().map(|path| check(path)).collect::<Result<_, _>>()? };
    match all.maps.iter_mut().find_map(|c| c.failure.take()) {
        None => output.result(&all, text),
        Some(failure) => {
            output.text(&text(&all))?;
            Err(failure)
        }
    }
}

fn check(path: &Path) -> Result<Checked, Failure> {
    let bytes = bytes_of(path)?;
    let parts = inspect(&bytes).unwrap_or_default();
    let parts = parts.into_iter().map(|(info, wrong)| PartReport {
        name: info.name,
        bytes: info.stored_bytes,
        good: wrong.is_none(),
        why: wrong.map(|e| e.to_string()),
    });
    let error = MapFile::read(&bytes).and_then(|file| file.depth()).err();
    Ok(Checked {
        file: path.to_owned(),
        good: error.is_none(),
        why: error.as_ref().map(|e| e.to_string()),
        parts: parts.collect(),
        failure: error.map(|e| failed(path, &e)),
    })
}

fn text(all: &AllChecked) -> String {
    let mut text = String::new();
    for c in &all.maps {
        // Writing to a string cannot fail.
        let _ = match &c.why {
            None => writeln!(text, "good      {}: {} parts, all consistent", c.file.display(), c.parts.len()),
            Some(why) => writeln!(text, "bad       {}: {why}", c.file.display()),
        };
        if !c.good {
            for p in &c.parts {
                let state = p.why.as_deref().unwrap_or("whole");
                let _ = writeln!(text, "  {:<20}{:>12} bytes  {state}", p.name, p.bytes);
            }
        }
    }
    text
}
