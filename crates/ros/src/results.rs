//! From poses and maps to messages.

use crate::frames::{FrameTree, Tracked, Transforms, UNKNOWN};
use crate::messages::{
    Covariance6, DiagnosticArray, DiagnosticStatus, Header, KeyValue, Odometry, Path, PointCloud2,
    PointField, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped, TFMessage, TransformStamped,
    Twist, TwistWithCovariance, Vector3,
};
use cairn::atlas::MapId;
use cairn::geometry::{Camera, Pose as Framed, Se3, Vec3, World};
use cairn::session::anchor_in_map;
use cairn::{FramePose, Map, Output, Slam, Stamp};
use nalgebra::Matrix6;

/// Names of the frames of REP 105.
#[derive(Clone, Debug)]
pub struct FrameNames {
    /// The map.
    pub map: String,
    /// The odometry.
    pub odom: String,
    /// The robot.
    pub base: String,
}

/// What the tree of frames needs of an output; `None` without a pose.
pub fn tracked(output: &Output, gravity_aligned: bool) -> Option<Tracked> {
    let FramePose { anchored, odometry, covariance, scale, .. } = output.pose?;
    let world_from_camera = anchored.world_from_camera;
    let in_world: Framed<World, Camera> = Framed::new(world_from_camera);
    let odom_from_camera = odometry.world_from_odom.inverse().then(&in_world).se3;
    Some(Tracked {
        stamp: output.stamp,
        segment: odometry.segment,
        odom_from_camera,
        world_from_camera,
        scale: odometry.world_from_odom.sim3.scale,
        metric: scale.metric,
        gravity_aligned,
        covariance: covariance.unwrap_or_else(|| Matrix6::identity() * UNKNOWN),
    })
}

/// The transforms for /tf: map -> odom where the place in the map is known, and odom -> base where it is wanted.
pub fn tf(stamp: Stamp, names: &FrameNames, transforms: &Transforms, with_base: bool) -> TFMessage {
    let of = |parent: &str, child: &str, pose: &Se3| TransformStamped {
        header: Header::new(stamp, parent),
        child_frame_id: child.to_owned(),
        transform: pose.into(),
    };
    let mut out: Vec<TransformStamped> =
        transforms.map_from_odom.iter().map(|pose| of(&names.map, &names.odom, pose)).collect();
    if with_base {
        out.push(of(&names.odom, &names.base, &transforms.odom_from_base));
    }
    TFMessage { transforms: out }
}

/// The pose in the odometry frame, with the velocity since the frame before (`dt_s` ago) and the covariances of both.
pub fn odometry(stamp: Stamp, names: &FrameNames, transforms: &Transforms, dt_s: f64) -> Odometry {
    let rate = 1.0 / dt_s;
    let (motion, covariance) = match transforms.motion {
        Some(motion) if rate.is_finite() => (motion, transforms.motion_covariance * rate * rate),
        _ => (Se3::identity(), Matrix6::identity() * UNKNOWN),
    };
    let rate = if rate.is_finite() { rate } else { 0.0 };
    let twist = Twist {
        linear: Vector3::from(motion.translation * rate),
        angular: Vector3::from(motion.rotation.log() * rate),
    };
    Odometry {
        header: Header::new(stamp, &names.odom),
        child_frame_id: names.base.clone(),
        pose: with_covariance(&transforms.odom_from_base, &transforms.odom_covariance),
        twist: TwistWithCovariance { twist, covariance: rows(&covariance) },
    }
}

/// The pose in the map; `None` where the place in it is not known.
pub fn pose(stamp: Stamp, names: &FrameNames, transforms: &Transforms) -> Option<PoseWithCovarianceStamped> {
    let pose = with_covariance(&transforms.map_from_base()?, &transforms.map_covariance);
    Some(PoseWithCovarianceStamped { header: Header::new(stamp, &names.map), pose })
}

fn with_covariance(pose: &Se3, covariance: &Matrix6<f64>) -> PoseWithCovariance {
    PoseWithCovariance { pose: pose.into(), covariance: rows(covariance) }
}

