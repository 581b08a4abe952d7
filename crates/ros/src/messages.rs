//! The messages of ROS 2 that the node reads and writes, field by field as in their `.msg` files.
//!
//! Serde writes them in CDR. Arrays longer than serde derives (36 numbers of a covariance) are nested, which has the same
//! bytes. Pixels are byte buffers, so that an image is copied at once and not byte by byte.

use cairn::Stamp;
use cairn::geometry::{Se3, So3, Vec3};
use serde::{Deserialize, Serialize};

/// A covariance of six, row by row: x, y, z, and the rotations about them.
pub type Covariance6 = [[f64; 6]; 6];

macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident { $($(#[$attr:meta])* $field:ident: $kind:ty,)* })*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct $name {
            $($(#[$attr])* #[allow(missing_docs)] pub $field: $kind,)*
        }
        impl ros2_client::Message for $name {}
    )*};
}

messages! {
    /// `builtin_interfaces/Time`.
    Time { sec: i32, nanosec: u32, }
    /// `std_msgs/Header`.
    Header { stamp: Time, frame_id: String, }
    /// `std_msgs/String`.
    Text { data: String, }
    /// `geometry_msgs/Point`, metres.
    Point { x: f64, y: f64, z: f64, }
    /// `geometry_msgs/Vector3`.
    Vector3 { x: f64, y: f64, z: f64, }
    /// `geometry_msgs/Quaternion`.
    Quaternion { x: f64, y: f64, z: f64, w: f64, }
    /// `geometry_msgs/Pose`.
    Pose { position: Point, orientation: Quaternion, }
    /// `geometry_msgs/PoseStamped`.
    PoseStamped { header: Header, pose: Pose, }
    /// `geometry_msgs/PoseWithCovariance`.
    PoseWithCovariance { pose: Pose, covariance: Covariance6, }
    /// `geometry_msgs/PoseWithCovarianceStamped`.
    PoseWithCovarianceStamped { header: Header, pose: PoseWithCovariance, }
    /// `geometry_msgs/Twist`, m/s and rad/s.
    Twist { linear: Vector3, angular: Vector3, }
    /// `geometry_msgs/TwistWithCovariance`.
    TwistWithCovariance { twist: Twist, covariance: Covariance6, }
    /// `geometry_msgs/Transform`: maps coordinates in the child frame to the parent's.
    Transform { translation: Vector3, rotation: Quaternion, }
    /// `geometry_msgs/TransformStamped`; the parent is the frame of the header.
    TransformStamped { header: Header, child_frame_id: String, transform: Transform, }
    /// `tf2_msgs/TFMessage`.
    TFMessage { transforms: Vec<TransformStamped>, }
    /// `nav_msgs/Odometry`.
    Odometry { header: Header, child_frame_id: String, pose: PoseWithCovariance, twist: TwistWithCovariance, }
    /// `nav_msgs/Path`.
    Path { header: Header, poses: Vec<PoseStamped>, }
    /// `nav_msgs/MapMetaData`; the origin is the corner of cell (0, 0).
    MapMetaData { map_load_time: Time, resolution: f32, width: u32, height: u32, origin: Pose, }
    /// `nav_msgs/OccupancyGrid`: 0 free to 100 occupied, -1 unknown, row of least y first.
    OccupancyGrid { header: Header, info: MapMetaData, data: Vec<i8>, }
    /// `sensor_msgs/Image`.
    Image {
        header: Header,
        height: u32,
        width: u32,
        encoding: String,
        is_bigendian: u8,
        step: u32,
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// `sensor_msgs/CompressedImage`.
    CompressedImage {
        header: Header,
        format: String,
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// `sensor_msgs/RegionOfInterest`.
    RegionOfInterest { x_offset: u32, y_offset: u32, height: u32, width: u32, do_rectify: bool, }
    /// `sensor_msgs/CameraInfo`.
    CameraInfo {
        header: Header,
        height: u32,
        width: u32,
        distortion_model: String,
        d: Vec<f64>,
        k: [f64; 9],
        r: [f64; 9],
        p: [f64; 12],
        binning_x: u32,
        binning_y: u32,
        roi: RegionOfInterest,
    }
    /// `sensor_msgs/Imu`: rad/s and m/s^2.
    Imu {
        header: Header,
        orientation: Quaternion,
        orientation_covariance: [f64; 9],
        angular_velocity: Vector3,
        angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3,
        linear_acceleration_covariance: [f64; 9],
    }
    /// `sensor_msgs/PointField`.
    PointField { name: String, offset: u32, datatype: u8, count: u32, }
    /// `sensor_msgs/PointCloud2`.
    PointCloud2 {
        header: Header,
        height: u32,
        width: u32,
        fields: Vec<PointField>,
        is_bigendian: bool,
        point_step: u32,
        row_step: u32,
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
        is_dense: bool,
    }
    /// `rosgraph_msgs/Clock`.
    Clock { clock: Time, }
    /// `std_msgs/ColorRGBA`, 0 to 1.
    Color { r: f32, g: f32, b: f32, a: f32, }
    /// `visualization_msgs/UVCoordinate`.
    UvCoordinate { u: f32, v: f32, }
    /// `visualization_msgs/MeshFile`.
    MeshFile { filename: String, data: Vec<u8>, }
    /// `visualization_msgs/Marker` of Humble and later.
    Marker {
        header: Header,
        ns: String,
        id: i32,
        kind: i32,
        action: i32,
        pose: Pose,
        scale: Vector3,
        color: Color,
        lifetime: Time,
        frame_locked: bool,
        points: Vec<Point>,
        colors: Vec<Color>,
        texture_resource: String,
        texture: CompressedImage,
        uv_coordinates: Vec<UvCoordinate>,
        text: String,
        mesh_resource: String,
        mesh_file: MeshFile,
        mesh_use_embedded_materials: bool,
    }
    /// `visualization_msgs/MarkerArray`.
    MarkerArray { markers: Vec<Marker>, }
    /// `diagnostic_msgs/KeyValue`.
    KeyValue { key: String, value: String, }
    /// `diagnostic_msgs/DiagnosticStatus`; the level is 0 OK, 1 WARN, 2 ERROR, 3 STALE.
    DiagnosticStatus { level: u8, name: String, message: String, hardware_id: String, values: Vec<KeyValue>, }
    /// `diagnostic_msgs/DiagnosticArray`.
    DiagnosticArray { header: Header, status: Vec<DiagnosticStatus>, }
    /// `std_srvs/Trigger` and `std_srvs/Empty`, request. ROS 2 gives a message without fields this one.
    TriggerRequest { structure_needs_at_least_one_member: u8, }
    /// `std_srvs/Trigger`, response.
    TriggerResponse { success: bool, message: String, }
}

impl Time {
    /// Of a stamp; seconds outside 32 bits are clamped.
    pub fn of(stamp: Stamp) -> Self {
        const SECOND: i64 = 1_000_000_000;
        let sec = stamp.0.div_euclid(SECOND).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        Self { sec: sec as i32, nanosec: stamp.0.rem_euclid(SECOND) as u32 }
    }

    /// As a stamp.
    pub fn stamp(&self) -> Stamp {
        Stamp(i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec))
    }
}

impl Header {
    /// At a time, in a frame.
    pub fn new(stamp: Stamp, frame_id: &str) -> Self {
        Self { stamp: Time::of(stamp), frame_id: frame_id.to_owned() }
    }
}

impl From<Vec3> for Point {
    fn from(v: Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vec3> for Vector3 {
    fn from(v: Vec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl Vector3 {
    /// As a vector.
    pub fn vector(&self) -> Vec3 {
        Vec3::new(self.x, self.y, self.z)
    }
}

impl From<&So3> for Quaternion {
    fn from(rotation: &So3) -> Self {
        let q = rotation.quaternion().coords;
        Self { x: q.x, y: q.y, z: q.z, w: q.w }
    }
}

impl From<&Se3> for Pose {
    fn from(pose: &Se3) -> Self {
        Self { position: pose.translation.into(), orientation: (&pose.rotation).into() }
    }
}

impl From<&Se3> for Transform {
    fn from(pose: &Se3) -> Self {
        Self { translation: pose.translation.into(), rotation: (&pose.rotation).into() }
    }
}

impl Quaternion {
    /// As a rotation; `None` where it is none.
    fn so3(&self) -> Option<So3> {
        let norm = (self.x * self.x + self.y * self.y + self.z * self.z + self.w * self.w).sqrt();
        So3::from_xyzw(self.x, self.y, self.z, self.w).filter(|_| (norm - 1.0).abs() < 1e-2)
    }
}

impl Pose {
    /// As a rigid transform; `None` where a number is not finite or the quaternion is not a rotation's.
    pub fn se3(&self) -> Option<Se3> {
        let Point { x, y, z } = self.position;
        Some(Se3::new(self.orientation.so3()?, Vec3::new(x, y, z))).filter(Se3::is_finite)
    }
}

impl Transform {
    /// As [`Pose::se3`].
    pub fn se3(&self) -> Option<Se3> {
        Some(Se3::new(self.rotation.so3()?, self.translation.vector())).filter(Se3::is_finite)
    }
}
