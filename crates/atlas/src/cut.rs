//! Cutting a piece out of a map: some of its key frames with the landmarks that they show, as a map of its own; and leaving out
//! whole maps.
//!
//! In: a snapshot and the key frames to keep. Out: a snapshot with one map of them, in the same coordinates. Ids and names stay
//! those of the whole, so that what is anchored to a key frame by its name finds it in every piece that holds it.

use crate::made_by::MadeBy;
use crate::{KeyFrameId, Landmark, LandmarkId, MapId, PlaceIndex, Snapshot};
use std::collections::BTreeSet;
use std::sync::Arc;

impl Snapshot {
    /// A snapshot with these key frames only, all of one map, whose root is the oldest of them; `None` where none of them exists or
    /// they are not of one map. What measures motion from a key frame that is left out, or a pose relative to it, is left out too; what was removed from the
    /// whole is unknown in the piece.
    pub fn cut(&self, keep: &BTreeSet<KeyFrameId>) -> Option<Snapshot> {
        let kept = || keep.iter().filter_map(|id| self.key_frame(*id));
        let first = kept().next()?;
        if kept().any(|k| k.map != first.map) {
            return None;
        }
        let map = MapId(first.id);
        let mut piece = Self {
            version: self.version,
            names: Arc::clone(&self.names),
            other_cameras: Arc::clone(&self.other_cameras),
            right_offset: self.right_offset,
            imu_offset: self.imu_offset,
            imu_from_camera: self.imu_from_camera,
            readout: self.readout,
            next_key_frame: self.next_key_frame,
            next_landmark: self.next_landmark,
            ..Self::with_octaves(self.octaves)
        };
        Arc::make_mut(&mut piece.maps).insert(map, None);
        if let Some(times) = self.gravity_alignments.get(&first.map) {
            Arc::make_mut(&mut piece.gravity_alignments).insert(map, *times);
        }
        if let Some(times) = self.rescalings.get(&first.map) {
            Arc::make_mut(&mut piece.rescalings).insert(map, *times);
        }
        if let Some(sigma_log) = self.scale_sigmas.get(&first.map) {
            Arc::make_mut(&mut piece.scale_sigmas).insert(map, *sigma_log);
        }
        let within = |id: &KeyFrameId| keep.contains(id) && self.key_frame(*id).is_some();
        for k in kept() {
            let mut k = k.clone();
            k.map = map;
            k.parent = (k.id != first.id).then(|| self.kept_ancestor(k.parent, &within).unwrap_or(first.id));
            k.links.retain(within);
            k.relative_poses.retain(|z| within(&z.from));
            if let Some(motion) = k.motion.as_mut()
                && motion.imu_factor.as_ref().is_some_and(|f| !within(&f.since))
            {
                motion.imu_factor = None;
            }
            piece.key_frames.insert(k.id.index(), k);
        }
        let shown: BTreeSet<LandmarkId> =
            kept().flat_map(|k| k.landmarks.iter().flatten().copied()).collect();
        for l in shown.iter().filter_map(|id| self.landmark(*id)) {
            let mut own = l.clone();
            own.observations.retain(|o| within(&o.key_frame));
            if own.observations.len() < l.observations.len() {
                (own.descriptor, own.pick) =
                    piece.typical_descriptor(&own).unwrap_or((own.descriptor, u16::MAX));
                (own.octave, own.angle) = piece.octave_and_angle(&own).unwrap_or((own.octave, own.angle));
                if let Some((normal, min, max)) = piece.visibility(&own) {
                    (own.normal, own.min_distance, own.max_distance) = (normal, min, max);
                }
            }
            piece.landmarks.insert(own.id.index(), own);
        }
        piece.made_by = MadeBy::of(piece.key_frames());
        piece.recount_covisible();
        piece.places = PlaceIndex::of(piece.key_frames().map(|k| (k.id, k.bag.shared())));
        Some(piece)
    }

    /// A snapshot without some of its maps. Ids and names stay; what is anchored in those maps is unknown, and so is how others lie to
    /// them.
    pub fn without_maps(&self, leave_out: impl Fn(MapId) -> bool) -> Snapshot {
        let out: BTreeSet<MapId> = self.maps().map(|(map, _)| map).filter(|map| leave_out(*map)).collect();
        let mut rest = self.clone();
        if out.is_empty() {
            return rest;
        }
        for k in self.key_frames().filter(|k| out.contains(&k.map)) {
            rest.places.remove(k.id);
            rest.made_by.remove(k);
            rest.key_frames.remove(k.id.index());
        }
        let seen_from = |l: &Landmark| {
            l.observations
                .first()
                .is_some_and(|o| self.key_frame(o.key_frame).is_some_and(|k| out.contains(&k.map)))
        };
        for l in self.landmarks().filter(|l| seen_from(l)) {
            rest.landmarks.remove(l.id.index());
        }
        for (index, _) in self.removed.iter() {
            let is_known =
                KeyFrameId::from_index(index).is_some_and(|id| rest.surviving_ancestor(id).is_some());
            if !is_known {
                rest.removed.remove(index);
            }
        }
        let maps = self.maps.iter().filter(|(map, _)| !out.contains(map)).map(|(map, prior)| {
            let prior = prior.filter(|prior| rest.surviving_ancestor(prior.to).is_some());
            (*map, prior)
        });
        rest.maps = Arc::new(maps.collect());
        for of_maps in [&mut rest.gravity_alignments, &mut rest.rescalings] {
            Arc::make_mut(of_maps).retain(|map, _| !out.contains(map));
        }
        Arc::make_mut(&mut rest.scale_sigmas).retain(|map, _| !out.contains(map));
        rest
    }

    /// The nearest ancestor that is kept, from `parent` on.
    fn kept_ancestor(
        &self,
        parent: Option<KeyFrameId>,
        within: &impl Fn(&KeyFrameId) -> bool,
    ) -> Option<KeyFrameId> {
        let mut at = parent?;
        while !within(&at) {
            at = self.key_frame(at)?.parent?;
        }
        Some(at)
    }
}
