//! Lengths that a joined map keeps while it is adjusted.
//!
//! The scales of both maps were weighed before (`scales.rs`). In an adjustment the features of all key frames would set them anew, each as if it
//! erred by itself, though all disparities of a camera err alike: by half a percent where images are small. Where depth relates the key frames of
//! one map and not those of the other, as with a stereo pair, the lengths of the first are known better than that, and the joined map keeps them.

use cairn_atlas::{Change, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Vec3, umeyama};

/// The changes by which a joined map has the lengths again that it had before it was adjusted, between the key frames that depth relates; none where
/// these are of both `parts`, of which it was joined, or too few.
pub(super) fn kept(
    before: &Snapshot,
    after: &Snapshot,
    map: MapId,
    parts: [&[KeyFrameId]; 2],
) -> Vec<Change> {
    let is_related = |id: &&KeyFrameId| before.key_frame(**id).is_some_and(|k| !k.relative_poses.is_empty());
    let related = parts.map(|part| part.iter().filter(is_related).collect::<Vec<_>>());
    let [of, none] = if related[0].is_empty() { [1, 0] } else { [0, 1] }.map(|n: usize| &related[n]);
    let at = |s: &Snapshot, id: &KeyFrameId| s.key_frame(*id).map(|k| k.world_from_camera.translation);
    let both = |id: &&KeyFrameId| at(before, id).zip(at(after, id));
    let (was, is): (Vec<Vec3>, Vec<Vec3>) = of.iter().filter_map(both).unzip();
    let factor = umeyama(&was, &is, true).map_or(f64::NAN, |back| back.scale);
    if !(none.is_empty() && factor.is_finite() && factor > 0.0) {
        return Vec::new();
    }
    let moving = after.key_frames_of(map).filter_map(|k| Some((k.id, k.motion.as_ref()?)));
    let velocities = moving.map(|(id, m)| Change::InertialState(id, m.velocity * factor, m.bias));
    // The adjustment left units as they were, and so does this.
    let units = after.key_frames_of(map).map(|k| Change::Scale(k.id, 1.0 / factor));
    velocities.chain([Change::Rescale(map, factor)]).chain(units).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, KeyFrame, RelativePose};
    use cairn_geometry::{Se3, So3};
    use nalgebra::Matrix6;
    use std::sync::Arc;

    /// A map of two parts, of which depth relates the first; all of it has grown, and the parts have moved against each other.
    #[test]
    fn a_map_keeps_the_lengths_of_those_that_depth_relates() {
        let mut atlas = Atlas::new(Snapshot::new());
        let mut ids: Vec<KeyFrameId> = Vec::new();
        for n in 0..12 {
            let id = atlas.latest().next_key_frame_id();
            let x = f64::from(n);
            let at = Se3::new(So3::identity(), Vec3::new(x, (1.7 * x).sin(), (0.9 * x).cos()));
            let key_frame = KeyFrame::new(id, Arc::default(), at, ids.last().copied());
            atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
            ids.push(id);
        }
        let map = MapId(ids[0]);
        let parts = [&ids[..6], &ids[6..]];
        let grown = |s: &Snapshot| {
            let moved = |k: &KeyFrame| {
                let part = usize::from(k.id >= ids[6]);
                let scale = [1.01, 1.05][part];
                let at = k.world_from_camera.translation * scale + Vec3::y() * 0.3 * part as f64;
                Change::MoveKeyFrame(k.id, Se3::new(k.world_from_camera.rotation, at))
            };
            s.apply(&cairn_atlas::ChangeSet {
                base: s.version(),
                changes: s.key_frames().map(moved).collect(),
            })
            .0
        };
        let bare = atlas.latest().clone();
        assert!(kept(&bare, &grown(&bare), map, parts).is_empty(), "depth relates none");
        let z = |n: usize| RelativePose {
            from: ids[n - 1],
            from_from_here: Se3::identity(),
            information: Matrix6::identity(),
        };
        atlas.commit((1..6).map(|n| Change::RelativePoses(ids[n], vec![z(n)])).collect());
        let after = grown(atlas.latest());
        for parts in [parts, [parts[1], parts[0]]] {
            let changes = kept(atlas.latest(), &after, map, parts);
            let Some(Change::Rescale(of, factor)) = changes.first() else { panic!("{changes:?}") };
            assert!(*of == map && (factor * 1.01 - 1.0).abs() < 1e-9, "{factor}");
            let again = after.apply(&cairn_atlas::ChangeSet { base: after.version(), changes }).0;
            assert!(again.key_frames().all(|k| (k.unit - 1.0).abs() < 1e-12));
        }
        atlas.commit(vec![Change::RelativePoses(ids[8], vec![RelativePose { from: ids[7], ..z(1) }])]);
        let after = grown(atlas.latest());
        assert!(kept(atlas.latest(), &after, map, parts).is_empty(), "depth relates those of both");
    }
}
