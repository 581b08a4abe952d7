//! ORB-SLAM settings files: OpenCV FileStorage with the key names of version 1.0 and earlier, also those of R-VIO (`Camera.T_BC0`,
//! `Camera.Fisheye`, `IMU.sigma_g`) and of AirVO (`LEFT.K` with `image_width`).

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Distortion, ImuNoise, ImuSensor, Rig, RigCamera, SourceError};
use nalgebra::Matrix3;

/// The rig; `size` is used where the file has no resolution.
///
/// `RGBD.DepthMapFactor` makes it an RGB-D rig, `Camera2.*` or `RIGHT.*` a stereo rig, `Stereo.b` or `Camera.bf`
/// alone a rectified stereo rig. The body is the IMU where `IMU.T_b_c1` (`Tbc`) is given, else the first camera.
pub fn rig(doc: &Document, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let reader = Reader { doc, size: resolution(doc, size)? };
    let first = reader.first_camera()?;
    let body_from_first = match reader.placed() {
        Some(t) => doc.transform(t, "IMU.T_b_c1")?,
        None => Se3::identity(),
    };
    let depth_factor =
        reader.any(&["RGBD.DepthMapFactor", "DepthMapFactor"]).map(|n| doc.number(n)).transpose()?;
    let mut cameras =
        vec![RigCamera { name: "cam0".into(), camera: first, body_from_camera: body_from_first }];
    let mut depth = None;
    if let Some(factor) = depth_factor {
        // One unit is 1 / factor metres; old files write 0 or 1e-9 for "already metres".
        let metres_per_unit = if factor.abs() < 1e-5 { 1.0 } else { 1.0 / factor };
        depth = Some(DepthSensor {
            camera: first,
            body_from_depth: body_from_first,
            metres_per_unit,
            registered: true,
        });
    } else if let Some((camera, first_from_second)) = reader.second_camera(&first)? {
        let body_from_camera = body_from_first * first_from_second;
        cameras.push(RigCamera { name: "cam1".into(), camera, body_from_camera });
    }
    Ok(Rig { cameras, depth, imu: reader.imu()? })
}

/// True when a file has the keys of such settings.
pub fn is_settings(root: &Node) -> bool {
    ["Camera.type", "Camera1.fx", "Camera.fx", "LEFT.K"].iter().any(|key| root.get(key).is_some())
}

/// Tells that an IMU has noise, but no place, so that it is left out.
pub fn imu_left_out(root: &Node) -> Option<String> {
    let has = |keys: &[&str]| keys.iter().any(|key| root.get(key).is_some());
    (is_settings(root) && has(&["IMU.NoiseGyro", "IMU.sigma_g"]) && !has(&PLACED))
        .then(|| "has the noise of an IMU, but not its place (IMU.T_b_c1): the IMU is left out".into())
}

/// Tells that the raw cameras of a pair are not those of its rectified ones, so that these are taken.
pub fn not_raw(doc: &Document) -> Option<String> {
    let has_both = doc.root.get("LEFT.K").is_some() && doc.root.get("Camera.fx").is_some();
    (has_both && !is_raw_pair(doc)).then(|| {
        "has LEFT.* and RIGHT.* that do not belong to its Camera.fx (LEFT.P has another, or LEFT.D and LEFT.R are empty): the \
         images are taken as rectified already, with Camera.* and Camera.bf"
            .into()
    })
}

/// Whether the images are raw, as by `LEFT.*` and `RIGHT.*`, and to be rectified into `Camera.*`. Files of cameras that rectify
/// themselves often keep what was there of another.
fn is_raw_pair(doc: &Document) -> bool {
    let of = |key: &str| doc.root.get(key).and_then(|node| doc.matrix(node, key).ok());
    let Some(fx) = doc.root.get("Camera.fx").and_then(|node| doc.number(node).ok()) else {
        return doc.root.get("LEFT.K").is_some();
    };
    let is_rectified_into = of("LEFT.P").is_none_or(|p| (p.first().unwrap_or(&0.0) / fx - 1.0).abs() < 0.01);
    let lens = doc.root.get("LEFT.D").and_then(|node| node.get("data").unwrap_or(node).list());
    let is_there =
        lens.is_none_or(|d| !d.is_empty()) && of("LEFT.R").is_none_or(|r| r.iter().any(|v| *v != 0.0));
    doc.root.get("LEFT.K").is_some() && is_rectified_into && is_there
}

/// Body from camera, by its names; the last two of R-VIO, whose `INI.UseGroundTruthCalib` says which of them.
const PLACED: [&str; 4] = ["IMU.T_b_c1", "Tbc", "Camera.T_BC0", "Camera.T_BC0_GT"];

