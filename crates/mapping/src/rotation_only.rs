//! Landmarks for a monocular camera that rotates on the spot. There is no parallax, so new features are matched by
//! rotation alone (the infinite homography; Hartley & Zisserman, section 13.4) and get the depth of the known
//! landmarks next to them. They constrain the orientation at once; their depth is found by bundle adjustment when
//! there is parallax.
use crate::insert::NewLandmarks;
use crate::triangulation::median_depth;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_vision::{RectifiedCamera, Target, consistent_rotation, search};

/// A key frame without depth that shows fewer landmarks than this share of its features needs new ones.
const FEW: f64 = 0.2;
/// Key frames searched, at most.
const NEIGHBOURS: usize = 3;
/// Largest Hamming distance of a match, bits.
const TIGHT: u32 = 50;
/// Ratio test: the best distance must be below this share of the second best.
const RATIO: f64 = 0.8;
/// Half the search window in pixels at the pyramid level.
const RADIUS: f64 = 5.0;
/// Ratio of baseline to depth up to which rotation alone predicts where a feature moves.
const ON_THE_SPOT: f64 = 0.02;

/// Creates landmarks of a key frame that shows too few of them while the camera rotates; `camera` is that of the atlas.
pub(crate) fn landmarks_by_rotation(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    centre: KeyFrameId,
    new_landmarks: &mut NewLandmarks,
) -> Vec<Change> {
    let Some(here) = snapshot.key_frame(centre) else { return Vec::new() };
    let mut matched: Vec<bool> = here.landmarks.iter().map(Option::is_some).collect();
    let few = (FEW * here.frame.len() as f64) as usize;
    let depths = known_depths(snapshot, here);
    let mut changes = Vec::new();
    if depths.len() < 5 {
        return changes;
    }
    let Some(median) = median_depth(snapshot, here) else { return changes };
    let before = here.covisible.iter().map(|(id, _)| *id).take(NEIGHBOURS);
    for id in before {
        if matched.iter().filter(|s| **s).count() >= few {
            break;
        }
        // Two views of a camera that turns are of one camera.
        let own = |k: &&KeyFrame| k.other_camera == here.other_camera;
        let Some(there) = snapshot.key_frame(id).filter(own) else { continue };
        let there_from_here = there.world_from_camera.inverse() * here.world_from_camera;
        if there_from_here.translation.norm() > ON_THE_SPOT * median {
            continue;
        }
        for (i, j) in match_by_rotation(snapshot, camera, here, there, &matched) {
            let z = depth_nearby(&depths, here.frame.px[i]).unwrap_or(median);
            let Some(landmark) = new_landmarks.id() else { return changes };
            matched[i] = true;
            changes.push(Change::AddLandmark(
                landmark,
                here.world_from_camera * camera.unproject(here.frame.px[i], z),
            ));
            changes.push(Change::Observe(landmark, centre, i as u16));
            changes.push(Change::Observe(landmark, id, j as u16));
        }
    }
    changes
}

/// Pixel and depth of each landmark that a key frame shows.
fn known_depths(snapshot: &Snapshot, k: &KeyFrame) -> Vec<([f32; 2], f64)> {
    let camera_from_world = k.world_from_camera.inverse();
    let depths = k.landmarks.iter().zip(&k.frame.px).filter_map(|(id, px)| {
        let z = (camera_from_world * snapshot.landmark((*id)?)?.position).z;
        (z > 0.0).then_some((*px, z))
    });
    depths.collect()
}

/// Median depth of the three landmarks nearest in the image.
fn depth_nearby(depths: &[([f32; 2], f64)], px: [f32; 2]) -> Option<f64> {
    let mut near: Vec<(f32, f64)> =
        depths.iter().map(|([x, y], z)| ((x - px[0]).hypot(y - px[1]), *z)).collect();
    if near.len() < 3 {
        return None;
    }
    near.select_nth_unstable_by(2, |a, b| a.0.total_cmp(&b.0));
    near[..3].sort_by(|a, b| a.1.total_cmp(&b.1));
    Some(near[1].1)
}

/// Pairs of unmatched features that lie where rotation alone predicts them and have matching descriptors.
fn match_by_rotation(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    here: &KeyFrame,
    there: &KeyFrame,
    matched: &[bool],
) -> Vec<(usize, usize)> {
    let octaves = snapshot.octaves();
    let rotation = there.world_from_camera.rotation.inverse() * here.world_from_camera.rotation;
    let mut owner: Vec<Option<(usize, u32)>> = vec![None; there.frame.len()];
    for i in (0..here.frame.len()).filter(|i| !matched[*i]) {
        let ray: Vec3 = rotation * camera.unproject(here.frame.px[i], 1.0);
        let Some([u, v, _]) = camera.project(&ray).filter(|[u, v, _]| camera.contains(*u, *v)) else {
            continue;
        };
        let level = here.frame.octave[i];
        let target = Target {
            pixel: [u as f32, v as f32],
            right_x: f32::NAN,
            radius: (RADIUS * octaves.scale(level)) as f32,
            octaves: [level.saturating_sub(1), level + 1],
            descriptor: &here.frame.descriptors[i],
        };
        let Some(found) = search(&there.frame, &target, |j| there.landmarks[j].is_none()) else { continue };
        let distinct = (found.distance as f64) < RATIO * found.second as f64;
        if found.distance <= TIGHT && distinct && owner[found.feature].is_none_or(|(_, d)| found.distance < d)
        {
            owner[found.feature] = Some((i, found.distance));
        }
    }
    let angle_changes = owner
        .iter()
        .enumerate()
        .filter_map(|(j, o)| o.map(|(i, _)| ((i, j), here.frame.angle[i] - there.frame.angle[j])));
    let mut matches = consistent_rotation(angle_changes.collect());
    matches.sort_unstable();
    matches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_nearby_is_the_median_of_the_three_nearest() {
        let at = |x: f32, z: f64| ([x, 0.0], z);
        let depths = [at(0.0, 9.0), at(1.0, 2.0), at(2.0, 3.0), at(3.0, 4.0), at(50.0, 1.0)];
        assert_eq!(depth_nearby(&depths, [2.0, 0.0]), Some(3.0));
        assert_eq!(depth_nearby(&depths, [0.0, 0.0]), Some(3.0));
        assert_eq!(depth_nearby(&depths, [60.0, 0.0]), Some(3.0));
        assert_eq!(depth_nearby(&depths[..2], [0.0, 0.0]), None);
    }
}
