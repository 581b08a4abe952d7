//! Whether a route is ready to be walked back: how many landmarks of the map the camera will see on each stretch.

use cairn_atlas::{KeyFrame, LandmarkId, Snapshot, Viewpoint};
use cairn_geometry::Se3;
use cairn_guide::{Facing, Ground, PlacedPoint, ReadyConfig, ReadyStretch, ready};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// Keyframes within this distance are considered: landmarks seen only from farther away may be behind a wall. Metres.
const NEAR_M: f64 = 5.0;

/// Checks each stretch of a resolved route with the views that the camera will have on the way back. Lengths of the map
/// are multiplied by `metres_per_unit`.
pub fn readiness(
    map: &Snapshot,
    camera: &RectifiedCamera,
    anchored: &[PlacedPoint],
    metres_per_unit: f64,
    ground: &Ground,
    facing: Facing,
    config: &ReadyConfig,
) -> Vec<ReadyStretch> {
    let near = NEAR_M / metres_per_unit;
    ready(anchored, metres_per_unit, ground, facing, config, |pose| {
        landmarks_in_view(map, camera, pose, near)
    })
}

/// How many landmarks a camera at `world_from_camera` should find: inside the image, at a distance at which the
/// detector finds them, and from a side from which a keyframe within `near` (in units of the map) saw them.
pub fn landmarks_in_view(
    map: &Snapshot,
    camera: &RectifiedCamera,
    world_from_camera: &Se3,
    near: f64,
) -> usize {
    let (viewpoint, here) = (Viewpoint::new(camera, world_from_camera), world_from_camera.translation);
    let mut found = BTreeSet::new();
    let close = |k: &&KeyFrame| (k.world_from_camera.translation - here).norm() <= near;
    for key_frame in map.key_frames().filter(close) {
        let from = key_frame.world_from_camera.translation;
        let sees = |id: &LandmarkId| {
            let l = map.landmark(*id)?;
            viewpoint.sees_along(l, &(l.position - from).normalize()).map(|_| *id)
        };
        found.extend(key_frame.landmarks.iter().flatten().filter_map(sees));
    }
    found.len()
}
