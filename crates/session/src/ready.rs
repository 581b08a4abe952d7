//! Whether a way is ready to be walked back: the map is asked what the camera will see of it, stretch by stretch.

use cairn_atlas::{KeyFrame, LandmarkId, Snapshot};
use cairn_geometry::Se3;
use cairn_guide::{Facing, Ground, PlacedPoint, ReadyConfig, ReadyStretch, ready};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// Key frames within so many metres are asked for what they see: what was seen from farther off may be behind a wall.
const NEAR_M: f64 = 5.0;
/// A landmark is found again where it is seen within 60 degrees of how a key frame saw it (cosine), the limit that
/// tracking goes by.
const ALIKE: f64 = 0.5;

/// Looks at each stretch of a placed way as the camera will on the way back. Lengths of the map are multiplied by
/// `metres_per_unit`.
pub fn readiness(
    map: &Snapshot,
    camera: &RectifiedCamera,
    anchored: &[PlacedPoint],
    metres_per_unit: f64,
    ground: &Ground,
    facing: Facing,
) -> Vec<ReadyStretch> {
    let near = NEAR_M / metres_per_unit;
    ready(anchored, metres_per_unit, ground, facing, &ReadyConfig::default(), |pose| {
        landmarks_in_view(map, camera, pose, near)
    })
}

/// How many landmarks an eye at `world_from_camera` should find: inside the image, at a distance at which the detector
/// finds them, from a side from which a key frame within `near` (in units of the map) saw them.
pub fn landmarks_in_view(
    map: &Snapshot,
    camera: &RectifiedCamera,
    world_from_camera: &Se3,
    near: f64,
) -> usize {
    let camera_from_world = world_from_camera.inverse();
    let here = world_from_camera.translation;
    let mut found = BTreeSet::new();
    let close = |k: &&KeyFrame| (k.world_from_camera.translation - here).norm() <= near;
    for key_frame in map.key_frames().filter(close) {
        let from = key_frame.world_from_camera.translation;
        let sees = |id: &LandmarkId| {
            let l = map.landmark(*id)?;
            let seen = camera_from_world * l.position;
            let [u, v, _] = camera.project(&seen)?;
            let (ray, before) = (l.position - here, l.position - from);
            let distance = ray.norm();
            let alike = ray.dot(&before) >= ALIKE * distance * before.norm();
            let found = distance >= 0.8 * l.min_distance && distance <= 1.2 * l.max_distance;
            (camera.contains(u, v) && alike && found).then_some(*id)
        };
        found.extend(key_frame.landmarks.iter().flatten().filter_map(sees));
    }
    found.len()
}
