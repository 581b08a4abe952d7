//! The supported ROS messages, with the fields that are used. `sensor_msgs`, `geometry_msgs` and `tf2_msgs` have the
//! same layout in ROS 1 and ROS 2; [`Wire`] handles the difference in serialisation.

use crate::error::DecodeError;
use crate::protobuf::{Field, fields, stamp_ns, text};
use crate::wire::{Header, Wire, WireFormat};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{DepthImage, ImuSample, Stamp};

/// Kind of a message, independent of its schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageKind {
    /// Raw pixels: `sensor_msgs/Image`, Foxglove's `RawImage`.
    Image,
    /// An encoded image file: `CompressedImage` of ROS or Foxglove.
    CompressedImage,
    /// A calibration: `sensor_msgs/CameraInfo`, Foxglove's `CameraCalibration`.
    CameraInfo,
    /// `sensor_msgs/Imu`.
    Imu,
    /// Any other type.
    Other,
}

impl MessageKind {
    /// From the name of the type, such as `sensor_msgs/Image` or `foxglove.RawImage`.
    pub fn of(kind: &str) -> Self {
        match kind {
            "sensor_msgs/Image" | "foxglove_msgs/RawImage" | "foxglove.RawImage" => Self::Image,
            "sensor_msgs/CompressedImage" | "foxglove_msgs/CompressedImage" | "foxglove.CompressedImage" => {
                Self::CompressedImage
            }
            "sensor_msgs/CameraInfo" | "foxglove_msgs/CameraCalibration" | "foxglove.CameraCalibration" => {
                Self::CameraInfo
            }
            "sensor_msgs/Imu" => Self::Imu,
            _ => Self::Other,
        }
    }
}

/// Whether a type is one of Foxglove's in ROS 2 form.
pub(crate) fn is_foxglove(kind: &str) -> bool {
    kind.starts_with("foxglove_msgs/")
}

/// A `sensor_msgs/Image`.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageMessage<'a> {
    /// Time and frame.
    pub header: Header,
    /// Number of rows.
    pub height: u32,
    /// Number of columns.
    pub width: u32,
    /// Name of the pixel format, such as `mono8`.
    pub encoding: String,
    /// Byte order of 16-bit and 32-bit pixels.
    pub big_endian: bool,
    /// Bytes from the start of one row to the next.
    pub step: u32,
    /// The rows.
    pub data: &'a [u8],
}

impl<'a> ImageMessage<'a> {
    /// Decodes a message.
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn decode(format: WireFormat, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut wire = Wire::new(format, bytes)?;
        Ok(Self {
            header: wire.header()?,
            height: wire.u32()?,
            width: wire.u32()?,
            encoding: wire.string()?,
            big_endian: wire.u8()? != 0,
            step: wire.u32()?,
            data: wire.bytes()?,
        })
    }

    /// Decodes a message of any type with kind [`MessageKind::Image`].
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn of(kind: &str, format: WireFormat, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut out = Self {
            header: Header { stamp_ns: 0, frame_id: String::new() },
            height: 0,
            width: 0,
            encoding: String::new(),
            big_endian: false,
            step: 0,
            data: &[],
        };
        if format == WireFormat::Protobuf {
            for (number, field) in fields(bytes)? {
                match (number, field) {
                    (1, Field::Bytes(b)) => out.header.stamp_ns = stamp_ns(b).unwrap_or(0),
                    (2, Field::Number(v)) => out.width = v as u32,
                    (3, Field::Number(v)) => out.height = v as u32,
                    (4, Field::Bytes(b)) => out.encoding = text(b),
                    (5, Field::Number(v)) => out.step = v as u32,
                    (6, Field::Bytes(b)) => out.data = b,
                    (7, Field::Bytes(b)) => out.header.frame_id = text(b),
                    _ => {}
                }
            }
            return Ok(out);
        }
        if !is_foxglove(kind) {
            return Self::decode(format, bytes);
        }
        let mut wire = Wire::new(format, bytes)?;
        out.header = wire.header()?;
        (out.width, out.height, out.encoding) = (wire.u32()?, wire.u32()?, wire.string()?);
        (out.step, out.data) = (wire.u32()?, wire.bytes()?);
        Ok(out)
    }
}

/// Bytes before the data of `compressed_depth_image_transport`.
const HEAD: usize = 12;

