//! The names of what a map holds.

use crate::names::*;
use crate::{KeyFrameId, LandmarkId, Snapshot};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

impl Snapshot {
    /// The same snapshot in which this robot creates the next key frames and landmarks: its numbers go on where they
    /// ended.
    pub fn continued_by(mut self, robot: RobotId) -> Self {
        let names = Arc::make_mut(&mut self.names);
        names.key_frames.continue_as(robot, self.next_key_frame);
        names.landmarks.continue_as(robot, self.next_landmark);
        self
    }

    /// The robots that created key frames here, each with how many of them exist.
    pub fn robots(&self) -> BTreeMap<RobotId, usize> {
        let mut count = BTreeMap::new();
        for k in self.key_frames() {
            *count.entry(self.key_frame_name(k.id).robot).or_insert(0) += 1;
        }
        count
    }

    /// The lasting name of a key frame, also of a removed one.
    pub fn key_frame_name(&self, id: KeyFrameId) -> KeyFrameName {
        let (robot, seq) = self.names.key_frames.name(id.index());
        KeyFrameName { robot, seq }
    }

    /// The id in this atlas of the key frame with a name, also of a removed one; `None` where it was never here.
    pub fn key_frame_named(&self, name: KeyFrameName) -> Option<KeyFrameId> {
        KeyFrameId::from_index(self.names.key_frames.index(name.robot, name.seq, self.next_key_frame)?)
    }

    /// The lasting name of a landmark, also of a removed one.
    pub fn landmark_name(&self, id: LandmarkId) -> LandmarkName {
        let (robot, seq) = self.names.landmarks.name(id.index());
        LandmarkName { robot, seq }
    }

    /// New numbers for those robots of another snapshot of which both have a key frame or landmark of the same name;
    /// `None` when there are no more numbers.
    pub(crate) fn renamed_robots(&self, other: &Snapshot) -> Option<BTreeMap<RobotId, RobotId>> {
        let (a, b) = (&self.names, &other.names);
        let key_frames = a.key_frames.clashes(self.next_key_frame, &b.key_frames, other.next_key_frame);
        let landmarks = a.landmarks.clashes(self.next_landmark, &b.landmarks, other.next_landmark);
        let clashes: BTreeSet<RobotId> = key_frames.chain(landmarks).collect();
        let all = [a, b].into_iter().flat_map(|n| n.key_frames.0.iter().chain(&n.landmarks.0));
        let mut taken: BTreeSet<RobotId> = all.map(|s| s.robot).collect();
        let mut renamed = BTreeMap::new();
        for robot in clashes {
            let free = (0..=RobotId::MAX).find(|r| !taken.contains(r))?;
            taken.insert(free);
            renamed.insert(robot, free);
        }
        Some(renamed)
    }

    /// The names after those of another snapshot have been added.
    pub(crate) fn names_with(&self, other: &Snapshot, renamed: &BTreeMap<RobotId, RobotId>) -> Names {
        let mut names = (*self.names).clone();
        let add = &other.names;
        names.key_frames.append(self.next_key_frame, &add.key_frames, other.next_key_frame, renamed);
        names.landmarks.append(self.next_landmark, &add.landmarks, other.next_landmark, renamed);
        names
    }
}
