//! Applying a change set: from one snapshot to the next, with all derived data brought up to date.

use crate::change::scaling_about;
use crate::covisible::{self, Shared};
use crate::scale::is_sound_sigma;
use crate::{
    Applied, Change, ChangeSet, InertialState, KeyFrame, KeyFrameId, Landmark, LandmarkId, MapId,
    Observation, RelativePose, Snapshot,
};
use cairn_geometry::{Sim3, Vec3};
use cairn_vision::Descriptor;
use std::collections::BTreeSet;
use std::sync::Arc;

/// A landmark's descriptor is chosen among this many of its latest observations.
const DESCRIPTORS: usize = 16;

/// What has to be derived again.
#[derive(Default)]
struct Dirty {
    /// Observations changed: descriptor, normal, range.
    observed: BTreeSet<LandmarkId>,
    /// Geometry changed: normal, range.
    moved: BTreeSet<LandmarkId>,
    /// Observed together with others than before: covisibility.
    shares: Vec<Shared>,
}

impl Snapshot {
    /// The next snapshot. Changes that name something nonexistent are dropped and counted, never a panic;
    /// landmarks without observations are removed.
    pub fn apply(&self, set: &ChangeSet) -> (Snapshot, Applied) {
        self.apply_noting(&set.changes, |_| ())
    }

    /// The same; `note` gets the index of each change that was dropped.
    pub(crate) fn apply_noting(
        &self,
        changes: &[Change],
        mut note: impl FnMut(usize),
    ) -> (Snapshot, Applied) {
        let mut snapshot = self.clone();
        snapshot.version += 1;
        let mut dirty = Dirty::default();
        let mut applied = Applied::default();
        for (nth, change) in changes.iter().enumerate() {
            match snapshot.apply_one(change, &mut dirty) {
                Some(()) => applied.done += 1,
                None => {
                    applied.dropped += 1;
                    note(nth);
                }
            }
        }
        snapshot.update_derived(dirty);
        (snapshot, applied)
    }