/// A `sensor_msgs/CompressedImage`.
#[derive(Clone, Debug, PartialEq)]
pub struct CompressedImage<'a> {
    /// Time and frame.
    pub header: Header,
    /// Name of the format, such as `jpeg` or `mono8; jpeg compressed`.
    pub format: String,
    /// The encoded image.
    pub data: &'a [u8],
}

impl<'a> CompressedImage<'a> {
    /// Decodes a message.
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn decode(format: WireFormat, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut wire = Wire::new(format, bytes)?;
        Ok(Self { header: wire.header()?, format: wire.string()?, data: wire.bytes()? })
    }

    /// Decodes a message of any type with kind [`MessageKind::CompressedImage`].
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn of(kind: &str, format: WireFormat, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let header = Header { stamp_ns: 0, frame_id: String::new() };
        let mut out = Self { header, format: String::new(), data: &[] };
        if format == WireFormat::Protobuf {
            for (number, field) in fields(bytes)? {
                match (number, field) {
                    (1, Field::Bytes(b)) => out.header.stamp_ns = stamp_ns(b).unwrap_or(0),
                    (2, Field::Bytes(b)) => out.data = b,
                    (3, Field::Bytes(b)) => out.format = text(b),
                    (4, Field::Bytes(b)) => out.header.frame_id = text(b),
                    _ => {}
                }
            }
            return Ok(out);
        }
        if !is_foxglove(kind) {
            return Self::decode(format, bytes);
        }
        let mut wire = Wire::new(format, bytes)?;
        (out.header, out.data, out.format) = (wire.header()?, wire.bytes()?, wire.string()?);
        Ok(out)
    }

    /// The image file itself: messages of `compressed_depth_image_transport` have a header of 12 bytes before the PNG.
    ///
    /// # Errors
    /// When the depth was compressed in another way.
    pub fn file(&self) -> Result<&'a [u8], DecodeError> {
        if !self.format.contains("compressedDepth") {
            return Ok(self.data);
        }
        match self.data.get(HEAD..) {
            Some(png) if png.starts_with(b"\x89PNG") => Ok(png),
            _ => {
                let why =
                    format!("depth compressed as \"{}\" is not read, only that as PNG or RVL", self.format);
                Err(DecodeError::new(why))
            }
        }
    }

    /// The depth image where it is packed as RVL, which is no file: to be made depth by [`Self::dequantise`].
    ///
    /// # Errors
    /// When it is damaged.
    pub fn rvl(&self) -> Option<Result<DepthImage, DecodeError>> {
        let is_rvl = self.format.contains("compressedDepth") && self.format.ends_with("rvl");
        is_rvl.then(|| crate::rvl::depth(self.data.get(HEAD..).unwrap_or_default()))
    }

    /// Makes what [`Self::file`] or [`Self::rvl`] holds depth in the unit of the topic. `compressed_depth_image_transport` writes metres as 16 bits
    /// `v` with two numbers in the header, `z = a / (v - b)`, and zero where nothing was measured: they become millimetres.
    pub fn dequantise(&self, depth: &mut DepthImage) {
        let number = |at: usize| Some(f32::from_le_bytes(*self.data.get(at..)?.first_chunk()?));
        let is_metres = self.format.contains("compressedDepth") && self.format.starts_with("32FC1");
        if let (true, Some(a), Some(b)) = (is_metres, number(4), number(8)) {
            let measured = depth.data_mut().iter_mut().filter(|v| **v != 0);
            measured.for_each(|v| *v = millimetres(a / (f32::from(*v) - b)));
        }
    }
}

/// A `sensor_msgs/Imu`.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuMessage {
    /// Time and frame.
    pub header: Header,
    /// Angular velocity, rad/s.
    pub gyro: Vec3,
    /// Specific force, m/s^2.
    pub accel: Vec3,
}

impl ImuMessage {
    /// Decodes a message.
    ///
    /// # Errors
    /// When the message is truncated or its encoding is not supported.
    pub fn decode(format: WireFormat, bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut wire = Wire::new(format, bytes)?;
        let header = wire.header()?;
        wire.f64s::<13>()?; // orientation and its covariance
        let gyro = wire.f64s::<3>()?;
        wire.f64s::<9>()?;
        let accel = wire.f64s::<3>()?;
        Ok(Self { header, gyro: gyro.into(), accel: accel.into() })
    }

    /// Converts to a sample with this stamp.
    pub fn sample(&self, stamp_ns: i64) -> ImuSample {
        ImuSample::new(Stamp(stamp_ns), self.gyro, self.accel)
    }
}

