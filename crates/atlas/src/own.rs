//! What one robot made of an atlas that several made: its key frames with the landmarks that they show.
//!
//! In: a snapshot and a robot. Out: a snapshot as if that robot had been alone: its key frames keep their names, in as many maps
//! as they were in and where they were; no other robot is named, so that it can be combined with what the others made.

use crate::made_by::MadeBy;
use crate::names::{Names, Stretch, Stretches};
use crate::{KeyFrame, KeyFrameId, LandmarkId, MapId, PlaceIndex, RobotId, Snapshot};
use cairn_geometry::Sim3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

impl Snapshot {
    /// The part of this robot; `None` where it made no key frame that exists. Landmarks that others created and its key frames show
    /// get names of it; how maps lie to each other that were never joined is left out.
    pub fn part_of(&self, robot: RobotId) -> Option<Snapshot> {
        let mut own: BTreeMap<MapId, BTreeSet<KeyFrameId>> = BTreeMap::new();
        for k in self.key_frames().filter(|k| self.key_frame_name(k.id).robot == robot) {
            own.entry(k.map).or_default().insert(k.id);
        }
        let pieces: BTreeMap<MapId, Snapshot> =
            own.iter().filter_map(|(map, keep)| Some((*map, self.cut(keep)?))).collect();
        if pieces.is_empty() {
            return None;
        }
        let key_frames = Renumbered::of(&self.names.key_frames, self.next_key_frame, robot, |_| false);
        let shown: BTreeSet<usize> =
            pieces.values().flat_map(|piece| piece.landmarks().map(|l| l.id.index())).collect();
        let landmarks =
            Renumbered::of(&self.names.landmarks, self.next_landmark, robot, |k| shown.contains(&k));
        let mut part = Self {
            version: self.version,
            other_cameras: Arc::clone(&self.other_cameras),
            right_offset: self.right_offset,
            imu_offset: self.imu_offset,
            imu_from_camera: self.imu_from_camera,
            readout: self.readout,
            next_key_frame: key_frames.next,
            next_landmark: landmarks.next,
            ..Self::with_octaves(self.octaves)
        };
        for (map, piece) in &pieces {
            part.take_in(piece, &key_frames, &landmarks)?;
            self.keep_removed(*map, piece, &key_frames, &mut part);
        }
        part.names = Arc::new(Names { key_frames: key_frames.names, landmarks: landmarks.names });
        part.made_by = MadeBy::of(part.key_frames());
        part.recount_covisible();
        part.places = PlaceIndex::of(part.key_frames().map(|k| (k.id, k.bag.shared())));
        Some(part)
    }

    /// The same snapshot without what an IMU measured between key frames.
    pub fn without_imu_factors(&self) -> Snapshot {
        self.without_imu_factors_where(|_| true)
    }

    /// The same without those of some key frames.
    pub(crate) fn without_imu_factors_where(&self, is_left_out: impl Fn(&KeyFrame) -> bool) -> Snapshot {
        let mut without = self.clone();
        let with_factor = |k: &&KeyFrame| k.motion.as_ref().is_some_and(|m| m.imu_factor.is_some());
        for id in self.key_frames().filter(with_factor).filter(|k| is_left_out(k)).map(|k| k.id) {
            let k = without.key_frames.get_mut(id.index());
            if let Some(motion) = k.and_then(|k| k.motion.as_mut()) {
                motion.imu_factor = None;
            }
        }
        without
    }

