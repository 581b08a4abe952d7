//! IMU samples from a csv file, read as they are needed so that memory does not grow with the recording.

use crate::text::{fields, numbers, place, stamp_ns};
use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, SourceError, Stamp};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// Samples of `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]` lines, strictly increasing in time.
pub struct ImuStream {
    path: PathBuf,
    lines: BufReader<File>,
    number: usize,
    offset_ns: i64,
    last: Option<Stamp>,
    peeked: Option<ImuSample>,
}

impl ImuStream {
    /// Opens the file; `offset_s` is added to every stamp. An empty file is an error.
    pub fn open(path: &Path, offset_s: f64) -> Result<Self, SourceError> {
        let file = File::open(path).map_err(|e| {
            SourceError::new(
                path.display().to_string(),
                format!("can not be read ({e})"),
                "restore it, or give a rig without an IMU",
            )
        })?;
        let offset_ns = (offset_s * 1e9).round() as i64;
        let mut stream = Self {
            path: path.to_owned(),
            lines: BufReader::new(file),
            number: 0,
            offset_ns,
            last: None,
            peeked: None,
        };
        let mut skipped = Vec::new();
        stream.peeked = stream.read(&mut skipped);
        if stream.peeked.is_none() {
            let why =
                skipped.first().map_or("holds no sample".to_owned(), |s| format!("holds no sample ({s})"));
            return Err(SourceError::new(
                path.display().to_string(),
                why,
                "each line must be: timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]",
            ));
        }
        Ok(stream)
    }

    /// Appends every sample not yet given up to the first at or after `until`; what is dropped goes to `skipped`.
    pub fn take_until(&mut self, until: Stamp, out: &mut Vec<ImuSample>, skipped: &mut Vec<String>) {
        while let Some(sample) = self.peeked.take() {
            out.push(sample);
            self.peeked = self.read(skipped);
            if sample.stamp >= until {
                return;
            }
        }
    }

    /// The next good sample; `None` at the end of the file.
    fn read(&mut self, skipped: &mut Vec<String>) -> Option<ImuSample> {
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            match self.lines.read_until(b'\n', &mut bytes) {
                Ok(0) => return None,
                Ok(_) => self.number += 1,
                Err(e) => {
                    skipped.push(format!("{}: reading stopped ({e})", place(&self.path, self.number + 1)));
                    return None;
                }
            }
            let line = String::from_utf8_lossy(&bytes);
            let line = line.trim().trim_start_matches('\u{feff}');
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some(sample) = parse(line, self.offset_ns) else {
                skipped.push(format!("{}: not an IMU sample, dropped", place(&self.path, self.number)));
                continue;
            };
            if self.last.is_some_and(|last| sample.stamp <= last) {
                let why = "the time does not go forward, sample dropped";
                skipped.push(format!("{}: {why}", place(&self.path, self.number)));
                continue;
            }
            self.last = Some(sample.stamp);
            return Some(sample);
        }
    }
}

fn parse(line: &str, offset_ns: i64) -> Option<ImuSample> {
    let mut from = fields(line);
    let stamp = Stamp(stamp_ns(from.next()?)?.0.checked_add(offset_ns)?);
    let [gx, gy, gz, ax, ay, az] = numbers::<6>(from)?;
    Some(ImuSample { stamp, gyro: Vec3::new(gx, gy, gz), accel: Vec3::new(ax, ay, az) })
}
