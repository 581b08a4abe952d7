//! Cameras of camodocal (`model_type: PINHOLE`, `PINHOLE_FULL`, `MEI` or `KANNALA_BRANDT`), and the configurations of VINS-Mono and
//! VINS-Fusion around them.
//!
//! VINS states noise for one sample, not as a density, and no rate: 200 samples a second are taken, as in its recordings.

use super::document::{Document, SCARAMUZZA};
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{Camera, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};
use std::path::Path;

/// Samples a second that VINS's noise is for.
pub const RATE_HZ: f64 = 200.0;

/// True when a file has the keys of one.
pub fn is(root: &Node) -> bool {
    root.get("model_type").is_some() || root.get("cam0_calib").is_some()
}

/// The rig of a camera alone, or of a configuration.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let mut cameras = Vec::new();
    if doc.root.get("model_type").is_some() {
        let body_from_camera = match doc.root.get("extrinsicTranslation") {
            Some(t) => mono_extrinsics(doc, t)?,
            None => Se3::identity(),
        };
        cameras.push(RigCamera { name: "cam0".into(), camera: camera(doc)?, body_from_camera });
    }
    let folder = doc.path.parent().unwrap_or(Path::new(""));
    let used = doc.root.get("num_of_cam").map_or(Ok(2.0), |n| doc.number(n))?;
    for i in 0..used.clamp(0.0, 2.0) as usize {
        let name = format!("cam{i}");
        let Some(file) = doc.root.get(&format!("{name}_calib")).and_then(Node::text) else { break };
        let path = folder.join(file);
        let camera = camera(&Document::parse(&path, &read_text(&path)?)?)?;
        let key = format!("body_T_{name}");
        let placed = doc.root.get(&key).is_some() || used > 1.0;
        let body_from_camera = match placed {
            true => doc.transform(doc.need(&doc.root, &key)?, &key)?,
            false => Se3::identity(),
        };
        cameras.push(RigCamera { name, camera, body_from_camera });
    }
    Ok(Rig { cameras, depth: None, imu: imu(doc)? })
}

/// `extrinsicRotation` and `extrinsicTranslation`: body from camera.
fn mono_extrinsics(doc: &Document, translation: &Node) -> Result<Se3, SourceError> {
    let r = doc.matrix(doc.need(&doc.root, "extrinsicRotation")?, "extrinsicRotation")?;
    let t = doc.matrix(translation, "extrinsicTranslation")?;
    let (&[a, b, c, d, e, f, g, h, i], &[x, y, z]) = (r.as_slice(), t.as_slice()) else {
        return Err(
            doc.error(translation.line, "a rotation of 3x3 and a translation of 3 numbers are needed")
        );
    };
    let m = [a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0];
    super::document::rigid(&m, "extrinsicRotation").map_err(|e| doc.error(translation.line, e.0))
}

fn camera(doc: &Document) -> Result<Camera, SourceError> {
    let root = &doc.root;
    let size = [doc.need_number(root, "image_width")?, doc.need_number(root, "image_height")?];
    let size = doc.size(0, size)?;
    let projection = doc.need(root, "projection_parameters")?;
    let of = |keys: [&str; 4]| -> Result<[f64; 4], SourceError> {
        let [a, b, c, d] = keys.map(|key| doc.need_number(projection, key));
        Ok([a?, b?, c?, d?])
    };
    let radial = || -> Result<[f64; 4], SourceError> {
        let node = root.get("distortion_parameters");
        let value = |key| node.and_then(|n| n.get(key)).map_or(Ok(0.0), |n| doc.number(n));
        Ok([value("k1")?, value("k2")?, value("p1")?, value("p2")?])
    };
    let model = doc.need(root, "model_type")?;
    let (numbers, distortion) = match model.text().unwrap_or_default().to_ascii_uppercase().as_str() {
        "PINHOLE" => {
            let [k1, k2, p1, p2] = radial()?;
            (of(["fx", "fy", "cx", "cy"])?, Distortion::RadialTangential([k1, k2, p1, p2, 0.0]))
        }
        "PINHOLE_FULL" => {
            let node = root.get("distortion_parameters");
            let value = |key| node.and_then(|n| n.get(key)).map_or(Ok(0.0), |n| doc.number(n));
            let mut c = [0.0; 8];
            for (c, key) in c.iter_mut().zip(["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]) {
                *c = value(key)?;
            }
            (of(["fx", "fy", "cx", "cy"])?, Distortion::Rational(c))
        }
        "MEI" => {
            let xi = doc.need_number(doc.need(root, "mirror_parameters")?, "xi")?;
            let [k1, k2, p1, p2] = radial()?;
            (of(["gamma1", "gamma2", "u0", "v0"])?, Distortion::Unified([xi, k1, k2, p1, p2]))
        }
        "KANNALA_BRANDT" => {
            (of(["mu", "mv", "u0", "v0"])?, Distortion::Equidistant(of(["k2", "k3", "k4", "k5"])?))
        }
        name @ "SCARAMUZZA" => {
            return Err(doc.error(model.line, format!("model_type {name}: {SCARAMUZZA}")));
        }
        other => {
            let why = format!(
                "model_type \"{other}\" is not known (PINHOLE, PINHOLE_FULL, MEI and KANNALA_BRANDT are)"
            );
            return Err(doc.error(model.line, why));
        }
    };
    doc.camera(projection.line, size, numbers, distortion)
}

fn names_imu(root: &Node) -> bool {
    root.get("gyr_n").is_some() && root.get("imu").is_none_or(|n| n.text() != Some("0"))
}

/// True when the place of the camera on the IMU is to be found out by VINS, or is not stated.
fn is_unplaced(root: &Node) -> bool {
    let keys = ["extrinsicTranslation", "body_T_cam0"];
    root.get("estimate_extrinsic").is_some_and(|n| n.text() == Some("2"))
        || keys.iter().all(|key| root.get(key).is_none())
}

/// True when it has an IMU that can be used, whose rate it never states.
pub fn has_imu(root: &Node) -> bool {
    names_imu(root) && !is_unplaced(root)
}

/// Tells that an IMU is left out because nobody knows how the camera stands to it.
pub fn imu_left_out(root: &Node) -> Option<String> {
    (is(root) && names_imu(root) && is_unplaced(root)).then(|| {
        "does not know how the camera stands to the IMU (estimate_extrinsic 2, or no extrinsics): the IMU is left out".into()
    })
}

/// The IMU, when its noise is given.
fn imu(doc: &Document) -> Result<Option<ImuSensor>, SourceError> {
    let root = &doc.root;
    if !has_imu(root) {
        return Ok(None);
    }
    let density = |key: &str| Ok::<f64, SourceError>(doc.need_number(root, key)? / RATE_HZ.sqrt());
    Ok(Some(ImuSensor {
        body_from_imu: Se3::identity(),
        rate_hz: RATE_HZ,
        noise: ImuNoise {
            gyro: density("gyr_n")?,
            gyro_walk: density("gyr_w")?,
            accel: density("acc_n")?,
            accel_walk: density("acc_w")?,
        },
        // VINS: t_image + td = t_imu.
        offset_s: -root.get("td").map_or(Ok(0.0), |n| doc.number(n))?,
    }))
}
