//! Configurations of LARVIO: one camera with `resolution_width`, `T_cam_imu` as in Kalibr, and densities of noise.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{ImuNoise, ImuSensor, Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("resolution_width").is_some() && root.get("distortion_model").is_some()
}

/// The camera and the IMU, which is the body.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let root = &doc.root;
    let need = |key: &str| doc.need_number(root, key);
    let of = |key: &str, names: [&str; 4]| -> Result<[f64; 4], SourceError> {
        let node = doc.need(root, key)?;
        let [a, b, c, d] = names.map(|name| doc.need_number(node, name));
        Ok([a?, b?, c?, d?])
    };
    let size = doc.size(0, [need("resolution_width")?, need("resolution_height")?])?;
    let kind = doc.need(root, "distortion_model")?;
    // Of an equidistant lens p1 and p2 are the third and fourth coefficient.
    let c = of("distortion_coeffs", ["k1", "k2", "p1", "p2"])?;
    let distortion = doc.distortion(kind.line, kind.text().unwrap_or_default(), &c)?;
    let pinhole = of("intrinsics", ["fx", "fy", "cx", "cy"])?;
    let camera = doc.camera(kind.line, size, pinhole, distortion)?;
    let body_from_camera = doc.transform(doc.need(root, "T_cam_imu")?, "T_cam_imu")?.inverse();
    let noise = ImuNoise {
        gyro: need("noise_gyro")?,
        gyro_walk: need("noise_gyro_bias")?,
        accel: need("noise_acc")?,
        accel_walk: need("noise_acc_bias")?,
    };
    // LARVIO: t_image + td = t_imu.
    let offset_s = -root.get("td").map_or(Ok(0.0), |n| doc.number(n))?;
    let rate_hz = need("imu_rate")?;
    let imu = ImuSensor { body_from_imu: Se3::identity(), rate_hz, noise, offset_s };
    Ok(Rig {
        cameras: vec![RigCamera { name: "cam0".into(), camera, body_from_camera }],
        depth: None,
        imu: Some(imu),
    })
}
