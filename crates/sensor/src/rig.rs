//! The rig: which cameras, depth sensor and IMU there are, and where.

use crate::Camera;
use cairn_geometry::{Mat3, Se3};

/// What is wrong with a rig, with the number that shows it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct RigError(pub String);

/// One camera of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigCamera {
    /// Its name in the source ("cam0").
    pub name: String,
    /// How it projects.
    pub camera: Camera,
    /// Where it sits: maps camera coordinates to body coordinates.
    pub body_from_camera: Se3,
}

/// A depth sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthSensor {
    /// Its own projection; equal to the first camera's where depth is registered to it.
    pub camera: Camera,
    /// Where it sits.
    pub body_from_depth: Se3,
    /// Metres per unit of the depth image.
    pub metres_per_unit: f64,
    /// True when each depth pixel belongs to the same pixel of the first camera.
    pub registered: bool,
}

/// Continuous-time noise densities of an IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuNoise {
    /// Gyroscope white noise in rad/s/sqrt(Hz).
    pub gyro: f64,
    /// Gyroscope bias random walk in rad/s^2/sqrt(Hz).
    pub gyro_walk: f64,
    /// Accelerometer white noise in m/s^2/sqrt(Hz).
    pub accel: f64,
    /// Accelerometer bias random walk in m/s^3/sqrt(Hz).
    pub accel_walk: f64,
}

/// An inertial sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuSensor {
    /// Where it sits; identity where the body frame is the IMU's.
    pub body_from_imu: Se3,
    /// Nominal samples a second.
    pub rate_hz: f64,
    /// Its noise.
    pub noise: ImuNoise,
    /// Seconds to add to an IMU stamp to get the image clock: `t_imu + offset = t_image`. Kalibr's `timeshift_cam_imu` is
    /// its negative. Whoever merges the streams applies it ([`crate::Merge`]) and hands on a rig in which it is 0.
    pub offset_s: f64,
}

/// Everything that sees and feels.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Cameras in order; the first is the reference. One for mono and RGB-D, two for stereo.
    pub cameras: Vec<RigCamera>,
    /// The depth sensor, if any.
    pub depth: Option<DepthSensor>,
    /// The inertial sensor, if any.
    pub imu: Option<ImuSensor>,
}

impl Rig {
    /// One camera at the body's origin.
    pub fn mono(camera: Camera) -> Self {
        let cam0 = RigCamera { name: "cam0".into(), camera, body_from_camera: Se3::identity() };
        Self { cameras: vec![cam0], depth: None, imu: None }
    }

    /// Refuses what can not be: no camera, numbers that are not finite, focal lengths that are not
    /// positive, a principal point far outside, extrinsics that are not rigid, two cameras in one place,
    /// a depth unit or a noise that is not positive.
    pub fn validate(&self) -> Result<(), RigError> {
        if self.cameras.is_empty() {
            return Err(RigError("the rig has no camera".into()));
        }
        for c in &self.cameras {
            c.camera.validate().map_err(|e| RigError(format!("{}: {e}", c.name)))?;
            check_rigid(&c.name, &c.body_from_camera)?;
        }
        for (i, a) in self.cameras.iter().enumerate() {
            for b in &self.cameras[i + 1..] {
                let baseline = (a.body_from_camera.translation - b.body_from_camera.translation).norm();
                if baseline < 1e-4 {
                    return Err(RigError(format!(
                        "{} and {} are {baseline:.6} m apart: no baseline",
                        a.name, b.name
                    )));
                }
            }
        }
        if let Some(d) = &self.depth {
            d.camera.validate().map_err(|e| RigError(format!("depth: {e}")))?;
            check_rigid("depth", &d.body_from_depth)?;
            if !(d.metres_per_unit.is_finite() && d.metres_per_unit > 0.0) {
                return Err(RigError(format!(
                    "depth: {} metres per unit is not a positive number",
                    d.metres_per_unit
                )));
            }
        }
        if let Some(imu) = &self.imu {
            check_rigid("imu", &imu.body_from_imu)?;
            for (name, v) in [
                ("rate", imu.rate_hz),
                ("gyro noise", imu.noise.gyro),
                ("gyro walk", imu.noise.gyro_walk),
                ("accel noise", imu.noise.accel),
                ("accel walk", imu.noise.accel_walk),
            ] {
                if !(v.is_finite() && v > 0.0) {
                    return Err(RigError(format!("imu: {name} {v} is not a positive number")));
                }
            }
        }
        Ok(())
    }
}

fn check_rigid(name: &str, t: &Se3) -> Result<(), RigError> {
    if !t.is_finite() {
        return Err(RigError(format!("{name}: the extrinsics hold a number that is not finite")));
    }
    if t.translation.norm() > 10.0 {
        return Err(RigError(format!(
            "{name}: {:.1} m from the body, is the unit metres?",
            t.translation.norm()
        )));
    }
    Ok(())
}

/// Refuses a 3x3 block that is not a rotation, telling how far off it is; readers call it before [`Se3::from_matrix`].
pub fn check_rotation(name: &str, r: &Mat3) -> Result<(), RigError> {
    let off = (r.transpose() * r - Mat3::identity()).norm();
    if !(off < 1e-2 && r.determinant() > 0.0) {
        return Err(RigError(format!(
            "{name}: not a rotation (|R'R - I| = {off:.3}, det = {:.3})",
            r.determinant()
        )));
    }
    Ok(())
}
