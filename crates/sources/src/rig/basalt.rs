//! Calibrations of Basalt: JSON with everything under `value0`.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("value0").is_some_and(|v| v.get("intrinsics").is_some() && v.get("T_imu_cam").is_some())
}

/// The first two cameras and the IMU, which is the body.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let root = doc.need(&doc.root, "value0")?;
    let list = |key: &str| doc.need(root, key).map(|n| (n.line, n.list().unwrap_or_default()));
    let ((line, intrinsics), (_, poses), (_, sizes)) =
        (list("intrinsics")?, list("T_imu_cam")?, list("resolution")?);
    if poses.len() < intrinsics.len() || sizes.len() < intrinsics.len() {
        return Err(doc.error(line, "each camera needs an entry in T_imu_cam and resolution"));
    }
    let cameras = intrinsics.iter().zip(poses).zip(sizes).take(2).enumerate();
    let cameras = cameras.map(|(i, ((node, pose), size))| {
        let [w, h] = doc.array::<2>(size, "resolution")?;
        Ok(RigCamera {
            name: format!("cam{i}"),
            camera: camera(doc, node, doc.size(size.line, [w, h])?)?,
            body_from_camera: placed(doc, pose)?,
        })
    });
    Ok(Rig { cameras: cameras.collect::<Result<_, SourceError>>()?, depth: None, imu: imu(doc, root)? })
}

fn placed(doc: &Document, node: &Node) -> Result<Se3, SourceError> {
    let [x, y, z, w] = ["qx", "qy", "qz", "qw"].map(|key| doc.need_number(node, key));
    let [px, py, pz] = ["px", "py", "pz"].map(|key| doc.need_number(node, key));
    let rotation = So3::from_xyzw(x?, y?, z?, w?);
    let rotation =
        rotation.ok_or_else(|| doc.error(node.line, "the quaternion of T_imu_cam is no rotation"))?;
    Ok(Se3::new(rotation, Vec3::new(px?, py?, pz?)))
}

fn camera(doc: &Document, node: &Node, size: [usize; 2]) -> Result<Camera, SourceError> {
    let (kind, values) = (doc.need(node, "camera_type")?, doc.need(node, "intrinsics")?);
    let number = |key: &str| doc.need_number(values, key);
    let all = |keys: &[&str]| keys.iter().map(|key| number(key)).collect::<Result<Vec<f64>, SourceError>>();
    let distortion = match kind.text().unwrap_or_default() {
        "pinhole" => Distortion::None,
        name @ "kb4" => doc.distortion(kind.line, name, &all(&["k1", "k2", "k3", "k4"])?)?,
        name @ "pinhole-radtan8" => {
            doc.distortion(kind.line, name, &all(&["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"])?)?
        }
        "ds" => Distortion::DoubleSphere { xi: number("xi")?, alpha: number("alpha")? },
        "eucm" => Distortion::ExtendedUnified { alpha: number("alpha")?, beta: number("beta")? },
        "ucm" => Distortion::ExtendedUnified { alpha: number("alpha")?, beta: 1.0 },
        "fov" => Distortion::Fov(number("w")?),
        other => {
            let why = format!(
                "camera_type \"{other}\" is not known (pinhole, pinhole-radtan8, kb4, ds, eucm, ucm and fov are)"
            );
            return Err(doc.error(kind.line, why));
        }
    };
    let numbers = [number("fx")?, number("fy")?, number("cx")?, number("cy")?];
    doc.camera(values.line, size, numbers, distortion)
}

/// How far scale and axes of its IMU are from ideal ones at most: `calib_accel_bias` and `calib_gyro_bias` have them after three
/// numbers of bias.
pub fn off_ideal(doc: &Document) -> f64 {
    let of = |key: &str| {
        let list = doc.root.get("value0").and_then(|n| n.get(key)).and_then(|n| doc.numbers(n).ok());
        list.unwrap_or_default().iter().skip(3).fold(0.0, |most: f64, v| most.max(v.abs()))
    };
    of("calib_accel_bias").max(of("calib_gyro_bias"))
}

/// The IMU: densities for each axis, of which the largest is taken.
fn imu(doc: &Document, root: &Node) -> Result<Option<ImuSensor>, SourceError> {
    let Some(rate) = root.get("imu_update_rate") else { return Ok(None) };
    let largest = |key: &str| -> Result<f64, SourceError> {
        let node = doc.need(root, key)?;
        match node.list() {
            Some(_) => Ok(doc.numbers(node)?.into_iter().fold(0.0, f64::max)),
            None => doc.number(node),
        }
    };
    Ok(Some(ImuSensor {
        body_from_imu: Se3::identity(),
        rate_hz: doc.number(rate)?,
        noise: ImuNoise {
            gyro: largest("gyro_noise_std")?,
            gyro_walk: largest("gyro_bias_std")?,
            accel: largest("accel_noise_std")?,
            accel_walk: largest("accel_bias_std")?,
        },
        // Basalt: t_image + offset is the time of the IMU's clock.
        offset_s: -1e-9 * root.get("cam_time_offset_ns").map_or(Ok(0.0), |n| doc.number(n))?,
    }))
}