fn resolution(doc: &Document, size: Option<[usize; 2]>) -> Result<[usize; 2], SourceError> {
    // The raw images of a pair that is to be rectified can have another size than the rectified ones.
    let any = |keys: [&str; 3]| keys.iter().find_map(|key| doc.root.get(key));
    let (width, height) = match is_raw_pair(doc) {
        true => (
            any(["LEFT.width", "Camera.width", "image_width"]),
            any(["LEFT.height", "Camera.height", "image_height"]),
        ),
        false => (doc.root.get("Camera.width"), doc.root.get("Camera.height")),
    };
    match (width, height, size) {
        (Some(w), Some(h), _) => doc.size(w.line, [doc.number(w)?, doc.number(h)?]),
        (_, _, Some(size)) => Ok(size),
        _ => Err(SourceError::new(
            doc.path.display().to_string(),
            "names no Camera.width and Camera.height",
            "give the recording as well (--with), whose images have the size, or add the two lines",
        )),
    }
}

struct Reader<'a> {
    doc: &'a Document,
    size: [usize; 2],
}

impl<'a> Reader<'a> {
    fn any(&self, keys: &[&str]) -> Option<&'a Node> {
        keys.iter().find_map(|key| self.doc.root.get(key))
    }

    /// The place of the first camera on the IMU.
    fn placed(&self) -> Option<&'a Node> {
        self.any(if self.is_truth() { &["Camera.T_BC0_GT"] } else { &PLACED[..3] })
    }

    /// Of R-VIO's two calibrations the one called true is to be used.
    fn is_truth(&self) -> bool {
        self.is_set("INI.UseGroundTruthCalib") && self.doc.root.get("Camera.T_BC0_GT").is_some()
    }

    fn is_set(&self, key: &str) -> bool {
        self.doc.root.get(key).and_then(Node::text).is_some_and(|text| text != "0")
    }

    fn optional(&self, key: &str) -> Result<Option<f64>, SourceError> {
        self.doc.root.get(key).map(|node| self.doc.number(node)).transpose()
    }

    fn first_camera(&self) -> Result<Camera, SourceError> {
        // Before version 1.0 raw stereo images had their own matrices, and Camera.* were the rectified ones.
        match is_raw_pair(self.doc) {
            true => self.matrix_camera("LEFT"),
            false if self.doc.root.get("Camera1.fx").is_some() => self.camera("Camera1"),
            false => self.camera("Camera"),
        }
    }

    /// `fx, fy, cx, cy` and `k1, k2, ...` under a prefix, with the lens that `Camera.type` names.
    fn camera(&self, prefix: &str) -> Result<Camera, SourceError> {
        let need = |name: &str| self.doc.need_number(&self.doc.root, &format!("{prefix}.{name}"));
        let coefficient = |name: &str| -> Result<f64, SourceError> {
            Ok(self.optional(&format!("{prefix}.{name}"))?.unwrap_or(0.0))
        };
        let kind = self.doc.root.get("Camera.type");
        let usual = if self.is_set("Camera.Fisheye") { "R-VIO's fisheye" } else { "PinHole" };
        let distortion = match kind.and_then(Node::text).unwrap_or(usual) {
            "R-VIO's fisheye" => Distortion::Equidistant([
                coefficient("k1")?,
                coefficient("k2")?,
                coefficient("p1")?,
                coefficient("p2")?,
            ]),
            "Rectified" => Distortion::None,
            "KannalaBrandt8" => Distortion::Equidistant([
                coefficient("k1")?,
                coefficient("k2")?,
                coefficient("k3")?,
                coefficient("k4")?,
            ]),
            "PinHole" | "Pinhole" => brown([
                coefficient("k1")?,
                coefficient("k2")?,
                coefficient("p1")?,
                coefficient("p2")?,
                coefficient("k3")?,
                coefficient("k4")?,
                coefficient("k5")?,
                coefficient("k6")?,
            ]),
            other => {
                let why =
                    format!("Camera.type \"{other}\" is not known (PinHole, KannalaBrandt8, Rectified are)");
                return Err(self.doc.error(kind.map_or(0, |n| n.line), why));
            }
        };
        let line = self.doc.root.get(&format!("{prefix}.fx")).map_or(0, |n| n.line);
        let numbers = [need("fx")?, need("fy")?, need("cx")?, need("cy")?];
        self.doc.camera(line, self.size, numbers, distortion)
    }

    /// The second camera and its pose in the first one's frame, if the file has one.
    fn second_camera(&self, first: &Camera) -> Result<Option<(Camera, Se3)>, SourceError> {
        let along_x = |baseline: f64| Se3::new(So3::identity(), Vec3::new(baseline, 0.0, 0.0));
        let doc = self.doc;
        if is_raw_pair(doc) {
            return Ok(Some((self.matrix_camera("RIGHT")?, self.rectified_extrinsics()?)));
        }
        let baseline = match (self.optional("Stereo.b")?, self.optional("Camera.bf")?) {
            (Some(b), _) => Some(b),
            (None, Some(bf)) => Some(bf / first.fx),
            (None, None) => None,
        };
        let extrinsics = self.any(&["Stereo.T_c1_c2", "Tlr"]);
        if doc.root.get("Camera2.fx").is_some() {
            let camera = self.camera("Camera2")?;
            return match (extrinsics, baseline) {
                (Some(t), _) => Ok(Some((camera, doc.transform(t, "Stereo.T_c1_c2")?))),
                (None, Some(b)) => Ok(Some((camera, along_x(b)))),
                (None, None) => Err(doc.error(0, "has Camera2 but neither Stereo.T_c1_c2 nor Stereo.b")),
            };
        }
        Ok(baseline.filter(|b| *b != 0.0).map(|b| (*first, along_x(b))))
    }

    /// `LEFT.K`, `LEFT.D` and the like: the raw camera behind a rectified pair.
    fn matrix_camera(&self, side: &str) -> Result<Camera, SourceError> {
        let node = self.doc.need(&self.doc.root, &format!("{side}.K"))?;
        let k = self.nine(node, side)?;
        let d = match self.doc.root.get(&format!("{side}.D")) {
            Some(node) => self.doc.matrix(node, side)?,
            None => Vec::new(),
        };
        let mut c = [0.0; 8];
        if d.len() > c.len() {
            return Err(self
                .doc
                .error(node.line, format!("{side}.D has {} coefficients, at most 8", d.len())));
        }
        c[..d.len()].copy_from_slice(&d);
        let [width, height] = self.size;
        // AirVO's.
        let distortion = match self.doc.root.get("distortion_type").and_then(Node::text) {
            Some("1") => Distortion::Equidistant([c[0], c[1], c[2], c[3]]),
            _ => brown(c),
        };
        let camera = Camera { width, height, fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion };
        camera.validate().map_err(|e| self.doc.error(node.line, format!("{side}: {e}")))?;
        Ok(camera)
    }

    /// Left from right, from the rotations that rectify both: `x_rect = R x`, and in the rectified frame the
    /// right camera is at `-P[0][3] / P[0][0]` along x.
    fn rectified_extrinsics(&self) -> Result<Se3, SourceError> {
        let rotation = |key: &str| -> Result<So3, SourceError> {
            let node = self.doc.need(&self.doc.root, key)?;
            let r = Matrix3::from_row_slice(&self.nine(node, key)?);
            cairn_sensor::check_rotation(key, &r).map_err(|e| self.doc.error(node.line, e.to_string()))?;
            Ok(So3::from_matrix(&r))
        };
        let node = self.doc.need(&self.doc.root, "RIGHT.P")?;
        let p = self.doc.matrix(node, "RIGHT.P")?;
        if p.len() != 12 || p[0] <= 0.0 {
            return Err(self.doc.error(node.line, "RIGHT.P must be a 3x4 projection"));
        }
        let baseline = Vec3::new(-p[3] / p[0], 0.0, 0.0);
        let rect_from_left = Se3::new(rotation("LEFT.R")?, Vec3::zeros());
        let rect_from_right = Se3::new(rotation("RIGHT.R")?, baseline);
        Ok(rect_from_left.inverse() * rect_from_right)
    }

    fn nine(&self, node: &Node, what: &str) -> Result<[f64; 9], SourceError> {
        let m = self.doc.matrix(node, what)?;
        let count = m.len();
        m.try_into()
            .map_err(|_| self.doc.error(node.line, format!("{what} needs 3x3 numbers, here are {count}")))
    }

    /// The IMU, when its pose and its noise are given.
    fn imu(&self) -> Result<Option<ImuSensor>, SourceError> {
        let doc = self.doc;
        let of_rvio = doc.root.get("IMU.sigma_g").is_some();
        if self.placed().is_none() || !(of_rvio || doc.root.get("IMU.NoiseGyro").is_some()) {
            return Ok(None);
        }
        let need = |key: [&str; 2]| doc.need_number(&doc.root, key[of_rvio as usize]);
        let shift = match self.is_truth() {
            true => self.optional("Camera.nTimeOffset_GT")?,
            // One of its versions writes a colon for the dot.
            false => self.optional("Camera.nTimeOffset")?.or(self.optional("Camera:nTimeOffset")?),
        };
        Ok(Some(ImuSensor {
            body_from_imu: Se3::identity(),
            rate_hz: need(["IMU.Frequency", "IMU.dps"])?,
            noise: ImuNoise {
                gyro: need(["IMU.NoiseGyro", "IMU.sigma_g"])?,
                gyro_walk: need(["IMU.GyroWalk", "IMU.sigma_wg"])?,
                accel: need(["IMU.NoiseAcc", "IMU.sigma_a"])?,
                accel_walk: need(["IMU.AccWalk", "IMU.sigma_wa"])?,
            },
            // R-VIO: t_imu = t_image + shift.
            offset_s: -shift.unwrap_or(0.0),
        }))
    }
}

/// The simplest lens with these coefficients.
fn brown(c: [f64; 8]) -> Distortion {
    if c.iter().all(|v| *v == 0.0) {
        Distortion::None
    } else if c[5..].iter().all(|v| *v == 0.0) {
        Distortion::RadialTangential([c[0], c[1], c[2], c[3], c[4]])
    } else {
        Distortion::Rational(c)
    }
}