/// A `geometry_msgs/TransformStamped`.
#[derive(Clone, Debug, PartialEq)]
pub struct TransformStamped {
    /// The frame it maps to.
    pub parent: String,
    /// The frame it maps from.
    pub child: String,
    /// Maps coordinates in the child to coordinates in the parent.
    pub parent_from_child: Se3,
}

/// The transforms of a `tf2_msgs/TFMessage` (or `tf/tfMessage`).
///
/// # Errors
/// When the message is truncated, its encoding is not supported, or a rotation is invalid.
pub fn static_transforms(format: WireFormat, bytes: &[u8]) -> Result<Vec<TransformStamped>, DecodeError> {
    let mut wire = Wire::new(format, bytes)?;
    let n = wire.length(60)?;
    let mut out = Vec::new();
    for _ in 0..n {
        let (header, child) = (wire.header()?, wire.string()?);
        // In ROS 1, tf frame names began with a slash.
        let name = |text: &str| text.trim_start_matches('/').to_owned();
        let parent_from_child = pose(&mut wire)?;
        out.push(TransformStamped { parent: name(&header.frame_id), child: name(&child), parent_from_child });
    }
    Ok(out)
}

/// A `geometry_msgs/Transform`.
///
/// # Errors
/// When the message is truncated, its encoding is not supported, or the rotation is invalid.
pub fn transform(format: WireFormat, bytes: &[u8]) -> Result<Se3, DecodeError> {
    pose(&mut Wire::new(format, bytes)?)
}

/// The pose of a `geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped` or `TransformStamped`, or a `nav_msgs/Odometry`: parent
/// from child, with the time of the header in nanoseconds.
///
/// # Errors
/// When the type is another, the message is truncated, its encoding is not supported, or the rotation is invalid.
pub fn stamped_pose(kind: &str, format: WireFormat, bytes: &[u8]) -> Result<(i64, Se3), DecodeError> {
    let mut wire = Wire::new(format, bytes)?;
    let header = wire.header()?;
    match kind {
        "geometry_msgs/PoseStamped" | "geometry_msgs/PoseWithCovarianceStamped" => {}
        "geometry_msgs/TransformStamped" | "nav_msgs/Odometry" => {
            wire.string()?; // the child's name
        }
        other => {
            return Err(DecodeError::new(format!(
                "{other} is no pose that is read; known are geometry_msgs PoseStamped, PoseWithCovarianceStamped and \
                 TransformStamped, and nav_msgs Odometry"
            )));
        }
    }
    Ok((header.stamp_ns, pose(&mut wire)?))
}

fn pose(wire: &mut Wire) -> Result<Se3, DecodeError> {
    let [tx, ty, tz] = wire.f64s::<3>()?;
    let [x, y, z, w] = wire.f64s::<4>()?;
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    let rotation = So3::from_xyzw(x, y, z, w).filter(|_| (norm - 1.0).abs() < 1e-2);
    let rotation = rotation.ok_or_else(|| {
        DecodeError::new(format!("the quaternion ({x}, {y}, {z}, {w}) has the norm {norm}, a rotation has 1"))
    })?;
    let out = Se3::new(rotation, Vec3::new(tx, ty, tz));
    if out.is_finite() { Ok(out) } else { Err(DecodeError::new("a transform that is not finite")) }
}

/// A `std_msgs/Float32`.
///
/// # Errors
/// When the message is truncated or its encoding is not supported.
pub fn float32(format: WireFormat, bytes: &[u8]) -> Result<f32, DecodeError> {
    Wire::new(format, bytes)?.f32()
}

/// A `std_msgs/String`.
///
/// # Errors
/// When the message is truncated or its encoding is not supported.
pub fn string(format: WireFormat, bytes: &[u8]) -> Result<String, DecodeError> {
    Wire::new(format, bytes)?.string()
}

/// A `diagnostic_msgs/KeyValue`.
///
/// # Errors
/// When the message is truncated or its encoding is not supported.
pub fn key_value(format: WireFormat, bytes: &[u8]) -> Result<(String, String), DecodeError> {
    let mut wire = Wire::new(format, bytes)?;
    Ok((wire.string()?, wire.string()?))
}

/// Metres in millimetres; 0, no measurement, for any value that is not a positive number below 65.5 m.
pub(crate) fn millimetres(metres: f32) -> u16 {
    let mm = (metres * 1000.0).round();
    if mm > 0.0 && mm <= f32::from(u16::MAX) { mm as u16 } else { 0 }
}
