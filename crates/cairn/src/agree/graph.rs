//! The pose graph of a robot's saved map.
//!
//! In: a map that a robot made. Out: its key frames, and how they lie to each other as the map's adjustment left them, each
//! relation with the information of the landmarks that both show ([`super::information`]) and of the depth that was aligned
//! between them.

use super::information;
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, RobotId, Snapshot};
use cairn_geometry::Se3;
use cairn_team::{Measurement, PoseId, RobotGraph};
use cairn_vision::RectifiedCamera;
use nalgebra::Matrix6;
use std::collections::{BTreeMap, BTreeSet};

/// Covisible earlier key frames that each is related to, at most: those that share most landmarks; beside its parent, loops and depth.
const COVISIBLE: usize = 2;
/// Fewer shared landmarks relate no two key frames, unless one follows the other.
const LEAST_SHARED: u32 = 20;
/// What is known of a key frame relative to an earlier one without a landmark: standard deviations of its position, metres, and as a share of the
/// distance, and of its orientation, radians.
const COASTING: [f64; 3] = [0.05, 0.1, 0.1];

/// Why no pose graph is made of a map.
#[derive(Debug, thiserror::Error)]
pub enum MapGraphError {
    /// Robots agree on lengths in metres.
    #[error("none of its maps has metres")]
    NoMetres,
    /// Something of another robot is in it.
    #[error("it holds key frames of robot {0}")]
    OtherRobot(RobotId),
}

/// The pose of a key frame of a robot in the graph of its team.
pub(super) fn pose_id(snapshot: &Snapshot, id: KeyFrameId) -> PoseId {
    let name = snapshot.key_frame_name(id);
    PoseId { robot: name.robot, seq: name.seq }
}

/// The greatest map with metres of a file, alone.
pub(super) fn greatest_metric(mut file: MapFile) -> Result<MapFile, MapGraphError> {
    let camera = file.about.camera;
    let metric = file.snapshot.maps().map(|(map, _)| map);
    let metric = metric.filter(|map| file.snapshot.is_metric_in(*map, &camera));
    let size = |map: &MapId| (file.snapshot.key_frames_of(*map).count(), std::cmp::Reverse(*map));
    let greatest = metric.max_by_key(size).ok_or(MapGraphError::NoMetres)?;
    file.snapshot = file.snapshot.without_maps(|map| map != greatest);
    Ok(file)
}

/// The pose graph of the greatest map with metres in a file, all of whose key frames are of this robot. Poses are those of
/// the (rectified) camera, numbered as the key frames are.
///
/// # Errors
/// [`MapGraphError`].
pub fn graph_of_map(robot: RobotId, file: &MapFile) -> Result<RobotGraph<Se3, 6>, MapGraphError> {
    let file = greatest_metric(file.clone())?;
    if let Some(other) = file.snapshot.robots().into_keys().find(|other| *other != robot) {
        return Err(MapGraphError::OtherRobot(other));
    }
    Ok(graph_of(robot, &file))
}

/// The same of a file with one map.
pub(super) fn graph_of(robot: RobotId, file: &MapFile) -> RobotGraph<Se3, 6> {
    let (snapshot, camera) = (&file.snapshot, &file.about.camera);
    let all: Vec<&KeyFrame> = snapshot.key_frames().collect();
    let poses = all.iter().map(|k| (pose_id(snapshot, k.id).seq, k.world_from_camera)).collect();
    let mut measurements = Vec::new();
    for (n, k) in all.iter().enumerate() {
        let before = n.checked_sub(1).map(|n| all[n].id);
        for (earlier, information) in relations(snapshot, camera, k, before) {
            let Some(from) = snapshot.key_frame(earlier) else { continue };
            measurements.push(Measurement {
                a: pose_id(snapshot, earlier),
                b: pose_id(snapshot, k.id),
                a_from_b: from.world_from_camera.inverse() * k.world_from_camera,
                information,
            });
        }
    }
    RobotGraph { robot, poses, measurements }
}

/// The earlier key frames that one is related to, with the information of each relation.
fn relations(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    k: &KeyFrame,
    before: Option<KeyFrameId>,
) -> BTreeMap<KeyFrameId, Matrix6<f64>> {
    let earlier = |id: &KeyFrameId| *id < k.id && snapshot.key_frame(*id).is_some();
    let strong = k.covisible.iter().filter(|(id, n)| earlier(id) && *n >= LEAST_SHARED).take(COVISIBLE);
    let mut to: BTreeSet<KeyFrameId> = strong.map(|(id, _)| *id).collect();
    to.extend(k.parent.into_iter().chain(k.links.iter().copied()).chain(before).filter(earlier));
    let by_landmarks = |id| (id, information::by_landmarks(snapshot, camera, id, k.id));
    let mut related: BTreeMap<KeyFrameId, Matrix6<f64>> = to.into_iter().map(by_landmarks).collect();
    for measured in k.relative_poses.iter().filter(|measured| earlier(&measured.from)) {
        *related.entry(measured.from).or_default() += measured.in_map(k.unit).information;
    }
    // A wall or a few landmarks leave directions open; where others eliminate one of both, its relations must determine the other.
    related.iter_mut().for_each(|(id, information)| *information += coasting(snapshot, *id, k));
    related
}

/// What is known of a key frame relative to an earlier one without a landmark, which is little beside what landmarks tell.
fn coasting(snapshot: &Snapshot, earlier: KeyFrameId, k: &KeyFrame) -> Matrix6<f64> {
    let from = snapshot.key_frame(earlier).map_or(k.world_from_camera, |from| from.world_from_camera);
    let distance = (from.translation - k.world_from_camera.translation).norm();
    let [metres, share, radians] = COASTING;
    let (along, turned) = ((metres + share * distance).powi(-2), radians.powi(-2));
    Matrix6::from_diagonal(&[along, along, along, turned, turned, turned].into())
}
