//! What is known of the unit of length: of a frame, and of the stretches of a run.

use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_sensor::Stamp;
use cairn_tracking::State;

/// What is known of the unit of length of a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The map whose unit it is: poses of two maps are comparable in length only as well as `sigma_log` says.
    pub map: MapId,
    /// Whether lengths are metres.
    pub metric: bool,
    /// Standard deviation of the logarithm of the map's scale against the first map it was begun from: 0 for that one
    /// and for metric maps, about 0.15 where the walker's pace sets it.
    pub sigma_log: f64,
    /// False while the unit of length rests on nothing (a turn on the spot with one camera): lengths of this frame are
    /// assumed; while the IMU contradicts it ([`crate::ScaleCheck`]); and while, with one camera, the motion sensors alone
    /// carry the pose and have made it uncertain by more than 5 cm.
    pub supported: bool,
}

impl Scale {
    /// Whether lengths and positions relative to the first map of the walk are known well enough to be told: metric, or in
    /// that map itself, and supported.
    pub fn is_known(&self) -> bool {
        self.supported && (self.metric || self.sigma_log == 0.0)
    }
}

/// Standard deviation of a coasted position from which on lengths are not told as known, metres: a few per cent of the way that
/// is walked in a second or two.
const ADRIFT_M: f64 = 0.05;

/// Whether a pose is carried by the motion sensors alone, too long for its lengths to be told.
pub(crate) fn is_adrift(state: &State) -> bool {
    matches!(state, State::Coasting { sigma, .. } if *sigma > ADRIFT_M)
}

/// A stretch of a run in one unit of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleStretch {
    /// What is known of it now.
    pub scale: Scale,
    /// Time of its first pose.
    pub from: Stamp,
    /// Time of its last pose.
    pub to: Stamp,
    /// Poses in it.
    pub poses: usize,
}

/// The unit of length of a map, as a snapshot knows it; `depth` says whether the sensor measures metres itself.
pub(crate) fn scale_of(snapshot: &Snapshot, map: MapId, depth: bool, supported: bool) -> Scale {
    let metric = depth || snapshot.is_gravity_aligned(map);
    let sigma_log = if metric { 0.0 } else { sigma_log(snapshot, map) };
    Scale { map, metric, sigma_log, supported: supported || metric }
}

/// Along the chain of maps that were begun one from the other, variances add up.
fn sigma_log(snapshot: &Snapshot, map: MapId) -> f64 {
    let prior = |map: MapId| snapshot.maps().find(|(id, _)| *id == map).and_then(|(_, prior)| prior.copied());
    let (mut at, mut variance) = (map, 0.0);
    // A prior leads to an earlier map: the chain ends.
    while let Some(prior) = prior(at) {
        variance += prior.sigma_log_scale.powi(2);
        match map_of(snapshot, prior.to).filter(|former| *former < at) {
            Some(former) => at = former,
            None => break,
        }
    }
    variance.sqrt()
}

/// The map that a key frame is in, or what became of it.
pub(crate) fn map_of(snapshot: &Snapshot, reference: KeyFrameId) -> Option<MapId> {
    snapshot.surviving_ancestor(reference).and_then(|(id, _)| snapshot.key_frame(id)).map(|k| k.map)
}

/// Groups poses, given in order of time, into stretches of one unit of length.
pub(crate) fn stretches(poses: impl Iterator<Item = (Stamp, Scale)>) -> Vec<ScaleStretch> {
    let mut found: Vec<ScaleStretch> = Vec::new();
    for (stamp, scale) in poses {
        match found.last_mut() {
            // All that is metric is one unit of length, whichever map it is in.
            Some(last) if last.scale.map == scale.map || (last.scale.metric && scale.metric) => {
                last.to = stamp;
                last.poses += 1;
                last.scale.supported &= scale.supported;
            }
            _ => found.push(ScaleStretch { scale, from: stamp, to: stamp, poses: 1 }),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Change, ChangeSet, KeyFrame, MapPrior};
    use cairn_geometry::{Se3, Sim3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    fn id(n: usize) -> KeyFrameId {
        KeyFrameId::from_index(n).unwrap()
    }

    /// Three maps of one key frame each, begun one from the other.
    fn chain(aligned: Option<usize>) -> Snapshot {
        let mut changes = Vec::new();
        for n in 0..3 {
            let frame = Arc::new(Frame::default());
            changes.push(Change::AddKeyFrame(Box::new(KeyFrame::new(id(n), frame, Se3::identity(), None))));
        }
        for (n, sigma_log_scale) in [(1, 0.3), (2, 0.4)] {
            let to_from_root = Se3::identity();
            let prior = MapPrior { to: id(n - 1), to_from_root, sigma: 0.1, sigma_rad: 0.1, sigma_log_scale };
            changes.push(Change::MapPrior(MapId(id(n)), prior));
        }
        changes.extend(aligned.map(|n| Change::AlignGravity(MapId(id(n)), Sim3::identity())));
        Snapshot::new().apply(&ChangeSet { base: 0, changes }).0
    }

    #[test]
    fn uncertainty_of_scale_adds_up_along_the_maps() {
        let snapshot = chain(None);
        let sigma = |n| scale_of(&snapshot, MapId(id(n)), false, true).sigma_log;
        assert_eq!((sigma(0), sigma(1)), (0.0, 0.3));
        assert!((sigma(2) - 0.5).abs() < 1e-12);
        assert!(scale_of(&snapshot, MapId(id(0)), false, true).is_known());
        assert!(!scale_of(&snapshot, MapId(id(2)), false, true).is_known());
        assert!(!scale_of(&snapshot, MapId(id(0)), false, false).is_known(), "nothing supports it");
    }

    #[test]
    fn a_pose_is_adrift_when_coasting_has_made_it_uncertain() {
        let coasting = |sigma| State::Coasting { since_s: 1.0, sigma };
        assert!(!is_adrift(&State::Tracking) && !is_adrift(&coasting(0.01)));
        assert!(is_adrift(&coasting(0.06)));
    }

    #[test]
    fn metric_scale_is_known_in_every_map() {
        let snapshot = chain(Some(2));
        let scale = scale_of(&snapshot, MapId(id(2)), false, false);
        assert!(scale.metric && scale.is_known() && scale.sigma_log == 0.0);
        assert!(scale_of(&snapshot, MapId(id(1)), true, true).is_known());
    }

    #[test]
    fn a_new_unit_begins_a_new_stretch() {
        let snapshot = chain(None);
        let at = |t: i64, n: usize| (Stamp(t), scale_of(&snapshot, MapId(id(n)), false, true));
        let found = stretches([at(0, 0), at(1, 0), at(2, 1), at(3, 1), at(4, 1)].into_iter());
        assert_eq!(
            found.iter().map(|s| (s.from.0, s.to.0, s.poses)).collect::<Vec<_>>(),
            [(0, 1, 2), (2, 4, 3)]
        );
    }
}
