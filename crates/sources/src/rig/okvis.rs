//! Configurations of OKVIS and OKVIS2, and of SVO: a list `cameras`, and the noise of the IMU.
//!
//! OKVIS2 states no rate of the IMU: 200 samples a second are taken, which is told ([`super::assumed_in`]).

use super::document::{Document, SCARAMUZZA};
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};

/// True when a file has a list of cameras.
pub fn is(root: &Node) -> bool {
    root.get("cameras").and_then(Node::list).is_some()
}

/// The rate that is taken where none is stated: that of EuRoC's recordings, with which its configurations come.
pub const RATE_HZ: f64 = 200.0;

/// True when it has an IMU and states no rate of it.
pub fn lacks_rate(root: &Node) -> bool {
    imu_node(root).is_some_and(|imu| imu.get("imu_rate").is_none())
}

/// The first two cameras and the IMU.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let list = doc.need(&doc.root, "cameras")?;
    let cameras = list.list().unwrap_or_default().iter().take(2).enumerate();
    let cameras = cameras.map(|(i, node)| match node.get("camera") {
        Some(inner) => svo_camera(doc, i, node, inner),
        None => okvis_camera(doc, i, node),
    });
    Ok(Rig { cameras: cameras.collect::<Result<_, _>>()?, depth: None, imu: imu(doc)? })
}

/// `T_SC` (S is the frame of the IMU, which `T_BS` places in the body), size, focal lengths and centre in lists of two.
fn okvis_camera(doc: &Document, i: usize, node: &Node) -> Result<RigCamera, SourceError> {
    let two = |key: &str| doc.array::<2>(doc.need(node, key)?, key);
    let ([w, h], [fx, fy], [cx, cy]) =
        (two("image_dimension")?, two("focal_length")?, two("principal_point")?);
    let c = doc.numbers(doc.need(node, "distortion_coefficients")?)?;
    let kind = doc.need(node, "distortion_type")?;
    let distortion = match node.get("cam_model").and_then(Node::text) {
        // OKVIS2-X's.
        Some("eucm") => {
            doc.distortion(kind.line, "extended-unified", &doc.numbers(doc.need(node, "eucm_parameters")?)?)?
        }
        None | Some("pinhole") => doc.distortion(kind.line, kind.text().unwrap_or_default(), &c)?,
        Some(other) => {
            let why = format!("cam_model \"{other}\" is not known (pinhole and eucm are)");
            return Err(doc.error(node.line, why));
        }
    };
    let camera = doc.camera(node.line, doc.size(node.line, [w, h])?, [fx, fy, cx, cy], distortion)?;
    let body_from_camera = body_from_imu(doc)? * doc.transform(doc.need(node, "T_SC")?, "T_SC")?;
    Ok(RigCamera { name: format!("cam{i}"), camera, body_from_camera })
}

/// `T_B_C`, or `T_C_B`, beside the camera, with matrices for intrinsics and distortion.
pub fn svo_camera(doc: &Document, i: usize, node: &Node, camera: &Node) -> Result<RigCamera, SourceError> {
    let kind = doc.need(camera, "type")?;
    if kind.text() != Some("pinhole") {
        let name = kind.text().unwrap_or_default();
        let why = if name == "omni" { SCARAMUZZA } else { "only pinhole is known" };
        return Err(doc.error(kind.line, format!("camera type \"{name}\": {why}")));
    }
    let size = [doc.need_number(camera, "image_width")?, doc.need_number(camera, "image_height")?];
    let size = doc.size(camera.line, size)?;
    let intrinsics = doc.need(camera, "intrinsics")?;
    let &[fx, fy, cx, cy] = doc.matrix(intrinsics, "intrinsics")?.as_slice() else {
        return Err(doc.error(intrinsics.line, "intrinsics need 4 numbers"));
    };
    let distortion = match camera.get("distortion") {
        Some(lens) => {
            let kind = doc.need(lens, "type")?;
            let c = doc.matrix(doc.need(lens, "parameters")?, "parameters")?;
            match kind.text().unwrap_or_default() {
                "none" => Distortion::None,
                // vikit's name for the field-of-view model.
                "fisheye" => doc.distortion(kind.line, "fov", &c)?,
                name => doc.distortion(kind.line, name, &c)?,
            }
        }
        None => Distortion::None,
    };
    let camera = doc.camera(intrinsics.line, size, [fx, fy, cx, cy], distortion)?;
    let body_from_camera = match (node.get("T_B_C"), node.get("T_C_B")) {
        (Some(t), _) => doc.transform(t, "T_B_C")?,
        (None, Some(t)) => doc.transform(t, "T_C_B")?.inverse(),
        (None, None) => Se3::identity(),
    };
    Ok(RigCamera { name: format!("cam{i}"), camera, body_from_camera })
}

fn imu_node(root: &Node) -> Option<&Node> {
    root.get("imu_parameters").or_else(|| root.get("imu_params"))
}

fn body_from_imu(doc: &Document) -> Result<Se3, SourceError> {
    let t = imu_node(&doc.root).and_then(|imu| imu.get("T_BS"));
    t.map_or(Ok(Se3::identity()), |t| doc.transform(t, "T_BS"))
}

/// The IMU by the names of each: OKVIS2 `imu_parameters` with `sigma_g_c`, OKVIS `imu_params`, SVO `imu_params` with
/// `sigma_omega_c`.
fn imu(doc: &Document) -> Result<Option<ImuSensor>, SourceError> {
    let root = &doc.root;
    let Some(node) = imu_node(root) else { return Ok(None) };
    let keys = match node.get("sigma_omega_c").is_some() {
        true => ["sigma_omega_c", "sigma_omega_bias_c", "sigma_acc_c", "sigma_acc_bias_c"],
        false => ["sigma_g_c", "sigma_gw_c", "sigma_a_c", "sigma_aw_c"],
    };
    let [gyro, gyro_walk, accel, accel_walk] = keys.map(|key| doc.need_number(node, key));
    let number = |node: Option<&Node>, or: f64| node.map_or(Ok(or), |n| doc.number(n));
    // t_image - delay is the time of the IMU: of OKVIS2, of OKVIS, of SVO.
    let of_cameras =
        ["camera_parameters", "camera_params"].iter().find_map(|key| root.get(key)?.get("image_delay"));
    let delay = of_cameras.or_else(|| root.get("imageDelay")).or_else(|| node.get("delay_imu_cam"));
    let offset_s = number(delay, 0.0)?;
    Ok(Some(ImuSensor {
        body_from_imu: body_from_imu(doc)?,
        rate_hz: number(node.get("imu_rate"), RATE_HZ)?,
        noise: ImuNoise { gyro: gyro?, gyro_walk: gyro_walk?, accel: accel?, accel_walk: accel_walk? },
        offset_s,
    }))
}
