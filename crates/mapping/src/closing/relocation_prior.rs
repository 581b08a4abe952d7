//! Bounds on the displacement between two maps: beyond them, two places cannot be the same, however similar they
//! look.

use cairn_atlas::{KeyFrame, MapId, MapPrior, Snapshot};
use cairn_geometry::Vec3;

/// The displacement that the map prior allows between the maps of a key frame and of an earlier visit, beyond drift,
/// in map units: three standard deviations of the prior from the younger map to the older one, or infinite where
/// there is none. Without metric scale the younger map's unit of length was a guess. The error of that guess follows
/// from `scale` (length there for each length here), times the distance travelled in that unit.
pub(super) fn prior_displacement(snapshot: &Snapshot, here: &KeyFrame, there: MapId, scale: f64) -> f64 {
    let Some(prior) = prior_between(snapshot, here.map, there) else { return f64::INFINITY };
    let younger = here.map.max(there);
    let positions: Vec<Vec3> =
        snapshot.key_frames_of(younger).map(|k| k.world_from_camera.translation).collect();
    let travelled: f64 = positions.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
    3.0 * prior.sigma + (scale - 1.0).abs() * travelled
}

/// The rotation in radians that the map prior allows between the maps, beyond drift: three standard deviations, and
/// infinite where there is none.
pub(super) fn prior_rotation(snapshot: &Snapshot, here: &KeyFrame, there: MapId) -> f64 {
    prior_between(snapshot, here.map, there).map_or(f64::INFINITY, |prior| 3.0 * prior.sigma_rad)
}

/// The prior of the younger of two maps, if it relates it to the older.
fn prior_between(snapshot: &Snapshot, a: MapId, b: MapId) -> Option<MapPrior> {
    let (younger, older) = (a.max(b), a.min(b));
    let prior = snapshot.maps().find(|(id, _)| *id == younger).and_then(|(_, prior)| prior)?;
    let (to, _) = snapshot.surviving_ancestor(prior.to)?;
    (snapshot.key_frame(to)?.map == older).then_some(*prior)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, Change, KeyFrameId, MapPrior};
    use cairn_geometry::{Se3, So3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    /// An older map of one key frame at the origin, and a younger one of three that moved 2 units.
    fn two_maps(prior: Option<MapPrior>) -> Atlas {
        let mut atlas = Atlas::new(Snapshot::new());
        for (x, parent) in [(0.0, None), (5.0, None), (6.0, Some(1)), (7.0, Some(2))] {
            let id = atlas.latest().next_key_frame_id();
            let at = Se3::new(So3::identity(), Vec3::new(x, 0.0, 0.0));
            let parent = parent.and_then(KeyFrameId::from_index);
            let key_frame = KeyFrame::new(id, Arc::new(Frame::default()), at, parent);
            atlas.commit(vec![Change::AddKeyFrame(Box::new(key_frame))]);
        }
        let younger = MapId(KeyFrameId::from_index(1).unwrap());
        atlas.commit(prior.into_iter().map(|prior| Change::MapPrior(younger, prior)).collect());
        atlas
    }

    #[test]
    fn bound_follows_from_map_prior_and_scale() {
        let prior = |to: usize| MapPrior {
            to: KeyFrameId::from_index(to).unwrap(),
            to_from_root: Se3::identity(),
            sigma: 0.5,
            sigma_rad: 0.1,
            sigma_log_scale: 0.0,
        };
        let bound = |atlas: &Atlas, scale: f64| {
            let snapshot = atlas.latest();
            let here = snapshot.key_frame(KeyFrameId::from_index(3).unwrap()).unwrap();
            prior_displacement(snapshot, here, MapId(KeyFrameId::from_index(0).unwrap()), scale)
        };
        let with_prior = two_maps(Some(prior(0)));
        assert!((bound(&with_prior, 1.0) - 1.5).abs() < 1e-12);
        assert!((bound(&with_prior, 3.0) - 5.5).abs() < 1e-12);
        assert_eq!(bound(&two_maps(None), 1.0), f64::INFINITY, "no prior: its position is unknown");
        let turned = |atlas: &Atlas| {
            let here = atlas.latest().key_frame(KeyFrameId::from_index(3).unwrap()).unwrap();
            prior_rotation(atlas.latest(), here, MapId(KeyFrameId::from_index(0).unwrap()))
        };
        assert!((turned(&with_prior) - 0.3).abs() < 1e-12);
        assert_eq!(turned(&two_maps(None)), f64::INFINITY);
    }
}
