//! Kalibr camera chains and IMU files (also EuRoC's `sensor.yaml`, which has the same content under other
//! names).

use super::document::Document;
use super::okvis::RATE_HZ;
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};
use std::path::{Path, PathBuf};

/// The rig of a camera chain; the IMU's noise comes from `imu` or, without it, from the single IMU file next
/// to the chain.
///
/// With `T_cam_imu` (camera from IMU) or `T_imu_cam` the body is the IMU; otherwise it is the first camera,
/// and `T_cn_cnm1` (camera from previous camera) places the others.
pub fn chain(doc: &Document, imu: Option<PathBuf>) -> Result<Rig, SourceError> {
    let mut cameras: Vec<RigCamera> = Vec::new();
    let (mut shift_s, mut has_imu) = (0.0, false);
    for i in 0.. {
        let name = format!("cam{i}");
        let Some(node) = doc.root.get(&name) else { break };
        if node.get("intrinsics").is_none() {
            let why = format!(
                "{name} has no intrinsics: it only places a camera whose lens is in another file (DM-VIO: camera.txt)"
            );
            return Err(doc.error(node.line, why));
        }
        let camera = camera(doc, node)?;
        let body_from_camera = if let Some(t) = node.get("T_cam_imu") {
            has_imu = true;
            doc.transform(t, "T_cam_imu")?.inverse()
        } else if let Some(t) = node.get("T_imu_cam") {
            has_imu = true;
            doc.transform(t, "T_imu_cam")?
        } else if let Some(t) = node.get("T_BS") {
            doc.transform(t, "T_BS")?
        } else if let Some(before) = cameras.last() {
            let t = doc.need(node, "T_cn_cnm1")?;
            before.body_from_camera * doc.transform(t, "T_cn_cnm1")?.inverse()
        } else {
            Se3::identity()
        };
        if let Some(t) = node.get("timeshift_cam_imu").filter(|_| i == 0) {
            shift_s = doc.number(t)?;
        }
        cameras.push(RigCamera { name, camera, body_from_camera });
    }
    if cameras.is_empty() {
        return Err(doc.error(0, "has no cam0"));
    }
    let imu =
        match imu.filter(|_| has_imu).or_else(|| has_imu.then(|| neighbouring_imu_file(&doc.path)).flatten())
        {
            Some(path) => {
                let mut sensor = imu_file(&path)?;
                // Kalibr: t_imu = t_cam + shift.
                sensor.offset_s = -shift_s;
                Some(sensor)
            }
            None => imu_of_xrslam(&doc.root).map(|node| xrslam_imu(doc, node)).transpose()?,
        };
    Ok(Rig { cameras, depth: None, imu })
}

/// The IMU of a file of XRSLAM, which stands beside cameras with `T_BS` and states no rate.
pub fn imu_of_xrslam(root: &Node) -> Option<&Node> {
    root.get("cam0")?.get("T_BS")?;
    root.get("imu").filter(|imu| imu.get("gyroscope_noise_density").is_some())
}

fn xrslam_imu(doc: &Document, node: &Node) -> Result<ImuSensor, SourceError> {
    let mut imu = imu_at(doc, node, RATE_HZ)?;
    if let Some(place) = node.get("extrinsic") {
        let q = doc.need(place, "q_bi")?;
        let [x, y, z, w] = doc.array::<4>(q, "q_bi")?;
        let rotation = So3::from_xyzw(x, y, z, w).ok_or_else(|| doc.error(q.line, "q_bi is no rotation"))?;
        let translation = Vec3::from(doc.array::<3>(doc.need(place, "p_bi")?, "p_bi")?);
        imu.body_from_imu = Se3::new(rotation, translation);
    }
    Ok(imu)
}

/// Tells that a chain is placed on an IMU, but nothing beside it has the IMU's noise, so that it is left out.
pub fn imu_left_out(doc: &Document) -> Option<String> {
    let placed = |camera: &Node| ["T_cam_imu", "T_imu_cam"].iter().any(|key| camera.get(key).is_some());
    let has_imu = doc.root.get("cam0").is_some_and(placed);
    (has_imu && neighbouring_imu_file(&doc.path).is_none()).then(|| {
        "is placed on an IMU, but not one file of an IMU lies beside it (its name with \"imu\", without \"cam\"): \
         the IMU is left out"
            .into()
    })
}

/// The chain that a configuration of OpenVINS names.
pub fn of_openvins(doc: &Document) -> Result<Rig, SourceError> {
    let chain_name = doc.need(&doc.root, "relative_config_imucam")?;
    let path = doc.path.parent().unwrap_or(Path::new("")).join(chain_name.text().unwrap_or_default());
    let mut rig = chain(&Document::parse(&path, &read_text(&path)?)?, imu_path(doc))?;
    if let Some(most) = doc.root.get("max_cameras") {
        rig.cameras.truncate(doc.number(most)?.max(1.0) as usize);
    }
    Ok(rig)
}

/// The IMU file of a chain, or of a configuration of OpenVINS.
pub fn imu_path(doc: &Document) -> Option<PathBuf> {
    match doc.root.get("relative_config_imu").and_then(Node::text) {
        Some(name) => Some(doc.path.parent().unwrap_or(Path::new("")).join(name)),
        None => doc.root.get("cam0").and_then(|_| neighbouring_imu_file(&doc.path)),
    }
}