    fn apply_one(&mut self, change: &Change, dirty: &mut Dirty) -> Option<()> {
        match change {
            Change::AddKeyFrame(k) => {
                let fresh = k.id.index() >= self.next_key_frame;
                let map = match k.parent {
                    Some(p) => self.key_frame(p)?.map,
                    None => MapId(k.id),
                };
                if !fresh || !k.world_from_camera.is_finite() || !positive(k.unit) {
                    return None;
                }
                if k.parent.is_none() {
                    Arc::make_mut(&mut self.maps).insert(map, None);
                }
                self.next_key_frame = k.id.index() + 1;
                let mut key_frame = (**k).clone();
                key_frame.map = map;
                self.made_by.add(&key_frame);
                key_frame.landmarks = vec![None; key_frame.frame.len()];
                key_frame.links.clear();
                key_frame.relative_poses.clear();
                key_frame.covisible.clear();
                key_frame.shares.0 = Some(Vec::new());
                self.places.insert(k.id, &k.bag.shared());
                self.key_frames.insert(k.id.index(), key_frame);
            }
            Change::AddLandmark(id, position) => {
                if id.index() < self.next_landmark || !finite(position) {
                    return None;
                }
                self.next_landmark = id.index() + 1;
                self.landmarks.insert(id.index(), Landmark::new(*id, *position));
                dirty.observed.insert(*id);
            }
            Change::MoveKeyFrame(id, pose) => {
                let k = pose.is_finite().then(|| self.key_frames.get_mut(id.index()))??;
                k.world_from_camera = *pose;
                dirty.moved.extend(k.landmarks.iter().flatten());
            }
            Change::Scale(id, factor) => {
                let k = positive(*factor).then(|| self.key_frames.get_mut(id.index()))??;
                k.unit = Some(k.unit * factor).filter(|unit| positive(*unit))?;
            }
            Change::InertialState(id, velocity, bias) => {
                let valid = [velocity, &bias.gyro, &bias.accel].into_iter().all(finite);
                let k = valid.then(|| self.key_frames.get_mut(id.index()))??;
                let motion = k.motion.as_mut()?;
                (motion.velocity, motion.bias) = (*velocity, *bias);
            }
            Change::ImuFactor(id, imu_factor) => {
                if let Some(factor) = imu_factor {
                    let since = self.key_frame(factor.since).filter(|_| factor.since < *id)?;
                    self.key_frame(*id).filter(|k| k.map == since.map)?;
                }
                self.key_frames.get_mut(id.index())?.motion.as_mut()?.imu_factor.clone_from(imu_factor);
            }
            Change::ImuOffset(seconds) => self.imu_offset = seconds.is_finite().then_some(*seconds)?,
            Change::Readout(readout) => self.readout = readout.is_sound().then_some(*readout)?,
            Change::LeverArm(arm) => {
                self.imu_from_camera.as_mut().filter(|_| finite(arm))?.translation = *arm;
            }
            Change::AlignGravity(map, aligned_from_world) => {
                if !self.maps.contains_key(map) {
                    return None;
                }
                self.transform_map(*map, *map, aligned_from_world, dirty)?;
                *Arc::make_mut(&mut self.gravity_alignments).entry(*map).or_insert(0) += 1;
            }
            Change::Rescale(map, factor) => {
                let root = positive(*factor).then(|| self.key_frame(map.root()))??;
                let by = scaling_about(&root.world_from_camera.translation, *factor);
                self.maps.contains_key(map).then_some(())?;
                self.transform_map(*map, *map, &by, dirty)?;
                *Arc::make_mut(&mut self.rescalings).entry(*map).or_insert(0) += 1;
            }
            Change::ScaleSigma(map, sigma_log) => {
                (self.maps.contains_key(map) && is_sound_sigma(*sigma_log)).then_some(())?;
                Arc::make_mut(&mut self.scale_sigmas).insert(*map, *sigma_log);
            }
            Change::MoveLandmark(id, position) => {
                let l = finite(position).then(|| self.landmarks.get_mut(id.index()))??;
                l.position = *position;
                dirty.moved.insert(*id);
            }
            Change::Observe(id, key_frame, feature) => self.observe(*id, *key_frame, *feature, dirty)?,
            Change::Forget(id, key_frame) => self.forget(*id, *key_frame, dirty)?,
            Change::Calibrate(offset) => self.right_offset = offset.is_finite().then_some(*offset)?,
            Change::Fuse(from, into) => self.fuse(*from, *into, dirty)?,
            Change::Link(a, b) => self.link(*a, *b)?,
            Change::RelativePoses(id, all) => self.relate(*id, all)?,
            Change::MapPrior(map, map_prior) => {
                let earlier =
                    self.surviving_ancestor(map_prior.to).and_then(|(id, _)| self.key_frame(id))?.map;
                let valid = map_prior.to_from_root.is_finite()
                    && map_prior.sigma.is_finite()
                    && map_prior.sigma_rad.is_finite()
                    && map_prior.sigma_log_scale.is_finite();
                if earlier == *map || !valid {
                    return None;
                }
                *Arc::make_mut(&mut self.maps).get_mut(map)? = Some(*map_prior);
            }
            Change::Merge { from, into, into_from, parent } => {
                self.merge(*from, *into, into_from, *parent, dirty)?
            }
            Change::RemoveLandmark(id) => self.remove_landmark(*id, dirty)?,
            Change::RemoveKeyFrame(id) => self.remove_key_frame(*id, dirty)?,
        }
        Some(())
    }

    fn observe(
        &mut self,
        id: LandmarkId,
        key_frame: KeyFrameId,
        feature: u16,
        dirty: &mut Dirty,
    ) -> Option<()> {
        let seen_from = self.landmark(id)?.observations.first().map(|o| o.key_frame);
        if let Some(seen_from) = seen_from
            && self.key_frame(seen_from)?.map != self.key_frame(key_frame)?.map
        {
            return None;
        }
        let before = *self.key_frame(key_frame)?.landmarks.get(feature as usize)?;
        if before == Some(id) {
            return Some(());
        }
        // One feature shows one landmark, and one landmark is shown by one feature of a key frame.
        if let Some(other) = before {
            self.forget(other, key_frame, dirty)?;
        }
        if self.landmark(id)?.feature_in(key_frame).is_some() {
            self.forget(id, key_frame, dirty)?;
        }
        self.key_frames.get_mut(key_frame.index())?.landmarks[feature as usize] = Some(id);
        let observations = &mut self.landmarks.get_mut(id.index())?.observations;
        covisible::note(&mut dirty.shares, key_frame, observations, 1);
        let at = observations.partition_point(|o| o.key_frame < key_frame);
        // No room for later ones: the next commit copies the landmark anyway, and most have few observations.
        observations.reserve_exact(1);
        observations.insert(at, Observation { key_frame, feature });
        dirty.observed.insert(id);
        Some(())
    }

