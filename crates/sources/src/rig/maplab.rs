//! Sensors of maplab and ROVIOLI: a list `sensors` with an `NCAMERA` and an `IMU`, and `extrinsics` between them.
//!
//! It states no rate of the IMU: 200 samples a second are taken, which is told ([`super::assumed_in`]).

use super::document::Document;
use super::okvis;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{ImuNoise, ImuSensor, Rig, SourceError};

/// The sensor of a type.
fn sensor<'a>(root: &'a Node, kind: &str) -> Option<&'a Node> {
    let is = |node: &&Node| node.get("sensor_type").and_then(Node::text) == Some(kind);
    root.get("sensors")?.list()?.iter().find(is)
}

/// True when a file has an NCAMERA among its sensors.
pub fn is(root: &Node) -> bool {
    sensor(root, "NCAMERA").is_some()
}

/// True when it has an IMU, whose rate it never states.
pub fn has_imu(root: &Node) -> bool {
    is(root) && sensor(root, "IMU").is_some_and(|imu| imu.get("sigmas").is_some())
}

/// The first two cameras and the IMU, in the frame of the sensor that is their base.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let ncamera = sensor(&doc.root, "NCAMERA").ok_or_else(|| doc.error(0, "has no NCAMERA"))?;
    let base_from_ncamera = base_from(doc, ncamera)?;
    let list = doc.need(ncamera, "cameras")?;
    let mut cameras = Vec::new();
    for (i, node) in list.list().unwrap_or_default().iter().take(2).enumerate() {
        let mut camera = okvis::svo_camera(doc, i, node, doc.need(node, "camera")?)?;
        camera.body_from_camera = base_from_ncamera * camera.body_from_camera;
        cameras.push(camera);
    }
    let imu = match sensor(&doc.root, "IMU").filter(|_| has_imu(&doc.root)) {
        Some(node) => Some(imu(doc, node)?),
        None => None,
    };
    Ok(Rig { cameras, depth: None, imu })
}

fn imu(doc: &Document, node: &Node) -> Result<ImuSensor, SourceError> {
    let sigmas = doc.need(node, "sigmas")?;
    let need = |key: &str| doc.need_number(sigmas, key);
    let noise = ImuNoise {
        gyro: need("gyro_noise_density")?,
        gyro_walk: need("gyro_bias_random_walk_noise_density")?,
        accel: need("acc_noise_density")?,
        accel_walk: need("acc_bias_random_walk_noise_density")?,
    };
    Ok(ImuSensor { body_from_imu: base_from(doc, node)?, rate_hz: okvis::RATE_HZ, noise, offset_s: 0.0 })
}

/// Where a sensor is: `T_B_S` of its extrinsics; the base itself has none or the identity.
fn base_from(doc: &Document, sensor: &Node) -> Result<Se3, SourceError> {
    let id = sensor.get("id").and_then(Node::text);
    let list = doc.root.get("extrinsics").and_then(Node::list).unwrap_or_default();
    let own = list.iter().find(|e| e.get("sensor_id").and_then(Node::text) == id && id.is_some());
    own.and_then(|e| e.get("T_B_S")).map_or(Ok(Se3::identity()), |t| doc.transform(t, "T_B_S"))
}
