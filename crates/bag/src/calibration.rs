//! `sensor_msgs/CameraInfo`: intrinsics, distortion, and the extrinsics of a stereo pair.
//!
//! The fields are those of the message definition: `K` is the matrix of the raw image, `D` its distortion, `R` rotates
//! from the camera frame to its rectified frame, `P` projects from that frame; for the right camera `P[3] = -fx *
//! baseline`.

use crate::error::DecodeError;
use crate::message::is_foxglove;
use crate::protobuf::{Field, doubles, fields, stamp_ns, text};
use crate::wire::{Header, Wire, WireFormat};
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, check_rotation};

/// A `sensor_msgs/CameraInfo`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// Time and frame.
    pub header: Header,
    /// Image height in pixels.
    pub height: u32,
    /// Image width in pixels.
    pub width: u32,
    /// Name of the distortion model, such as `plumb_bob`.
    pub model: String,
    /// Distortion coefficients.
    pub d: Vec<f64>,
    /// Intrinsic matrix of the raw image, row by row.
    pub k: [f64; 9],
    /// Rotation to the rectified frame, row by row.
    pub r: [f64; 9],
    /// Projection matrix of the rectified image, row by row.
    pub p: [f64; 12],
}

impl CameraInfo {
    /// Decodes a message.
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn decode(format: WireFormat, bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut wire = Wire::new(format, bytes)?;
        let header = wire.header()?;
        let (height, width, model) = (wire.u32()?, wire.u32()?, wire.string()?);
        let n = wire.length(8)?;
        let d = (0..n).map(|_| wire.f64()).collect::<Result<_, _>>()?;
        Ok(Self { header, height, width, model, d, k: wire.f64s()?, r: wire.f64s()?, p: wire.f64s()? })
    }

    /// Decodes a message of any type with kind [`crate::MessageKind::CameraInfo`].
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn of(kind: &str, format: WireFormat, bytes: &[u8]) -> Result<Self, DecodeError> {
        if format != WireFormat::Protobuf {
            // Foxglove's type has the width before the height.
            let mut out = Self::decode(format, bytes)?;
            if is_foxglove(kind) {
                (out.width, out.height) = (out.height, out.width);
            }
            return Ok(out);
        }
        let header = Header { stamp_ns: 0, frame_id: String::new() };
        let (k, r, p) = ([0.0; 9], [0.0; 9], [0.0; 12]);
        let mut out = Self { header, height: 0, width: 0, model: String::new(), d: Vec::new(), k, r, p };
        let fill = |to: &mut [f64], from: &[u8]| to.iter_mut().zip(doubles(from)).for_each(|(a, b)| *a = b);
        for (number, field) in fields(bytes)? {
            match (number, field) {
                (1, Field::Bytes(b)) => out.header.stamp_ns = stamp_ns(b).unwrap_or(0),
                (2, Field::Number(v)) => out.width = v as u32,
                (3, Field::Number(v)) => out.height = v as u32,
                (4, Field::Bytes(b)) => out.model = text(b),
                (5, Field::Bytes(b)) => out.d = doubles(b),
                (6, Field::Bytes(b)) => fill(&mut out.k, b),
                (7, Field::Bytes(b)) => fill(&mut out.r, b),
                (8, Field::Bytes(b)) => fill(&mut out.p, b),
                (9, Field::Bytes(b)) => out.header.frame_id = text(b),
                _ => {}
            }
        }
        Ok(out)
    }

    /// The camera of the raw image, or of the rectified one.
    ///
    /// # Errors
    /// When the message was never filled in, its model is unknown, or its numbers are not a valid camera.
    pub fn camera(&self, rectified: bool) -> Result<Camera, DecodeError> {
        let [fx, cx, fy, cy] = match rectified {
            true => [self.p[0], self.p[2], self.p[5], self.p[6]],
            false => [self.k[0], self.k[2], self.k[4], self.k[5]],
        };
        if fx == 0.0 {
            return Err(DecodeError::new("the camera was not calibrated when it was recorded (K is 0)"));
        }
        let distortion = if rectified { Distortion::None } else { self.distortion()? };
        let (w, h) = (self.width as usize, self.height as usize);
        let camera = Camera { distortion, ..Camera::pinhole(w, h, fx, fy, cx, cy) };
        camera.validate().map_err(DecodeError::new)?;
        Ok(camera)
    }

    /// The distortion: the models of ROS, and those of the RealSense SDK under its own names.
    fn distortion(&self) -> Result<Distortion, DecodeError> {
        if self.d.iter().all(|v| *v == 0.0) {
            return Ok(Distortion::None);
        }
        let of = |n: usize| -> Result<Vec<f64>, DecodeError> {
            if self.d.len() > n && self.d[n..].iter().any(|v| *v != 0.0) {
                let why = format!("{} with {} coefficients, {n} at most", self.model, self.d.len());
                return Err(DecodeError::new(why));
            }
            Ok((0..n).map(|i| self.d.get(i).copied().unwrap_or(0.0)).collect())
        };
        let five = || of(5).map(|c| [c[0], c[1], c[2], c[3], c[4]]);
        match self.model.to_ascii_lowercase().replace(' ', "_").as_str() {
            "plumb_bob" | "brown_conrady" => five().map(Distortion::RadialTangential),
            "inverse_brown_conrady" => five().map(Distortion::InverseRadialTangential),
            "rational_polynomial" => {
                of(8).map(|c| Distortion::Rational([c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]]))
            }
            "equidistant" | "fisheye" | "kannala_brandt" | "kannala_brandt4" => {
                of(4).map(|c| Distortion::Equidistant([c[0], c[1], c[2], c[3]]))
            }
            // It applies the tangential distortion to the radially distorted point; without tangential terms the two
            // models are equal.
            "modified_brown_conrady" if self.d.get(2..4).is_some_and(|p| p == [0.0, 0.0]) => {
                five().map(Distortion::RadialTangential)
            }
            _ => Err(DecodeError::new(format!("the distortion model \"{}\" is not known", self.model))),
        }
    }

    /// The rotation to the rectified frame; identity if all entries are zero.
    fn rectified_from_camera(&self) -> Result<So3, DecodeError> {
        if self.r.iter().all(|v| *v == 0.0) {
            return Ok(So3::identity());
        }
        let m = Mat3::from_row_slice(&self.r);
        check_rotation("R", &m).map_err(DecodeError::new)?;
        Ok(So3::from_matrix(&m))
    }
}

/// Pose of the right camera of a calibrated pair in the left one; `None` where `P` has no baseline.
///
/// With `rectified`, both images are rectified and only the baseline is between them. Otherwise `left_from_right =
/// R_l^T [I | (b, 0, 0)] R_r`, as both rectified frames have the same orientation.
///
/// # Errors
/// When `R` is not a rotation.
pub fn stereo_left_from_right(
    left: &CameraInfo,
    right: &CameraInfo,
    rectified: bool,
) -> Result<Option<Se3>, DecodeError> {
    let offset = |info: &CameraInfo| if info.p[0] == 0.0 { 0.0 } else { -info.p[3] / info.p[0] };
    let baseline_m = offset(right) - offset(left);
    if baseline_m == 0.0 || !baseline_m.is_finite() {
        return Ok(None);
    }
    let between = Se3::new(So3::identity(), Vec3::new(baseline_m, 0.0, 0.0));
    if rectified {
        return Ok(Some(between));
    }
    let rotation = |r: So3| Se3::new(r, Vec3::zeros());
    let (l, r) = (left.rectified_from_camera()?, right.rectified_from_camera()?);
    Ok(Some(rotation(l).inverse() * between * rotation(r)))
}