    fn forget(&mut self, id: LandmarkId, key_frame: KeyFrameId, dirty: &mut Dirty) -> Option<()> {
        let feature = self.landmark(id)?.feature_in(key_frame)?;
        let observations = &mut self.landmarks.get_mut(id.index())?.observations;
        observations.retain(|o| o.key_frame != key_frame);
        covisible::note(&mut dirty.shares, key_frame, observations, -1);
        if let Some(slot) =
            self.key_frames.get_mut(key_frame.index()).and_then(|k| k.landmarks.get_mut(feature as usize))
        {
            *slot = None;
        }
        dirty.observed.insert(id);
        Some(())
    }

    fn fuse(&mut self, from: LandmarkId, into: LandmarkId, dirty: &mut Dirty) -> Option<()> {
        if from == into {
            return None;
        }
        let map = |snapshot: &Self, id| snapshot.landmark(id)?.observations.first().map(|o| o.key_frame);
        let maps = [from, into].map(|id| map(self, id).and_then(|k| self.key_frame(k)).map(|k| k.map));
        self.landmark(into)?;
        if let [Some(a), Some(b)] = maps
            && a != b
        {
            return None;
        }
        let observations = self.landmark(from)?.observations.clone();
        self.remove_landmark(from, dirty)?;
        for o in observations {
            if self.landmark(into)?.feature_in(o.key_frame).is_none() {
                self.observe(into, o.key_frame, o.feature, dirty);
            }
        }
        Some(())
    }

    fn remove_landmark(&mut self, id: LandmarkId, dirty: &mut Dirty) -> Option<()> {
        let observations = self.landmark(id)?.observations.clone();
        for o in observations {
            self.forget(id, o.key_frame, dirty);
        }
        self.landmarks.remove(id.index()).then_some(())
    }

    fn remove_key_frame(&mut self, id: KeyFrameId, dirty: &mut Dirty) -> Option<()> {
        let removed = self.key_frame(id)?.clone();
        // The root fixes the frame of the map: it stays.
        let parent = removed.parent?;
        let parent_from_it = self.key_frame(parent)?.world_from_here().inverse() * removed.world_from_here();
        for landmark in removed.landmarks.iter().flatten() {
            self.forget(*landmark, id, dirty);
        }
        for other in &removed.links {
            if let Some(k) = self.key_frames.get_mut(other.index()) {
                k.links.retain(|l| *l != id);
            }
        }
        self.places.remove(id);
        self.key_frames.remove(id.index());
        self.made_by.remove(&removed);
        self.join_imu_factors(id, removed.motion);
        self.leave_out_relative_to(id);
        self.removed.insert(id.index(), (parent, parent_from_it));
        self.adopt(id, parent);
        Some(())
    }

    fn link(&mut self, a: KeyFrameId, b: KeyFrameId) -> Option<()> {
        if a == b || self.key_frame(a)?.map != self.key_frame(b)?.map {
            return None;
        }
        for (at, with) in [(a, b), (b, a)] {
            let links = &mut self.key_frames.get_mut(at.index())?.links;
            if let Err(i) = links.binary_search(&with) {
                links.insert(i, with);
            }
        }
        Some(())
    }

    fn relate(&mut self, id: KeyFrameId, all: &[RelativePose]) -> Option<()> {
        let map = self.key_frame(id)?.map;
        let ordered = all.is_sorted_by(|a, b| a.from < b.from) && all.iter().all(|z| z.from < id);
        (ordered && all.iter().all(RelativePose::is_sound)).then_some(())?;
        let of_map = |z: &&RelativePose| self.key_frame(z.from).is_some_and(|from| from.map == map);
        let kept = all.iter().filter(of_map).copied().collect();
        self.key_frames.get_mut(id.index())?.relative_poses = kept;
        Some(())
    }

