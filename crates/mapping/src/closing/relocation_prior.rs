//! How far two worlds may be off each other before their places cannot be the same, however alike they look.

use cairn_atlas::{KeyFrame, MapId, Snapshot};
use cairn_geometry::Vec3;

/// How far the worlds of a key frame and of an earlier visit may be off each other beside what they have drifted: three
/// standard deviations of what ties the younger to the elder, and anything where nothing does. Without metric scale the
/// younger's unit of length was a guess; how wrong it was is told by `scale`, length there for each length here, over the
/// way that went by it.
pub(super) fn relocation_prior(snapshot: &Snapshot, here: &KeyFrame, there: MapId, scale: f64) -> f64 {
    let (younger, elder) = (here.map.max(there), here.map.min(there));
    let tie = snapshot.maps().find(|(id, _)| *id == younger).and_then(|(_, tie)| tie);
    let to = tie
        .and_then(|t| snapshot.surviving_ancestor(t.to))
        .and_then(|(id, _)| snapshot.key_frame(id))
        .map(|k| k.map);
    let Some(tie) = tie.filter(|_| to == Some(elder)) else { return f64::INFINITY };
    let own: Vec<Vec3> = snapshot.key_frames_of(younger).map(|k| k.world_from_camera.translation).collect();
    let way: f64 = own.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    3.0 * tie.sigma + (scale - 1.0).abs() * way
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, Change, KeyFrameId, MapPrior};
    use cairn_geometry::{Se3, So3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    /// An elder world of one key frame at the origin, and a younger one of three that went 2 units.
    fn two_maps(tie: Option<MapPrior>) -> Atlas {
        let mut atlas = Atlas::new(Snapshot::new());
        for (x, parent) in [(0.0, None), (5.0, None), (6.0, Some(1)), (7.0, Some(2))] {
            let id = atlas.latest().next_key_frame_id();
            let at = Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0));
            let parent = parent.and_then(KeyFrameId::from_index);
            let key_frame = KeyFrame::new(id, Arc::new(Frame::default()), at, parent);
            atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
        }
        let younger = MapId(KeyFrameId::from_index(1).unwrap());
        atlas.commit(tie.into_iter().map(|tie| Change::MapPrior(younger, tie)).collect());
        atlas
    }

    #[test]
    fn a_tie_bounds_it_and_a_wrong_unit_counts_over_the_way_alone() {
        let tie = |to: usize| MapPrior {
            to: KeyFrameId::from_index(to).unwrap(),
            to_from_root: Se3::identity(),
            sigma: 0.5,
            sigma_rad: 0.1,
            sigma_log_scale: 0.0,
        };
        let bound = |atlas: &Atlas, scale: f64| {
            let snapshot = atlas.latest();
            let here = snapshot.key_frame(KeyFrameId::from_index(3).unwrap()).unwrap();
            relocation_prior(snapshot, here, MapId(KeyFrameId::from_index(0).unwrap()), scale)
        };
        let tied = two_maps(Some(tie(0)));
        assert!((bound(&tied, 1.0) - 1.5).abs() < 1e-12);
        assert!((bound(&tied, 3.0) - 5.5).abs() < 1e-12);
        assert_eq!(bound(&two_maps(None), 1.0), f64::INFINITY, "nothing is known of where it lies");
    }
}