/// Row by row.
fn rows(covariance: &Matrix6<f64>) -> Covariance6 {
    covariance.transpose().data.0
}

/// The key frames of a map in order of time, with all its corrections so far: as many poses as the map has key frames.
pub fn path(
    stamp: Stamp,
    names: &FrameNames,
    map: &Map,
    id: MapId,
    tree: &FrameTree,
    time: impl Fn(Stamp) -> Stamp,
) -> Path {
    let header = Header::new(stamp, &names.map);
    let Some(map_from_world) = tree.map_from_world() else { return Path { header, poses: Vec::new() } };
    let camera_from_base = tree.base_from_camera(map.is_metric(id)).inverse();
    let mut poses: Vec<(Stamp, Se3)> = map
        .key_frames(id)
        .map(|(k, _)| (k.stamp, tree.published(map_from_world * k.world_from_camera * camera_from_base)))
        .collect();
    poses.sort_by_key(|(stamp, _)| *stamp);
    let poses = poses
        .iter()
        .map(|(at, pose)| PoseStamped { header: Header::new(time(*at), &names.map), pose: pose.into() });
    Path { header, poses: poses.collect() }
}

/// The route at hand in the map: a path that Nav2's controllers can follow.
pub fn route(stamp: Stamp, names: &FrameNames, slam: &Slam, id: MapId, tree: &FrameTree) -> Option<Path> {
    let (route, map_from_world) = (slam.route()?, tree.map_from_world()?);
    let map = slam.map();
    let camera_from_base = tree.base_from_camera(map.is_metric(id)).inverse();
    let header = Header::new(stamp, &names.map);
    let placed = route.resolve(|anchor| anchor_in_map(map.snapshot(), anchor));
    let poses = placed.iter().map(|point| PoseStamped {
        header: header.clone(),
        pose: (&tree.published(map_from_world * point.frame_from_camera * camera_from_base)).into(),
    });
    let poses = poses.collect();
    Some(Path { header, poses })
}

/// The path to a goal; empty where there is none.
pub fn plan(stamp: Stamp, names: &FrameNames, path: &[Se3]) -> Path {
    let header = Header::new(stamp, &names.map);
    let poses = path.iter().map(|pose| PoseStamped { header: header.clone(), pose: pose.into() });
    Path { poses: poses.collect(), header }
}

/// The landmarks of a map.
pub fn points(stamp: Stamp, names: &FrameNames, map: &Map, id: MapId, tree: &FrameTree) -> PointCloud2 {
    let map_from_world = tree.map_from_world().unwrap_or_else(Se3::identity);
    let points = map.landmarks(id).map(|l| map_from_world * l.position);
    cloud(Header::new(stamp, &names.map), points)
}

fn cloud(header: Header, points: impl Iterator<Item = Vec3>) -> PointCloud2 {
    const FLOAT32: u8 = 7;
    const STEP: u32 = 12;
    let mut data = Vec::new();
    for point in points.filter(|p| p.iter().all(|v| v.is_finite())) {
        point.iter().for_each(|v| data.extend_from_slice(&(*v as f32).to_le_bytes()));
    }
    let width = (data.len() as u32) / STEP;
    let field =
        |(i, name): (u32, &str)| PointField { name: name.into(), offset: 4 * i, datatype: FLOAT32, count: 1 };
    PointCloud2 {
        header,
        height: 1,
        width,
        fields: (0..).zip(["x", "y", "z"]).map(field).collect(),
        is_bigendian: false,
        point_step: STEP,
        row_step: STEP * width,
        data,
        is_dense: true,
    }
}

/// One line of diagnostics with its numbers. Levels: 0 OK, 1 WARN, 2 ERROR.
pub fn diagnostics(
    stamp: Stamp,
    node: &str,
    level: u8,
    message: String,
    values: Vec<(String, String)>,
) -> DiagnosticArray {
    let values = values.into_iter().map(|(key, value)| KeyValue { key, value }).collect();
    let status = DiagnosticStatus {
        level,
        name: format!("{node}: SLAM"),
        message,
        hardware_id: "cairn".into(),
        values,
    };
    DiagnosticArray { header: Header::new(stamp, ""), status: vec![status] }
}