    /// Leaves out the poses relative to a removed key frame.
    fn leave_out_relative_to(&mut self, removed: KeyFrameId) {
        let is_of_it = |z: &RelativePose| z.from == removed;
        let later = self.key_frames_from(removed).filter(|k| k.relative_poses.iter().any(is_of_it));
        for id in later.map(|k| k.id).collect::<Vec<_>>() {
            if let Some(k) = self.key_frames.get_mut(id.index()) {
                k.relative_poses.retain(|z| z.from != removed);
            }
        }
    }

    fn merge(
        &mut self,
        from: MapId,
        into: MapId,
        into_from: &Sim3,
        parent: KeyFrameId,
        dirty: &mut Dirty,
    ) -> Option<()> {
        let known = self.maps.contains_key(&from) && self.maps.contains_key(&into);
        if !known || from <= into || parent >= from.root() {
            return None;
        }
        if self.key_frame(parent)?.map != into {
            return None;
        }
        self.transform_map(from, into, into_from, dirty)?;
        self.key_frames.get_mut(from.root().index())?.parent = Some(parent);
        Arc::make_mut(&mut self.maps).remove(&from);
        Arc::make_mut(&mut self.gravity_alignments).remove(&from);
        Arc::make_mut(&mut self.scale_sigmas).remove(&from);
        self.made_by.merge(from, into);
        Some(())
    }

    /// Transforms everything in a map; `None` when a unit would become invalid.
    fn transform_map(&mut self, from: MapId, into: MapId, into_from: &Sim3, dirty: &mut Dirty) -> Option<()> {
        if !into_from.is_finite() {
            return None;
        }
        let moving: Vec<KeyFrameId> = self.key_frames_of(from).map(|k| k.id).collect();
        if !moving.iter().all(|id| self.key_frame(*id).is_some_and(|k| positive(k.unit * into_from.scale))) {
            return None;
        }
        let mut landmarks: BTreeSet<LandmarkId> = BTreeSet::new();
        for id in moving {
            let k = self.key_frames.get_mut(id.index())?;
            k.map = into;
            k.world_from_camera = into_from.transform_pose(&k.world_from_camera);
            k.unit *= into_from.scale;
            landmarks.extend(k.landmarks.iter().flatten());
        }
        for id in landmarks {
            let l = self.landmarks.get_mut(id.index())?;
            l.position = *into_from * l.position;
            dirty.moved.insert(id);
        }
        Some(())
    }

    /// Joins the IMU factor that starts at a removed key frame with the one that ends there.
    fn join_imu_factors(&mut self, removed: KeyFrameId, motion: Option<InertialState>) {
        let since = |k: &KeyFrame| k.motion.as_ref().and_then(|m| m.imu_factor.as_ref()).map(|f| f.since);
        // Motion is measured from an older key frame.
        let later = self.key_frames_from(removed).find(|k| since(k) == Some(removed));
        let Some(next) = later.map(|k| k.id) else { return };
        if let Some(after) = self.key_frames.get_mut(next.index()).and_then(|k| k.motion.as_mut()) {
            let before = motion.and_then(|m| m.imu_factor);
            after.imu_factor = after
                .imu_factor
                .take()
                .zip(before)
                .and_then(|(imu_factor, before)| imu_factor.after(&before));
        }
    }

    /// Gives the children of a removed key frame new parents: the most covisible of their other older
    /// neighbours (never a descendant of their own), else its parent.
    fn adopt(&mut self, removed: KeyFrameId, parent: KeyFrameId) {
        let children: Vec<KeyFrameId> =
            self.key_frames_from(removed).filter(|k| k.parent == Some(removed)).map(|k| k.id).collect();
        for child in children {
            // An older key frame cannot be a descendant: parents are always older than their children.
            let best = self.key_frame(child).and_then(|k| {
                k.covisible.iter().map(|(id, _)| *id).find(|id| *id < child && self.key_frame(*id).is_some())
            });
            if let Some(k) = self.key_frames.get_mut(child.index()) {
                k.parent = Some(best.unwrap_or(parent));
            }
        }
    }

