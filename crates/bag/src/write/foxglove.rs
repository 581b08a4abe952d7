//! Messages of Foxglove's schemas in their ROS 2 form (docs.foxglove.dev/docs/visualization/message-schemas): Foxglove
//! displays them, and every tool that reads ROS 2 recordings can decode them with the definition in the file.

use super::cdr::CdrWriter;
use cairn_geometry::{Se3, Vec2, Vec3};
use cairn_sensor::{Camera, Distortion, GrayImage};

/// A message type: its name and its definition, with those of its parts.
#[derive(Clone, Copy, Debug)]
pub struct Schema {
    /// The name, such as `foxglove_msgs/msg/PoseInFrame`.
    pub name: &'static str,
    fields: &'static str,
    parts: &'static [(&'static str, &'static str)],
}

impl Schema {
    /// The definition in the form that files contain.
    pub fn text(&self) -> String {
        let mut text = self.fields.to_owned();
        for (name, fields) in self.parts {
            text += &format!("{}\nMSG: {name}\n{fields}", "=".repeat(80));
        }
        text
    }
}

const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const QUATERNION: (&str, &str) = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");
const POSE: (&str, &str) =
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n");

/// A pose in a frame, with a time.
pub const POSE_IN_FRAME: Schema = Schema {
    name: "foxglove_msgs/msg/PoseInFrame",
    fields: "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n",
    parts: &[TIME, POSE, POINT, QUATERNION],
};

/// A sequence of poses (a path).
pub const POSES_IN_FRAME: Schema = Schema {
    name: "foxglove_msgs/msg/PosesInFrame",
    fields: "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose[] poses\n",
    parts: &[TIME, POSE, POINT, QUATERNION],
};

/// The transform between two frames.
pub const FRAME_TRANSFORM: Schema = Schema {
    name: "foxglove_msgs/msg/FrameTransform",
    fields: "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n\
             geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    parts: &[TIME, VECTOR, QUATERNION],
};

/// A point cloud.
pub const POINT_CLOUD: Schema = Schema {
    name: "foxglove_msgs/msg/PointCloud",
    fields: "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\nuint32 point_stride\n\
             foxglove_msgs/PackedElementField[] fields\nuint8[] data\n",
    parts: &[
        TIME,
        POSE,
        POINT,
        QUATERNION,
        (
            "foxglove_msgs/PackedElementField",
            "uint8 UNKNOWN=0\nuint8 UINT8=1\nuint8 INT8=2\nuint8 UINT16=3\nuint8 INT16=4\nuint8 UINT32=5\n\
             uint8 INT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 type\n",
        ),
    ],
};

/// A line of text.
pub const LOG: Schema = Schema {
    name: "foxglove_msgs/msg/Log",
    fields: "uint8 UNKNOWN=0\nuint8 DEBUG=1\nuint8 INFO=2\nuint8 WARNING=3\nuint8 ERROR=4\nuint8 FATAL=5\n\
             builtin_interfaces/Time timestamp\nuint8 level\nstring message\nstring name\nstring file\nuint32 line\n",
    parts: &[TIME],
};

/// An image.
pub const RAW_IMAGE: Schema = Schema {
    name: "foxglove_msgs/msg/RawImage",
    fields: "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\nstring encoding\n\
             uint32 step\nuint8[] data\n",
    parts: &[TIME],
};

/// The calibration of a camera.
pub const CAMERA_CALIBRATION: Schema = Schema {
    name: "foxglove_msgs/msg/CameraCalibration",
    fields: "builtin_interfaces/Time timestamp\nstring frame_id\nuint32 width\nuint32 height\n\
             string distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n",
    parts: &[TIME],
};

const COLOR: (&str, &str) = ("foxglove_msgs/Color", "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n");
const POINT2: (&str, &str) = ("foxglove_msgs/Point2", "float64 x\nfloat64 y\n");

/// Annotations drawn over an image.
pub const IMAGE_ANNOTATIONS: Schema = Schema {
    name: "foxglove_msgs/msg/ImageAnnotations",
    fields: "foxglove_msgs/CircleAnnotation[] circles\nfoxglove_msgs/PointsAnnotation[] points\n\
             foxglove_msgs/TextAnnotation[] texts\n",
    parts: &[
        (
            "foxglove_msgs/CircleAnnotation",
            "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nfloat64 diameter\nfloat64 thickness\n\
             foxglove_msgs/Color fill_color\nfoxglove_msgs/Color outline_color\n",
        ),
        (
            "foxglove_msgs/PointsAnnotation",
            "uint8 UNKNOWN=0\nuint8 POINTS=1\nuint8 LINE_LOOP=2\nuint8 LINE_STRIP=3\nuint8 LINE_LIST=4\n\
             builtin_interfaces/Time timestamp\nuint8 type\nfoxglove_msgs/Point2[] points\n\
             foxglove_msgs/Color outline_color\nfoxglove_msgs/Color[] outline_colors\n\
             foxglove_msgs/Color fill_color\nfloat64 thickness\n",
        ),
        (
            "foxglove_msgs/TextAnnotation",
            "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nstring text\nfloat64 font_size\n\
             foxglove_msgs/Color text_color\nfoxglove_msgs/Color background_color\n",
        ),
        COLOR,
        POINT2,
        TIME,
    ],
};

