//! A camera of your own: the calibration is written down here, images and IMU samples are fed by hand.
//!
//! No camera is attached to the machine that builds this, so a simulated world stands in for one: [`Device`] is the
//! part to replace by the driver of a real camera. Everything else stays as it is.
//!
//! `cargo run --release -p cairn --example own_camera`

use cairn::geometry::{Se3, So3, Vec3};
use cairn::sensor::{Camera, ImuNoise, ImuSensor, RigCamera};
use cairn::{Config, GrayImage, ImuSample, Rig, SensorMode, Slam, Source, Stamp};
use std::error::Error;

/// The calibration, as a calibration tool gives it: two cameras 12 cm apart and an IMU. The body frame is that of the
/// IMU, which here coincides with the left camera (x right, y down, z forward).
fn rig() -> Rig {
    let camera = Camera::pinhole(400, 300, 260.0, 260.0, 199.5, 149.5);
    let at = |x: f64| Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0));
    let left = RigCamera { name: "left".into(), camera, body_from_camera: at(0.0) };
    let right = RigCamera { name: "right".into(), camera, body_from_camera: at(0.12) };
    // Noise densities from the data sheet or an Allan deviation.
    let noise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };
    let imu = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 };
    Rig { cameras: vec![left, right], depth: None, imu: Some(imu) }
}

/// Stands in for the driver of a camera: a walk through a simulated world.
struct Device(Box<dyn Source>);

/// What a driver delivers: the time of exposure, the pixels of both images row by row, and the IMU samples since the
/// frame before.
type Grabbed = (Stamp, Vec<u8>, Vec<u8>, Vec<ImuSample>);

impl Device {
    fn open() -> Result<Self, cairn::Error> {
        let world =
            "sim:demo?seed=2&sensor=stereo-imu&resolution=400x300&focal=260&rate=15&duration=8&detail=0.5";
        cairn::open(world).map(Self)
    }

    fn grab(&mut self) -> Result<Option<Grabbed>, cairn::Error> {
        let Some(frame) = self.0.next_packet()? else { return Ok(None) };
        let [left, right] = &frame.images[..] else { return Ok(None) };
        Ok(Some((frame.stamp, left.data().to_vec(), right.data().to_vec(), frame.imu)))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let rig = rig();
    rig.doubts().iter().for_each(|doubt| println!("doubtful: {doubt}"));
    // `Slam::builder` has more choices; a live camera wants `.threaded()`.
    let mut slam = Slam::new(&rig, SensorMode::Stereo, &Config::default())?;

    let mut device = Device::open()?;
    let mut tracked = 0;
    while let Some((stamp, left, right, imu)) = device.grab()? {
        let image = |pixels| GrayImage::from_vec(400, 300, pixels).ok_or("the image has another size");
        let output = slam.track_images(stamp, vec![image(left)?, image(right)?], None, imu)?;
        if let Some(pose) = output.world_from_body() {
            tracked += 1;
            if tracked % 15 != 1 {
                continue;
            }
            let [x, y, z]: [f64; 3] = pose.se3.translation.into();
            let (have, of) = (output.evidence.inliers, output.evidence.matched);
            println!("{stamp}  at {x:6.2} {y:6.2} {z:6.2} m, {have} of {of} matches agree");
        }
    }
    println!("{tracked} frames tracked; {}", slam.status().words());
    Ok(())
}
