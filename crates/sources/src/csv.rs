//! Lines of a time stamp ([ns], or decimal seconds) and numbers in a CSV file, read as needed so that memory does not grow with
//! the recording.

use crate::text::{fields, numbers, place, stamp_any};
use cairn_sensor::{SkipKind, Skipped, SourceError, Stamp};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// Readings of `timestamp [ns], N numbers` lines, in file order; the merge checks that order.
pub struct CsvStream<const N: usize> {
    path: PathBuf,
    lines: BufReader<File>,
    /// Columns before the stamp.
    before: usize,
    number: usize,
    peeked: Option<(Stamp, [f64; N])>,
}

impl<const N: usize> CsvStream<N> {
    /// Opens the file, whose lines have these `columns` after the stamp. A file without a reading is an error.
    pub fn open(path: &Path, columns: &str) -> Result<Self, SourceError> {
        Self::open_after(path, 0, columns)
    }

    /// As [`CsvStream::open`], of lines with so many columns before the stamp, such as a number of the line.
    pub fn open_after(path: &Path, before: usize, columns: &str) -> Result<Self, SourceError> {
        // Only read piece by piece, so any size will do.
        let file = cairn_files::open(path, u64::MAX).map_err(|e| {
            SourceError::new(
                path.display().to_string(),
                format!("cannot be read ({e})"),
                "restore it, or give a rig without an IMU",
            )
        })?;
        let mut stream =
            Self { path: path.to_owned(), lines: BufReader::new(file), before, number: 0, peeked: None };
        let mut skipped = Vec::new();
        stream.peeked = stream.read(&mut skipped);
        if stream.peeked.is_none() {
            let why = skipped
                .first()
                .map_or("contains no sample".to_owned(), |s| format!("contains no sample ({})", s.text));
            return Err(SourceError::new(
                path.display().to_string(),
                why,
                format!("each line must be: timestamp [ns], {columns}"),
            ));
        }
        Ok(stream)
    }

    /// The next reading; other lines are listed in `skipped`. `None` at the end of the file.
    pub fn next(&mut self, skipped: &mut Vec<Skipped>) -> Option<(Stamp, [f64; N])> {
        match self.peeked.take() {
            Some(reading) => Some(reading),
            None => self.read(skipped),
        }
    }

    /// The file and the last line read, for error messages.
    pub fn place(&self) -> String {
        place(&self.path, self.number)
    }

    fn read(&mut self, skipped: &mut Vec<Skipped>) -> Option<(Stamp, [f64; N])> {
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            match self.lines.read_until(b'\n', &mut bytes) {
                Ok(0) => return None,
                Ok(_) => self.number += 1,
                Err(e) => {
                    let text = format!("{}: reading stopped ({e})", place(&self.path, self.number + 1));
                    skipped.push(Skipped::new(SkipKind::Imu, "reading stopped", text));
                    return None;
                }
            }
            let line = String::from_utf8_lossy(&bytes);
            let line = line.trim().trim_start_matches('\u{feff}');
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            match parse(line, self.before) {
                Some(reading) => return Some(reading),
                None => {
                    let text = format!("{}: not an IMU sample, dropped", self.place());
                    skipped.push(Skipped::new(SkipKind::Imu, "not an IMU sample", text));
                }
            }
        }
    }
}

fn parse<const N: usize>(line: &str, before: usize) -> Option<(Stamp, [f64; N])> {
    let mut from = fields(line).skip(before);
    Some((stamp_any(from.next()?)?, numbers::<N>(from)?))
}