/// Severity of a log message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Information.
    Info = 2,
    /// A warning.
    Warning = 3,
}

/// A [`POSE_IN_FRAME`].
pub fn pose_in_frame(stamp_ns: i64, frame: &str, pose: &Se3) -> Vec<u8> {
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(frame).pose(pose);
    to.end()
}

/// A [`POSES_IN_FRAME`].
pub fn poses_in_frame(stamp_ns: i64, frame: &str, poses: &[Se3]) -> Vec<u8> {
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(frame).length(poses.len());
    poses.iter().for_each(|pose| {
        to.pose(pose);
    });
    to.end()
}

/// A [`FRAME_TRANSFORM`].
pub fn frame_transform(stamp_ns: i64, parent: &str, child: &str, parent_from_child: &Se3) -> Vec<u8> {
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(parent).string(child).pose(parent_from_child);
    to.end()
}

/// A [`POINT_CLOUD`], in metres, with three 32-bit floats per point.
pub fn point_cloud(stamp_ns: i64, frame: &str, points: impl IntoIterator<Item = Vec3>) -> Vec<u8> {
    const FLOAT32: u8 = 7;
    let mut data = Vec::new();
    for p in points {
        p.iter().for_each(|v| data.extend_from_slice(&(*v as f32).to_le_bytes()));
    }
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(frame).pose(&Se3::identity()).u32(12).length(3);
    for (name, offset) in [("x", 0), ("y", 4), ("z", 8)] {
        to.string(name).u32(offset).u8(FLOAT32);
    }
    to.bytes(&data);
    to.end()
}

/// A [`LOG`].
pub fn log(stamp_ns: i64, level: Level, name: &str, message: &str) -> Vec<u8> {
    let mut to = CdrWriter::new();
    to.time(stamp_ns).u8(level as u8).string(message).string(name).string("").u32(0);
    to.end()
}

/// A [`RAW_IMAGE`] of luminance.
pub fn raw_image(stamp_ns: i64, frame: &str, image: &GrayImage) -> Vec<u8> {
    let (w, h) = (image.width() as u32, image.height() as u32);
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(frame).u32(w).u32(h).string("mono8").u32(w).bytes(image.data());
    to.end()
}

/// A [`CAMERA_CALIBRATION`] of raw images; `None` for a lens that Foxglove has no model of.
pub fn camera_calibration(stamp_ns: i64, frame: &str, camera: &Camera) -> Option<Vec<u8>> {
    let model = match camera.distortion {
        Distortion::None | Distortion::RadialTangential(_) => "plumb_bob",
        Distortion::Rational(_) => "rational_polynomial",
        Distortion::Equidistant(_) => "kannala_brandt",
        _ => return None,
    };
    let Camera { width, height, fx, fy, cx, cy, .. } = *camera;
    let d = camera.distortion.coefficients();
    let d = if d.is_empty() { vec![0.0; 5] } else { d };
    let mut to = CdrWriter::new();
    to.time(stamp_ns).string(frame).u32(width as u32).u32(height as u32).string(model).length(d.len());
    let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    d.iter().chain(&k).chain(&r).chain(&p).for_each(|v| {
        to.f64(*v);
    });
    Some(to.end())
}

/// An [`IMAGE_ANNOTATIONS`] of green points, in pixels; pixel centres are at integers.
pub fn image_points(stamp_ns: i64, points: &[Vec2]) -> Vec<u8> {
    const POINTS: u8 = 1;
    const GREEN: [f64; 4] = [0.1, 0.9, 0.2, 1.0];
    let mut to = CdrWriter::new();
    to.length(0).length(1).time(stamp_ns).u8(POINTS).length(points.len());
    points.iter().for_each(|p| {
        // In Foxglove the origin is the corner of the first pixel.
        to.f64(p.x + 0.5).f64(p.y + 0.5);
    });
    let color = |to: &mut CdrWriter| {
        GREEN.iter().for_each(|v| {
            to.f64(*v);
        });
    };
    color(&mut to);
    to.length(0);
    color(&mut to);
    to.f64(3.0).length(0);
    to.end()
}
