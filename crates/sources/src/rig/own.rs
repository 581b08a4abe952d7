//! Cairn's own rig files, in TOML; the crate's README has an example.

use super::document::{CalibrationError, lens};
use crate::text::{place, read_text};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    cameras: Vec<CameraFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<DepthFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    imu: Option<ImuFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    resolution: [usize; 2],
    focal: [f64; 2],
    centre: [f64; 2],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distortion: Option<LensFile>,
    #[serde(default)]
    body_from_camera: PoseFile,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensFile {
    model: String,
    coefficients: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseFile {
    #[serde(default)]
    translation_m: [f64; 3],
    #[serde(default = "no_rotation")]
    rotation_xyzw: [f64; 4],
}

impl Default for PoseFile {
    fn default() -> Self {
        Self { translation_m: [0.0; 3], rotation_xyzw: no_rotation() }
    }
}

fn no_rotation() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthFile {
    metres_per_unit: f64,
    registered: bool,
    resolution: [usize; 2],
    focal: [f64; 2],
    centre: [f64; 2],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    distortion: Option<LensFile>,
    #[serde(default)]
    body_from_depth: PoseFile,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ImuFile {
    rate_hz: f64,
    /// rad/s/sqrt(Hz)
    gyro_noise: f64,
    /// rad/s^2/sqrt(Hz)
    gyro_walk: f64,
    /// m/s^2/sqrt(Hz)
    accel_noise: f64,
    /// m/s^3/sqrt(Hz)
    accel_walk: f64,
    /// Seconds: t_imu + offset_s = t_image.
    #[serde(default)]
    offset_s: f64,
    #[serde(default)]
    body_from_imu: PoseFile,
}

/// Reads a file.
pub fn read(path: &Path) -> Result<Rig, SourceError> {
    let text = read_text(path)?;
    let file: RigFile = toml::from_str(&text).map_err(|e| {
        let line = e.span().map_or(0, |s| 1 + text[..s.start.min(text.len())].matches('\n').count());
        SourceError::new(place(path, line), e.message().to_owned(), "correct that line")
    })?;
    build(file).map_err(|e| SourceError::new(path.display().to_string(), e.0, "correct the rig file"))
}

/// The text of such a file.
pub fn write(rig: &Rig) -> Result<String, SourceError> {
    let file = RigFile {
        cameras: rig.cameras.iter().map(camera_file).collect(),
        depth: rig.depth.as_ref().map(|d| DepthFile {
            metres_per_unit: d.metres_per_unit,
            registered: d.registered,
            resolution: [d.camera.width, d.camera.height],
            focal: [d.camera.fx, d.camera.fy],
            centre: [d.camera.cx, d.camera.cy],
            distortion: lens_file(&d.camera.distortion),
            body_from_depth: pose_file(&d.body_from_depth),
        }),
        imu: rig.imu.as_ref().map(|i| ImuFile {
            rate_hz: i.rate_hz,
            gyro_noise: i.noise.gyro,
            gyro_walk: i.noise.gyro_walk,
            accel_noise: i.noise.accel,
            accel_walk: i.noise.accel_walk,
            offset_s: i.offset_s,
            body_from_imu: pose_file(&i.body_from_imu),
        }),
    };
    let text = toml::to_string(&file).map_err(|e| SourceError::new("the rig", e.to_string(), "report it"))?;
    Ok(text.replace("\noffset_s", "\n# Seconds: t_imu + offset_s = t_image.\noffset_s"))
}

fn build(file: RigFile) -> Result<Rig, CalibrationError> {
    let mut cameras = Vec::new();
    for (i, c) in file.cameras.into_iter().enumerate() {
        let name = c.name.unwrap_or_else(|| format!("cam{i}"));
        let camera = camera(c.resolution, c.focal, c.centre, c.distortion).map_err(|e| e.of(&name))?;
        let body_from_camera = pose(&c.body_from_camera).map_err(|e| e.of(&name))?;
        cameras.push(RigCamera { name, camera, body_from_camera });
    }
    let depth = match file.depth {
        Some(d) => Some(DepthSensor {
            camera: camera(d.resolution, d.focal, d.centre, d.distortion).map_err(|e| e.of("depth"))?,
            body_from_depth: pose(&d.body_from_depth).map_err(|e| e.of("depth"))?,
            metres_per_unit: d.metres_per_unit,
            registered: d.registered,
        }),
        None => None,
    };
    let imu = match file.imu {
        Some(i) => Some(ImuSensor {
            body_from_imu: pose(&i.body_from_imu).map_err(|e| e.of("imu"))?,
            rate_hz: i.rate_hz,
            noise: ImuNoise {
                gyro: i.gyro_noise,
                gyro_walk: i.gyro_walk,
                accel: i.accel_noise,
                accel_walk: i.accel_walk,
            },
            offset_s: i.offset_s,
        }),
        None => None,
    };
    Ok(Rig { cameras, depth, imu })
}

fn camera(
    size: [usize; 2],
    f: [f64; 2],
    c: [f64; 2],
    distortion: Option<LensFile>,
) -> Result<Camera, CalibrationError> {
    let distortion = match distortion {
        Some(l) => lens(&l.model, &l.coefficients)?,
        None => Distortion::None,
    };
    // A negative focal length is told by `assumed_in`.
    Ok(Camera { distortion, ..Camera::pinhole(size[0], size[1], f[0], f[1].abs(), c[0], c[1]) })
}

fn pose(file: &PoseFile) -> Result<Se3, CalibrationError> {
    let ([x, y, z, w], [tx, ty, tz]) = (file.rotation_xyzw, file.translation_m);
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    if norm.is_nan() || (norm - 1.0).abs() > 1e-2 {
        return Err(CalibrationError(format!("rotation_xyzw has the norm {norm}, a unit quaternion has 1")));
    }
    let rotation = So3::from_xyzw(x, y, z, w);
    let rotation = rotation.ok_or_else(|| CalibrationError("rotation_xyzw is not a rotation".into()))?;
    Ok(Se3::new(rotation, Vec3::new(tx, ty, tz)))
}

fn camera_file(c: &RigCamera) -> CameraFile {
    CameraFile {
        name: Some(c.name.clone()),
        resolution: [c.camera.width, c.camera.height],
        focal: [c.camera.fx, c.camera.fy],
        centre: [c.camera.cx, c.camera.cy],
        distortion: lens_file(&c.camera.distortion),
        body_from_camera: pose_file(&c.body_from_camera),
    }
}

fn lens_file(distortion: &Distortion) -> Option<LensFile> {
    (*distortion != Distortion::None)
        .then(|| LensFile { model: distortion.name().into(), coefficients: distortion.coefficients() })
}

fn pose_file(pose: &Se3) -> PoseFile {
    let q = pose.rotation.quaternion();
    PoseFile {
        translation_m: [pose.translation.x, pose.translation.y, pose.translation.z],
        rotation_xyzw: [q.i, q.j, q.k, q.w],
    }
}
