//! IMU samples from CSV files: of one file with both sensors, or of one for each.

use crate::csv::CsvStream;
use crate::motion_pair::MotionPair;
use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, Skipped, SourceError, Stamp};
use std::path::Path;

/// Samples of `timestamp [ns], gyro xyz [rad/s], accel xyz [m/s^2]` lines.
pub struct ImuStream(CsvStream<6>);

impl ImuStream {
    /// Opens the file. A file without a sample is an error.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        CsvStream::open(path, "gyro xyz [rad/s], accel xyz [m/s^2]").map(Self)
    }

    /// The next sample; other lines are listed in `skipped`. `None` at the end of the file.
    pub fn next(&mut self, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        let (stamp, [gx, gy, gz, ax, ay, az]) = self.0.next(skipped)?;
        Some(ImuSample::new(stamp, Vec3::new(gx, gy, gz), Vec3::new(ax, ay, az)))
    }

    /// The file and the last line read, for error messages.
    pub fn place(&self) -> String {
        self.0.place()
    }
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
    let mut stream = ImuStream::open(path.as_ref())?;
    let mut skipped = Vec::new();
    Ok(std::iter::from_fn(|| stream.next(&mut skipped)).collect())
}
