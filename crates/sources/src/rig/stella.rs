//! stella_vslam (and OpenVSLAM) configuration files: the camera under `Camera`, nested or as `Camera.fx`.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Distortion, Rig, RigCamera, SourceError};
use nalgebra::Matrix3;

/// True when a file has the keys of such a configuration: ORB-SLAM has no `Camera.setup`, and calls the size
/// `Camera.width`.
pub fn is_config(root: &Node) -> bool {
    let reader =
        |key| root.get("Camera").and_then(|c| c.get(key)).or_else(|| root.get(&format!("Camera.{key}")));
    reader("setup").is_some() && reader("model").is_some()
}

/// The rig: one camera; with `setup: RGBD` depth registered to it; with `setup: stereo` a rectified pair, or the raw
/// pair of `StereoRectifier`. `size` is used where the file has no `cols` and `rows`.
pub fn rig(doc: &Document, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let reader = Reader { doc };
    let camera = reader.camera(size)?;
    let setup = reader.get("setup").and_then(Node::text).unwrap_or_default().to_ascii_lowercase();
    match setup.as_str() {
        "monocular" => Ok(Rig::mono(camera)),
        "stereo" => reader.stereo(camera),
        "rgbd" => {
            let factor = match reader.depth_factor()? {
                Some(factor) if factor > 0.0 => factor,
                Some(factor) => return Err(doc.error(0, format!("depthmap_factor is {factor}"))),
                None => 1.0,
            };
            let depth = DepthSensor {
                camera,
                body_from_depth: Se3::identity(),
                metres_per_unit: 1.0 / factor,
                registered: true,
            };
            Ok(Rig { depth: Some(depth), ..Rig::mono(camera) })
        }
        other => Err(doc.error(
            reader.get("setup").map_or(0, |n| n.line),
            format!("Camera.setup \"{other}\" is not known (monocular, stereo, RGBD are)"),
        )),
    }
}

struct Reader<'a> {
    doc: &'a Document,
}