/// One camera: `camera_model`, `intrinsics`, `distortion_model`, `distortion_coeffs` (EuRoC:
/// `distortion_coefficients`, XRSLAM: `distortion`), `resolution`.
pub fn camera(doc: &Document, node: &Node) -> Result<Camera, SourceError> {
    let [width, height] = doc.array::<2>(doc.need(node, "resolution")?, "resolution")?;
    let model = doc.need(node, "camera_model")?;
    let intrinsics = doc.need(node, "intrinsics")?;
    let lens = |name: &str| -> Result<Distortion, SourceError> {
        let line = node.get("distortion_model").map_or(node.line, |n| n.line);
        let keys = ["distortion_coeffs", "distortion_coefficients", "distortion"];
        let coefficients = keys.iter().find_map(|key| node.get(key));
        let c = coefficients.map_or(Ok(Vec::new()), |c| doc.numbers(c))?;
        doc.distortion(line, name, &c)
    };
    let name = node.get("distortion_model").and_then(Node::text).unwrap_or("none");
    let ([fx, fy, cx, cy], distortion) = match model.text().unwrap_or_default() {
        "pinhole" => (doc.array::<4>(intrinsics, "intrinsics of a pinhole")?, lens(name)?),
        // In some files the lens model is part of the camera model's name.
        joint @ ("pinhole-equi" | "pinhole-radtan" | "pinhole-fov") => {
            (doc.array::<4>(intrinsics, "intrinsics of a pinhole")?, lens(&joint["pinhole-".len()..])?)
        }
        "ds" => {
            let [xi, alpha, fx, fy, cx, cy] = doc.array::<6>(intrinsics, "intrinsics of ds")?;
            lens(name)?; // only "none" is valid with it
            ([fx, fy, cx, cy], Distortion::DoubleSphere { xi, alpha })
        }
        "omni" => {
            let [xi, fx, fy, cx, cy] = doc.array::<5>(intrinsics, "intrinsics of omni")?;
            let c = match lens(name)? {
                Distortion::None => [0.0; 4],
                Distortion::RadialTangential([k1, k2, p1, p2, 0.0]) => [k1, k2, p1, p2],
                other => {
                    let why = format!("camera model omni has no {} distortion", other.name());
                    return Err(doc.error(model.line, why));
                }
            };
            ([fx, fy, cx, cy], Distortion::Unified([xi, c[0], c[1], c[2], c[3]]))
        }
        "eucm" => {
            let [alpha, beta, fx, fy, cx, cy] = doc.array::<6>(intrinsics, "intrinsics of eucm")?;
            lens(name)?;
            ([fx, fy, cx, cy], Distortion::ExtendedUnified { alpha, beta })
        }
        other => {
            let why = format!("camera model \"{other}\" is not known (pinhole, omni, ds and eucm are)");
            return Err(doc.error(model.line, why));
        }
    };
    let size = doc.size(node.line, [width, height])?;
    doc.camera(intrinsics.line, size, [fx, fy, cx, cy], distortion)
}

/// An IMU file: under `imu0`, or flat as Kalibr reads it.
pub fn imu_file(path: &Path) -> Result<ImuSensor, SourceError> {
    let doc = Document::parse(path, &read_text(path)?)?;
    let node = doc.root.get("imu0").unwrap_or(&doc.root);
    imu(&doc, node, "update_rate")
}

/// Noise and rate of an IMU node; the body is the IMU unless `T_BS` or `T_i_b` say otherwise.
pub fn imu(doc: &Document, node: &Node, rate_key: &str) -> Result<ImuSensor, SourceError> {
    imu_at(doc, node, doc.need_number(node, rate_key)?)
}

fn imu_at(doc: &Document, node: &Node, rate_hz: f64) -> Result<ImuSensor, SourceError> {
    let body_from_imu = match (node.get("T_BS"), node.get("T_i_b")) {
        (Some(t), _) => doc.transform(t, "T_BS")?,
        (None, Some(t)) => doc.transform(t, "T_i_b")?.inverse(),
        (None, None) => Se3::identity(),
    };
    Ok(ImuSensor {
        body_from_imu,
        rate_hz,
        noise: ImuNoise {
            gyro: doc.need_number(node, "gyroscope_noise_density")?,
            gyro_walk: doc.need_number(node, "gyroscope_random_walk")?,
            accel: doc.need_number(node, "accelerometer_noise_density")?,
            accel_walk: doc.need_number(node, "accelerometer_random_walk")?,
        },
        offset_s: 0.0,
    })
}

/// The single YAML file next to the chain that is an IMU's by its name; `None` when there is none or more
/// than one.
fn neighbouring_imu_file(chain: &Path) -> Option<PathBuf> {
    let mut found =
        std::fs::read_dir(chain.parent()?).ok()?.filter_map(|e| Some(e.ok()?.path())).filter(|p| {
            let name = p.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
            name.contains("imu")
                && !name.contains("cam")
                && (name.ends_with(".yaml") || name.ends_with(".yml"))
                && p != chain
        });
    let first = found.next()?;
    found.next().is_none().then_some(first)
}
