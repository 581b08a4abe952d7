//! IMU samples from a CSV file, read as needed so that memory does not grow with the recording.

use crate::text::{fields, numbers, place, stamp_any};
use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, SkipKind, Skipped, SourceError};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// Samples of `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]` lines, in file order; the merge checks
/// that order.
pub struct ImuStream {
    path: PathBuf,
    lines: BufReader<File>,
    number: usize,
    peeked: Option<ImuSample>,
}

impl ImuStream {
    /// Opens the file. A file without a sample is an error.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        // Only read piece by piece, so any size will do.
        let file = cairn_files::open(path, u64::MAX).map_err(|e| {
            SourceError::new(
                path.display().to_string(),
                format!("cannot be read ({e})"),
                "restore it, or give a rig without an IMU",
            )
        })?;
        let mut stream = Self { path: path.to_owned(), lines: BufReader::new(file), number: 0, peeked: None };
        let mut skipped = Vec::new();
        stream.peeked = stream.read(&mut skipped);
        if stream.peeked.is_none() {
            let why = skipped
                .first()
                .map_or("contains no sample".to_owned(), |s| format!("contains no sample ({})", s.text));
            return Err(SourceError::new(
                path.display().to_string(),
                why,
                "each line must be: timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]",
            ));
        }
        Ok(stream)
    }

    /// The next sample; other lines are listed in `skipped`. `None` at the end of the file.
    pub fn next(&mut self, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        match self.peeked.take() {
            Some(sample) => Some(sample),
            None => self.read(skipped),
        }
    }

    /// The file and the last line read, for error messages.
    pub fn place(&self) -> String {
        place(&self.path, self.number)
    }

    fn read(&mut self, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
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
            match parse(line) {
                Some(sample) => return Some(sample),
                None => {
                    let text = format!("{}: not an IMU sample, dropped", self.place());
                    skipped.push(Skipped::new(SkipKind::Imu, "not an IMU sample", text));
                }
            }
        }
    }
}

/// All samples of such a file, as recordings have them: `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]`
/// lines. Other lines are left out.
///
/// # Errors
/// When the file cannot be read or contains no sample.
pub fn read_imu(path: impl AsRef<Path>) -> Result<Vec<ImuSample>, SourceError> {
    let mut stream = ImuStream::open(path.as_ref())?;
    let mut skipped = Vec::new();
    Ok(std::iter::from_fn(|| stream.next(&mut skipped)).collect())
}

fn parse(line: &str) -> Option<ImuSample> {
    let mut from = fields(line);
    let stamp = stamp_any(from.next()?)?;
    let [gx, gy, gz, ax, ay, az] = numbers::<6>(from)?;
    Some(ImuSample::new(stamp, Vec3::new(gx, gy, gz), Vec3::new(ax, ay, az)))
}