    /// Adds a piece under the new ids.
    fn take_in(&mut self, piece: &Snapshot, key_frames: &Renumbered, landmarks: &Renumbered) -> Option<()> {
        let key_frame = |id: KeyFrameId| KeyFrameId::from_index(key_frames.index(id.index())?);
        let landmark = |id: LandmarkId| LandmarkId::from_index(landmarks.index(id.index())?);
        for k in piece.key_frames() {
            let mut k = k.clone();
            k.id = key_frame(k.id)?;
            k.map = MapId(key_frame(k.map.root())?);
            if let Some(parent) = &mut k.parent {
                *parent = key_frame(*parent)?;
            }
            for id in &mut k.links {
                *id = key_frame(*id)?;
            }
            for relative in &mut k.relative_poses {
                relative.from = key_frame(relative.from)?;
            }
            if let Some(factor) = k.motion.as_mut().and_then(|m| m.imu_factor.as_mut()) {
                factor.since = key_frame(factor.since)?;
            }
            for id in k.landmarks.iter_mut().flatten() {
                *id = landmark(*id)?;
            }
            self.key_frames.insert(k.id.index(), k);
        }
        for l in piece.landmarks() {
            let mut l = l.clone();
            l.id = landmark(l.id)?;
            for o in &mut l.observations {
                o.key_frame = key_frame(o.key_frame)?;
            }
            self.landmarks.insert(l.id.index(), l);
        }
        for (map, _) in piece.maps() {
            let root = MapId(key_frame(map.root())?);
            Arc::make_mut(&mut self.maps).insert(root, None);
            if let Some(sigma_log) = piece.scale_sigmas.get(&map) {
                Arc::make_mut(&mut self.scale_sigmas).insert(root, *sigma_log);
            }
            let times = [
                (&mut self.gravity_alignments, &piece.gravity_alignments),
                (&mut self.rescalings, &piece.rescalings),
            ];
            for (to, from) in times {
                if let Some(times) = from.get(&map) {
                    Arc::make_mut(to).insert(root, *times);
                }
            }
        }
        Some(())
    }

    /// Where the robot's removed key frames of a map were: routes lead along them. One that hangs on a key frame of another robot
    /// is told from the root, if that is older.
    fn keep_removed(&self, map: MapId, piece: &Snapshot, key_frames: &Renumbered, part: &mut Snapshot) {
        let Some(root) = piece.key_frames().next() else { return };
        for (index, _) in self.removed.iter() {
            let Some((new, id)) = key_frames.index(index).zip(KeyFrameId::from_index(index)) else {
                continue;
            };
            let Some((ancestor, here)) = self.surviving_ancestor(id) else { continue };
            let Some(k) = self.key_frame(ancestor).filter(|k| k.map == map) else { continue };
            let (parent, parent_from_it): (_, Sim3) = match piece.key_frame(ancestor) {
                Some(_) => (ancestor, here),
                None => (root.id, root.world_from_here().inverse() * k.world_from_here() * here),
            };
            let parent = key_frames.index(parent.index()).filter(|parent| *parent < new);
            if let Some(parent) = parent.and_then(KeyFrameId::from_index) {
                part.removed.insert(new, (parent, parent_from_it));
            }
        }
    }
}

/// Ids without those of other robots.
struct Renumbered {
    /// The stretches that stay: index before, number of ids, index after.
    kept: Vec<(usize, usize, usize)>,
    names: Stretches,
    next: usize,
}

impl Renumbered {
    /// All ids of this robot, under their names, and those of others that are asked for, under names that the robot has not yet
    /// given; in their order.
    fn of(names: &Stretches, next: usize, robot: RobotId, also: impl Fn(usize) -> bool) -> Self {
        let mut of = Self { kept: Vec::new(), names: Stretches(Vec::new()), next: 0 };
        let mut fresh = names.next_seq(robot, next);
        for (stretch, length) in names.lengths(next) {
            if stretch.robot == robot {
                of.keep(stretch.first, length, robot, stretch.seq);
                continue;
            }
            for index in (stretch.first..stretch.first + length).filter(|k| also(*k)) {
                of.keep(index, 1, robot, fresh);
                fresh += 1;
            }
        }
        if of.names.0.is_empty() {
            of.names.0.push(Stretch { first: 0, robot, seq: 0 });
        }
        of
    }

    /// Keeps some ids, which go on where the last ones end where they can.
    fn keep(&mut self, first: usize, length: usize, robot: RobotId, seq: u32) {
        if length == 0 {
            return;
        }
        let goes_on =
            self.names.0.last().is_some_and(|s| s.seq as usize + (self.next - s.first) == seq as usize);
        if !goes_on {
            self.names.0.push(Stretch { first: self.next, robot, seq });
        }
        match self.kept.last_mut().filter(|(at, n, _)| at + *n == first) {
            Some((_, n, _)) => *n += length,
            None => self.kept.push((first, length, self.next)),
        }
        self.next += length;
    }

    /// The index after.
    fn index(&self, before: usize) -> Option<usize> {
        let at = self.kept.partition_point(|(first, ..)| *first <= before).checked_sub(1)?;
        let (first, length, after) = self.kept.get(at)?;
        (before - first < *length).then(|| after + before - first)
    }
}