    fn update_derived(&mut self, mut dirty: Dirty) {
        for id in &dirty.observed {
            let unobserved = self.landmark(*id).is_some_and(|l| l.observations.is_empty());
            if unobserved {
                self.landmarks.remove(id.index());
            }
        }
        for id in &dirty.observed {
            if let Some(look) = self.landmark(*id).and_then(|l| self.typical_descriptor(l))
                && let Some(l) = self.landmarks.get_mut(id.index())
            {
                (l.descriptor, l.pick) = look;
            }
            if let Some(seen) = self.landmark(*id).and_then(|l| self.octave_and_angle(l))
                && let Some(l) = self.landmarks.get_mut(id.index())
            {
                (l.octave, l.angle) = seen;
            }
        }
        dirty.moved.append(&mut dirty.observed);
        for id in &dirty.moved {
            if let Some((normal, min, max)) = self.landmark(*id).and_then(|l| self.visibility(l))
                && let Some(l) = self.landmarks.get_mut(id.index())
            {
                (l.normal, l.min_distance, l.max_distance) = (normal, min, max);
            }
        }
        self.update_covisible(dirty.shares);
    }

    /// The observed descriptor with the least median Hamming distance to the others, and which observation has it.
    pub(crate) fn typical_descriptor(&self, l: &Landmark) -> Option<(Descriptor, u16)> {
        let first = l.observations.len().saturating_sub(DESCRIPTORS);
        let latest = &l.observations[first..];
        let all: Vec<&Descriptor> = latest
            .iter()
            .filter_map(|o| self.key_frame(o.key_frame).map(|k| &k.frame.descriptors[o.feature as usize]))
            .collect();
        let medians = all.iter().map(|a| {
            let mut distances: Vec<u32> = all.iter().map(|b| distance(a, b)).collect();
            let middle = (distances.len() - 1) / 2;
            *distances.select_nth_unstable(middle).1
        });
        let best = medians.enumerate().min_by_key(|(i, m)| (*m, *i))?.0;
        Some((*all[best], u16::try_from(first + best).unwrap_or(u16::MAX)))
    }

    /// The pyramid level of the first observation and the angle of the latest.
    pub(crate) fn octave_and_angle(&self, l: &Landmark) -> Option<(u8, f32)> {
        let frame = |o: &Observation| self.key_frame(o.key_frame).map(|k| &k.frame);
        let (first, last) = (l.observations.first()?, l.observations.last()?);
        let octave = *frame(first)?.octave.get(usize::from(first.feature))?;
        // Features made by hand may have none.
        Some((octave, frame(last)?.angle.get(usize::from(last.feature)).copied().unwrap_or(0.0)))
    }

    /// Mean viewing direction and the range of distances the detector's octaves cover.
    pub(crate) fn visibility(&self, l: &Landmark) -> Option<(Vec3, f64, f64)> {
        let mut normal = Vec3::zeros();
        for o in &l.observations {
            let from = self.key_frame(o.key_frame)?.world_from_camera.translation;
            normal += (l.position - from).try_normalize(1e-12).unwrap_or_else(Vec3::zeros);
        }
        // The first observation sets the range: the level it was found at gives its size.
        let first = l.observations.first()?;
        let k = self.key_frame(first.key_frame)?;
        let range = (l.position - k.world_from_camera.translation).norm();
        let max = range * self.octaves.scale(l.octave) / k.focal_ratio();
        let min = max / self.octaves.scale((self.octaves.levels - 1) as u8);
        Some((normal.try_normalize(1e-12).unwrap_or_else(Vec3::zeros), min, max))
    }
}

/// In how many bits two descriptors differ.
pub(crate) fn distance(a: &Descriptor, b: &Descriptor) -> u32 {
    let words = |d: &Descriptor, i: usize| u64::from_ne_bytes(std::array::from_fn(|k| d[i * 8 + k]));
    (0..4).map(|i| (words(a, i) ^ words(b, i)).count_ones()).sum()
}

fn positive(v: f64) -> bool {
    v.is_finite() && v > 0.0
}

fn finite(p: &Vec3) -> bool {
    p.iter().all(|v| v.is_finite())
}