impl<'a> Reader<'a> {
    /// A key of the camera, nested or flat.
    fn get(&self, key: &str) -> Option<&'a Node> {
        let root = &self.doc.root;
        root.get("Camera").and_then(|c| c.get(key)).or_else(|| root.get(&format!("Camera.{key}")))
    }

    fn need(&self, key: &str) -> Result<f64, SourceError> {
        let node = self.get(key).ok_or_else(|| self.doc.error(0, format!("Camera.{key} is missing")))?;
        self.doc.number(node)
    }

    fn or_zero(&self, key: &str) -> Result<f64, SourceError> {
        self.get(key).map_or(Ok(0.0), |node| self.doc.number(node))
    }

    fn camera(&self, size: Option<[usize; 2]>) -> Result<Camera, SourceError> {
        let [width, height] = match (self.get("cols"), self.get("rows"), size) {
            (Some(cols), Some(rows), _) => {
                self.doc.size(cols.line, [self.doc.number(cols)?, self.doc.number(rows)?])?
            }
            (_, _, Some(size)) => size,
            _ => return Err(self.doc.error(0, "names no Camera.cols and Camera.rows")),
        };
        let model = self.get("model").and_then(Node::text).unwrap_or_default();
        let distortion = match model {
            "perspective" => {
                let [k1, k2, p1, p2, k3] = ["k1", "k2", "p1", "p2", "k3"].map(|key| self.or_zero(key));
                brown([k1?, k2?, p1?, p2?, k3?])
            }
            "fisheye" => {
                let [k1, k2, k3, k4] = ["k1", "k2", "k3", "k4"].map(|key| self.or_zero(key));
                Distortion::Equidistant([k1?, k2?, k3?, k4?])
            }
            "radial_division" => Distortion::Division(self.need("distortion")?),
            "equirectangular" => {
                let why = "Camera.model \"equirectangular\" has no image plane: cut a perspective view out of the images";
                return Err(self.doc.error(self.get("model").map_or(0, |n| n.line), why));
            }
            other => {
                let why = format!(
                    "Camera.model \"{other}\" is not known (perspective, fisheye and radial_division are)"
                );
                return Err(self.doc.error(self.get("model").map_or(0, |n| n.line), why));
            }
        };
        let (fx, fy, cx, cy) = (self.need("fx")?, self.need("fy")?, self.need("cx")?, self.need("cy")?);
        let camera = Camera { width, height, fx, fy, cx, cy, distortion };
        camera.validate().map_err(|e| self.doc.error(self.get("fx").map_or(0, |n| n.line), e.to_string()))?;
        Ok(camera)
    }

    fn depth_factor(&self) -> Result<Option<f64>, SourceError> {
        let root = &self.doc.root;
        let node = self
            .get("depthmap_factor")
            .or_else(|| root.get("Preprocessing").and_then(|p| p.get("depthmap_factor")))
            .or_else(|| root.get("depthmap_factor"));
        node.map(|node| self.doc.number(node)).transpose()
    }

    /// `focal_x_baseline` is the focal length in pixels times the baseline in metres.
    fn stereo(&self, rectified: Camera) -> Result<Rig, SourceError> {
        let baseline = self.need("focal_x_baseline")? / rectified.fx;
        let pair = |left: Camera, right: Camera, left_from_right: Se3| Rig {
            cameras: vec![
                RigCamera { name: "cam0".into(), camera: left, body_from_camera: Se3::identity() },
                RigCamera { name: "cam1".into(), camera: right, body_from_camera: left_from_right },
            ],
            depth: None,
            imu: None,
        };
        let along_x = Se3::new(So3::identity(), Vec3::new(baseline, 0.0, 0.0));
        if self.rectifier("K_left").is_none() {
            return Ok(pair(rectified, rectified, along_x));
        }
        // x_rectified = R x; in the rectified frame the right camera is one baseline along x.
        let [left, right] = ["left", "right"].map(|side| self.raw_camera(side, &rectified));
        let [r_left, r_right] = ["R_left", "R_right"].map(|key| self.rotation(key));
        let rect_from_left = Se3::new(r_left?, Vec3::zeros());
        let rect_from_right = Se3::new(r_right?, along_x.translation);
        Ok(pair(left?, right?, rect_from_left.inverse() * rect_from_right))
    }

    /// A key of the rectification, nested or flat.
    fn rectifier(&self, key: &str) -> Option<&'a Node> {
        let root = &self.doc.root;
        let nested = root.get("StereoRectifier").and_then(|r| r.get(key));
        nested.or_else(|| root.get(&format!("StereoRectifier.{key}")))
    }

    fn need_rectifier(&self, key: &str) -> Result<&'a Node, SourceError> {
        self.rectifier(key).ok_or_else(|| self.doc.error(0, format!("StereoRectifier.{key} is missing")))
    }

    fn raw_camera(&self, side: &str, like: &Camera) -> Result<Camera, SourceError> {
        let doc = self.doc;
        let key = format!("K_{side}");
        let k_node = self.need_rectifier(&key)?;
        let k = doc.matrix(k_node, &key)?;
        let d = match self.rectifier(&format!("D_{side}")) {
            Some(d) => doc.matrix(d, "D")?,
            None => Vec::new(),
        };
        if k.len() != 9 {
            return Err(doc.error(k_node.line, format!("{key} needs 3x3 numbers, here are {}", k.len())));
        }
        let fisheye = self.rectifier("model").and_then(Node::text) == Some("fisheye");
        let distortion = match (fisheye, d.as_slice()) {
            (_, []) => Distortion::None,
            (true, &[k1, k2, k3, k4, ..]) => Distortion::Equidistant([k1, k2, k3, k4]),
            (false, &[k1, k2, p1, p2]) => brown([k1, k2, p1, p2, 0.0]),
            (false, &[k1, k2, p1, p2, k3]) => brown([k1, k2, p1, p2, k3]),
            _ => {
                let why = format!("D_{side} has {} coefficients, 4 or 5 are needed", d.len());
                return Err(doc.error(k_node.line, why));
            }
        };
        let camera = Camera { fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion, ..*like };
        camera.validate().map_err(|e| doc.error(k_node.line, e.to_string()))?;
        Ok(camera)
    }

    fn rotation(&self, key: &str) -> Result<So3, SourceError> {
        let r_node = self.need_rectifier(key)?;
        let r = self.doc.matrix(r_node, key)?;
        if r.len() != 9 {
            return Err(self
                .doc
                .error(r_node.line, format!("{key} needs 3x3 numbers, here are {}", r.len())));
        }
        let r = Matrix3::from_row_slice(&r);
        cairn_sensor::check_rotation(key, &r).map_err(|e| self.doc.error(r_node.line, e.to_string()))?;
        Ok(So3::from_matrix(&r))
    }
}

fn brown(c: [f64; 5]) -> Distortion {
    if c.iter().all(|v| *v == 0.0) { Distortion::None } else { Distortion::RadialTangential(c) }
}
