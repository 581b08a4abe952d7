//! Whether the depth of a landmark was seen, or only assumed.

use cairn_atlas::{KeyFrameId, Landmark, Snapshot};

/// Rays to a landmark that differ by more than this cosine (1.15 degrees) have parallax: the bound of triangulation.
const PARALLAX_COS: f64 = 0.9998;

/// Whether key frames older than `before` (all of them when `None`) see a landmark from directions that differ, so that its
/// depth follows from their places. What was seen while turning on the spot has a depth that was assumed.
pub fn has_parallax(snapshot: &Snapshot, landmark: &Landmark, before: Option<KeyFrameId>) -> bool {
    let counted = landmark.observations.iter().take_while(|o| before.is_none_or(|b| o.key_frame < b));
    let rays = counted.filter_map(|o| {
        let k = snapshot.key_frame(o.key_frame)?;
        (landmark.position - k.world_from_camera.translation).try_normalize(1e-12)
    });
    let mut first = None;
    for ray in rays {
        match first {
            None => first = Some(ray),
            Some(first) if ray.dot(&first) < PARALLAX_COS => return true,
            Some(_) => {}
        }
    }
    false
}
