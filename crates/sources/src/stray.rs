//! Stray Scanner's tables: `odometry.csv` (`timestamp, frame, x, y, z, qx, qy, qz, qw`, in ARKit's world, whose y axis points up)
//! and `imu.csv` (`timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z`, in the axes of the phone held upright).
//!
//! Versions of the app write the accelerometer in g or m/s^2, with gravity or without, and as Core Motion gives it: at rest it
//! points down. What a file has is found by its size and by the poses beside it.

use crate::android::phone_from_camera;
use crate::imu::{Columns, first_samples, rate_hz};
use crate::text::{data_lines, fields, numbers, read_text, stamp_seconds};
use cairn_geometry::So3;
use cairn_sensor::{ImuSample, ImuSensor, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// Gravity, m/s^2.
const GRAVITY: f64 = 9.80665;
/// How far the size of the accelerometer may be from gravity, as a part of it, at the median of a recording.
const OFF: f64 = 0.2;
/// Samples that are looked at: a minute of them.
const MOST: usize = 6000;

/// A frame of the recording.
pub struct Row {
    /// Its number in the names of images.
    pub number: usize,
    /// When it was taken.
    pub stamp: Stamp,
    /// World from camera, if it is stated.
    rotation: Option<So3>,
}

/// The frames in the order of the table.
///
/// # Errors
/// When it cannot be read.
pub fn rows(folder: &Path) -> Result<Vec<Row>, SourceError> {
    let text = read_text(&folder.join("odometry.csv"))?;
    let row = |(_, line): (usize, &str)| {
        let mut words = fields(line);
        let stamp = stamp_seconds(words.next()?)?;
        let number = words.next()?.parse().ok()?;
        let rotation = numbers::<7>(words).and_then(|p| So3::from_xyzw(p[3], p[4], p[5], p[6]));
        Some(Row { number, stamp, rotation })
    };
    Ok(data_lines(&text).filter_map(row).collect())
}

/// What is made of `imu.csv`.
pub enum Motion {
    /// There is none.
    Missing,
    /// Why it is left out, for people.
    LeftOut(String),
    /// Its file, columns and sensor.
    Used(PathBuf, Columns, ImuSensor),
}

/// The IMU beside the frames.
pub fn motion(folder: &Path, rows: &[Row]) -> Motion {
    let path = folder.join("imu.csv");
    if !path.is_file() {
        return Motion::Missing;
    }
    let columns = Columns { accel_first: true, ..Columns::default() };
    let samples = first_samples(&path, columns, MOST);
    let (Some(rate_hz), Some(norm)) = (rate_hz(&samples), median_norm(&samples)) else {
        return Motion::LeftOut("imu.csv has no samples".into());
    };
    let near = |unit: f64| (norm / unit - 1.0).abs() < OFF;
    let unit = match (near(GRAVITY), near(1.0)) {
        (true, _) => 1.0,
        (_, true) => GRAVITY,
        _ => {
            return Motion::LeftOut(format!(
                "the acceleration in imu.csv has {norm:.2} at its median, neither 9.8 m/s^2 nor 1 g: gravity is not in it"
            ));
        }
    };
    match upward(rows, &samples) {
        Some(up) => {
            let accel_unit = unit * up.signum();
            Motion::Used(
                path,
                Columns { accel_unit, ..columns },
                ImuSensor { rate_hz, ..ImuSensor::of_phone() },
            )
        }
        None => Motion::LeftOut("no pose of odometry.csv says which way is up for imu.csv".into()),
    }
}

fn median_norm(samples: &[ImuSample]) -> Option<f64> {
    let mut norms: Vec<f64> = samples.iter().map(|s| s.accel.norm()).collect();
    norms.sort_by(f64::total_cmp);
    norms.get(norms.len() / 2).copied()
}

/// The mean of the accelerometer along the world's up; `None` where no frame with a pose lies near a sample, or it is not clearly
/// up or down.
fn upward(rows: &[Row], samples: &[ImuSample]) -> Option<f64> {
    let camera_from_phone = phone_from_camera().inverse();
    let up = |sample: &ImuSample| {
        let at = rows.partition_point(|row| row.stamp < sample.stamp).min(rows.len().checked_sub(1)?);
        let row = rows.get(at).filter(|row| (row.stamp - sample.stamp).abs() < 0.1)?;
        Some((row.rotation? * (camera_from_phone * sample.accel)).y / sample.accel.norm())
    };
    let all: Vec<f64> = samples.iter().filter_map(up).filter(|v| v.is_finite()).collect();
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    (mean.abs() > 0.5).then_some(mean)
}
