//! Folders of an Android phone's camera and sensors: `frames.csv` (time stamp [ns], file in `images/`), `gyroscope.csv` and
//! `accelerometer.csv` (time stamp [ns], xyz), as Camera2 and `SensorManager` give them.
//!
//! Each sensor has stamps of its own, all in one clock (`elapsedRealtime`). Readings are in the axes of the phone held upright: x to
//! the right, y up, z out of the screen. Images are as the sensor of the rear camera delivers them, which is mounted turned by 90
//! degrees (`SENSOR_ORIENTATION`): to the right in them is down along the phone, and down is to its left.

use crate::csv::CsvStream;
use crate::recording::{ImuAt, Instant, Recording, read_index};
use crate::text::stamp_ns;
use crate::{decode, rig};
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::{Camera, ImuSensor, Rig, SourceError, Stamp};
use std::path::Path;

const FRAMES: &str = "frames.csv";
const GYRO: &str = "gyroscope.csv";
const ACCEL: &str = "accelerometer.csv";
/// The focal length as a share of the longer side: main cameras see 60 to 74 degrees across it in video, the middle is 67.
const FOCAL: f64 = 0.755;
/// Readings of the gyroscope from which its rate is taken.
const FIRST: usize = 500;

/// True when a folder looks like such a recording.
pub fn is(folder: &Path) -> bool {
    [FRAMES, GYRO, ACCEL].iter().all(|name| folder.join(name).is_file())
}

/// Indexes the folder. Its rig is the one given, a Cairn or Kalibr file in it, or a guess by the size of the images.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let mut skipped = Vec::new();
    let images = folder.join("images");
    let images = if images.is_dir() { images } else { folder.to_owned() };
    let frames = read_index(&folder.join(FRAMES), stamp_ns, &images, &mut skipped)?;
    let [gyro, accel] = [GYRO, ACCEL].map(|name| folder.join(name));
    let (mut rig, assumed) = match (given, rig::file_in(folder)) {
        (Some(rig), _) => (rig, None),
        (None, Some(path)) => (rig::read_rig(path)?, None),
        (None, None) => {
            let rig = guessed_rig(&images, rate_hz(&gyro)?)?;
            let focal = rig.cameras[0].camera.fx;
            let what = format!("a focal length of {focal:.0} px ({FOCAL} of the longer side), no distortion");
            (rig, Some(what))
        }
    };
    rig.cameras.truncate(1);
    rig.depth = None;
    let instants = frames
        .into_iter()
        .map(|(stamp, image)| Instant { stamp, images: vec![image], depth: None })
        .collect();
    Ok(Recording {
        name: format!("Android phone {}", folder.display()),
        imu: rig.imu.is_some().then_some(ImuAt::Split { gyro, accel }),
        bag: None,
        rig,
        instants,
        truth: Vec::new(),
        no_depth: None,
        skipped,
        assumed,
    })
}

/// One camera of an unknown lens, at the place of the sensors.
fn guessed_rig(images: &Path, rate_hz: f64) -> Result<Rig, SourceError> {
    let shown = images.display().to_string();
    let [width, height] = first_size(images).ok_or_else(|| {
        SourceError::new(
            &shown,
            "not a single image can be read",
            "check the images, or give a rig with --rig",
        )
    })?;
    let f = FOCAL * width.max(height) as f64;
    let mut rig = Rig::mono(Camera { fx: f, fy: f, ..Camera::guessed(width, height) });
    rig.cameras[0].body_from_camera = Se3::new(phone_from_camera(), Vec3::zeros());
    rig.imu = Some(ImuSensor { rate_hz, ..ImuSensor::of_phone() });
    Ok(rig)
}

/// The rotation of the camera in the phone; with the image 90 degrees against the phone held upright.
pub fn phone_from_camera() -> So3 {
    So3::from_matrix(&Mat3::from_columns(&[-Vec3::y(), -Vec3::x(), -Vec3::z()]))
}

fn first_size(images: &Path) -> Option<[usize; 2]> {
    let mut files: Vec<_> =
        std::fs::read_dir(images).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    files.iter().find_map(|path| decode::size(path).ok())
}

/// Readings per second, by the median step of the first ones.
fn rate_hz(gyro: &Path) -> Result<f64, SourceError> {
    let mut stream = CsvStream::<3>::open(gyro, "gyro xyz [rad/s]")?;
    let mut skipped = Vec::new();
    let stamps: Vec<Stamp> = std::iter::from_fn(|| Some(stream.next(&mut skipped)?.0)).take(FIRST).collect();
    let mut steps: Vec<f64> = stamps.windows(2).map(|w| w[1] - w[0]).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    Ok(steps.get(steps.len() / 2).map_or(ImuSensor::of_phone().rate_hz, |step| 1.0 / step))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_phone_has_its_images_turned() {
        let down = phone_from_camera().inverse() * -Vec3::y();
        assert!(
            (down - Vec3::x()).norm() < 1e-12,
            "down along the phone is to the right in the image: {down}"
        );
        let ahead = phone_from_camera().inverse() * -Vec3::z();
        assert!((ahead - Vec3::z()).norm() < 1e-12, "the camera looks out of the back: {ahead}");
    }
}
