//! IMU samples from CSV files: of one file with both sensors, or of one for each.

use crate::csv::CsvStream;
use crate::motion_pair::MotionPair;
use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, Skipped, SourceError, Stamp};
use std::path::Path;

/// Where the readings are in a line, and the unit of force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Columns {
    /// Columns before the time stamp.
    pub before: usize,
    /// Whether the accelerometer comes before the gyroscope.
    pub accel_first: bool,
    /// What is one in the file, m/s^2 of specific force; negative where the file has gravity in its stead.
    pub accel_unit: f64,
}

impl Default for Columns {
    /// `timestamp, gyro xyz, accel xyz [m/s^2]`, as EuRoC has them.
    fn default() -> Self {
        Self { before: 0, accel_first: false, accel_unit: 1.0 }
    }
}

/// Samples of lines of a time stamp, gyro xyz \[rad/s\] and accel xyz, in this order or the other.
pub struct ImuStream {
    lines: CsvStream<6>,
    columns: Columns,
}

impl ImuStream {
    /// Opens the file. A file without a sample is an error.
    pub fn open(path: &Path, columns: Columns) -> Result<Self, SourceError> {
        let names = match columns.accel_first {
            false => "gyro xyz [rad/s], accel xyz [m/s^2]",
            true => "accel xyz [m/s^2], gyro xyz [rad/s]",
        };
        Ok(Self { lines: CsvStream::open_after(path, columns.before, names)?, columns })
    }

    /// The next sample; other lines are listed in `skipped`. `None` at the end of the file.
    pub fn next(&mut self, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        let (stamp, [a, b, c, d, e, f]) = self.lines.next(skipped)?;
        let (first, second) = (Vec3::new(a, b, c), Vec3::new(d, e, f));
        let (gyro, accel) = if self.columns.accel_first { (second, first) } else { (first, second) };
        Some(ImuSample::new(stamp, gyro, accel * self.columns.accel_unit))
    }

    /// The file and the last line read, for error messages.
    pub fn place(&self) -> String {
        self.lines.place()
    }
}

/// Readings per second by the median step of samples, `None` of fewer than two.
pub fn rate_hz(samples: &[ImuSample]) -> Option<f64> {
    let mut steps: Vec<f64> =
        samples.windows(2).map(|w| w[1].stamp - w[0].stamp).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map(|step| 1.0 / step)
}

/// The first samples of a file, at most so many; none where it cannot be read.
pub fn first_samples(path: &Path, columns: Columns, most: usize) -> Vec<ImuSample> {
    let Ok(mut stream) = ImuStream::open(path, columns) else { return Vec::new() };
    let mut skipped = Vec::new();
    std::iter::from_fn(|| stream.next(&mut skipped)).take(most).collect()
}

/// Samples of a gyroscope and an accelerometer that have a file each, `timestamp [ns], xyz`, and stamps of their own: one for each
/// reading of the gyroscope.
pub struct SplitImuStream {
    gyro: CsvStream<3>,
    accel: CsvStream<3>,
    /// The last stamp read of each; `None` at its end.
    read_to: [Option<Stamp>; 2],
    pair: MotionPair,
}

impl SplitImuStream {
    /// Opens both files. One without a reading is an error.
    pub fn open(gyro: &Path, accel: &Path) -> Result<Self, SourceError> {
        Ok(Self {
            gyro: CsvStream::open(gyro, "gyro xyz [rad/s]")?,
            accel: CsvStream::open(accel, "accel xyz [m/s^2]")?,
            read_to: [Some(Stamp(i64::MIN)); 2],
            pair: MotionPair::default(),
        })
    }

    /// The next sample; lines that are no reading are listed in `skipped`. `None` where one of the files has ended.
    pub fn next(&mut self, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        loop {
            if let Some(sample) = self.pair.pop() {
                return Some(sample);
            }
            match self.read_to {
                // Without a force at or after it, a reading of the gyroscope is no sample.
                [_, None] => return None,
                [Some(gyro), Some(accel)] if gyro <= accel => {
                    let read = self.gyro.next(skipped);
                    self.read_to[0] = read.map(|(stamp, _)| stamp);
                    read.into_iter().for_each(|(stamp, v)| self.pair.gyro(stamp, Vec3::from(v)));
                }
                [gyro, Some(_)] => {
                    if gyro.is_none() && self.pair.is_empty() {
                        return None;
                    }
                    let read = self.accel.next(skipped);
                    self.read_to[1] = read.map(|(stamp, _)| stamp);
                    read.into_iter().for_each(|(stamp, v)| self.pair.accel(stamp, Vec3::from(v)));
                }
            }
        }
    }

    /// The file of the gyroscope and the last line read, for error messages.
    pub fn place(&self) -> String {
        self.gyro.place()
    }
}

/// All samples of such a file, as recordings have them: `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]`
/// lines. Other lines are left out.
///
/// # Errors
/// When the file cannot be read or contains no sample.
pub fn read_imu(path: impl AsRef<Path>) -> Result<Vec<ImuSample>, SourceError> {
    let mut stream = ImuStream::open(path.as_ref(), Columns::default())?;
    let mut skipped = Vec::new();
    Ok(std::iter::from_fn(|| stream.next(&mut skipped)).collect())
}
