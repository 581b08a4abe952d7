//! A piece: what changed in what a team knows of a map. Numbers that rise are told by their steps, and what belongs together
//! stands together, which packs better.

use super::PartBytes;
use super::motion::MotionDelta;
use super::pose::Pose;
use super::related::RelativeDelta;
use super::state::{Feature, Head, KeyFrameState, LandmarkState, Row, State};
use cairn_vision::Descriptor;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// New features of a key frame: column by column, and the landmarks that they show.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Columns {
    index_steps: Vec<u16>,
    octave: Vec<u8>,
    angle: Vec<u8>,
    x: Vec<i32>,
    y: Vec<i32>,
    disparity: Vec<i32>,
}

/// What changed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Delta {
    version: u64,
    next: [u32; 2],
    head: Option<Head>,
    /// Key frames that are no more, or come anew below.
    dropped: Vec<u32>,
    /// Parent 0: it is forgotten that there was one.
    removed: Vec<(u32, (u32, [f32; 8]))>,
    rows: Vec<(u32, Row)>,
    poses: Vec<(u32, Pose)>,
    features: Vec<(u32, Columns)>,
    /// Of new features the landmarks, each as the difference to the one before.
    shown: Vec<i32>,
    /// Which landmark a feature shows that was sent before.
    changed: Vec<(u32, Vec<(u16, u32)>)>,
    landmark_steps: Vec<u32>,
    anchors: Vec<u32>,
    at: [Vec<i32>; 3],
    descriptor_steps: Vec<u32>,
    descriptors: Vec<Descriptor>,
    motion: MotionDelta,
    relative: RelativeDelta,
    attached: Vec<(String, Option<Vec<u8>>)>,
}

impl Delta {
    /// What leads from one to the other.
    pub fn between(a: &State, b: &State) -> Self {
        let mut delta = Self { version: b.version, next: b.next, ..Self::default() };
        delta.head = (a.head != b.head).then(|| b.head.clone());
        let goes_on = |id: &u32, was: &KeyFrameState| {
            b.key_frames.get(id).is_some_and(|k| {
                k.row.stamp == was.row.stamp
                    && k.features.len() >= was.features.len()
                    && k.features[..was.features.len()] == was.features[..]
            })
        };
        delta.dropped =
            a.key_frames.iter().filter(|(id, was)| !goes_on(id, was)).map(|(id, _)| *id).collect();
        let dropped: BTreeSet<u32> = delta.dropped.iter().copied().collect();
        for (id, k) in &b.key_frames {
            delta.key_frame(*id, a.key_frames.get(id).filter(|_| !dropped.contains(id)), k);
        }
        let new = b.removed.iter().filter(|(id, it)| a.removed.get(id) != Some(it));
        delta.removed = new.map(|(id, it)| (*id, *it)).collect();
        let forgotten = a.removed.keys().filter(|id| !b.removed.contains_key(id));
        delta.removed.extend(forgotten.map(|id| (*id, (0, [0.0; 8]))));
        delta.landmarks(a, b);
        delta.motion = MotionDelta::between(a, b, |id| dropped.contains(&id));
        delta.relative = RelativeDelta::between(a, b);
        let attached = b.attached.iter().filter(|(name, bytes)| a.attached.get(*name) != Some(bytes));
        delta.attached = attached.map(|(name, bytes)| (name.clone(), Some(bytes.clone()))).collect();
        let gone = a.attached.keys().filter(|name| !b.attached.contains_key(*name));
        delta.attached.extend(gone.map(|name| (name.clone(), None)));
        delta
    }

    fn key_frame(&mut self, id: u32, was: Option<&KeyFrameState>, k: &KeyFrameState) {
        if was.is_none_or(|was| was.row != k.row) {
            self.rows.push((id, k.row.clone()));
        }
        if was.is_none_or(|was| was.pose != k.pose) {
            self.poses.push((id, k.pose));
        }
        let sent = was.map_or(0, |was| was.features.len());
        if k.features.len() > sent {
            let mut columns = Columns::default();
            let (mut index, mut landmark) = (0, 0);
            for (f, shown) in k.features.iter().zip(&k.shown).skip(sent) {
                columns.index_steps.push(f.index.wrapping_sub(std::mem::replace(&mut index, f.index)));
                columns.octave.push(f.octave);
                columns.angle.push(f.angle);
                columns.x.push(f.at[0]);
                columns.y.push(f.at[1]);
                columns.disparity.push(f.disparity);
                self.shown.push(shown.wrapping_sub(std::mem::replace(&mut landmark, *shown)).cast_signed());
            }
            self.features.push((id, columns));
        }
        let both = was.into_iter().flat_map(|was| was.shown.iter().zip(&k.shown)).enumerate();
        let changed: Vec<(u16, u32)> =
            both.filter(|(_, (a, b))| a != b).map(|(i, (_, b))| (i as u16, *b)).collect();
        if !changed.is_empty() {
            self.changed.push((id, changed));
        }
    }

    fn landmarks(&mut self, a: &State, b: &State) {
        let (mut moved, mut looks) = (0, 0);
        for (id, l) in &b.landmarks {
            let was = a.landmarks.get(id);
            if was.is_none_or(|was| (was.anchor, was.at) != (l.anchor, l.at)) {
                self.landmark_steps.push(id - std::mem::replace(&mut moved, *id));
                self.anchors.push(l.anchor);
                self.at.iter_mut().zip(l.at).for_each(|(column, v)| column.push(v));
            }
            if was.is_none_or(|was| was.descriptor != l.descriptor) {
                self.descriptor_steps.push(id - std::mem::replace(&mut looks, *id));
                self.descriptors.push(l.descriptor);
            }
        }
    }

    /// Whether nothing changed but the count of changes.
    pub fn is_empty(&self) -> bool {
        *self == Self { version: self.version, next: self.next, ..Self::default() }
    }

    /// Makes the changes; `None` where they do not fit what is known.
    pub fn apply(self, to: &mut State) -> Option<()> {
        (to.version, to.next) = (self.version, self.next);
        if let Some(head) = self.head {
            to.head = head;
        }
        self.motion.join(to)?;
        for id in &self.dropped {
            to.key_frames.remove(id)?;
        }
        for (id, it) in self.removed {
            match it.0 {
                0 => to.removed.remove(&id).map(|_| ())?,
                _ => _ = to.removed.insert(id, it),
            }
        }
        let mut poses: BTreeMap<u32, Pose> = self.poses.into_iter().collect();
        for (id, row) in self.rows {
            match to.key_frames.get_mut(&id) {
                Some(k) => k.row = row,
                None => {
                    let pose = poses.remove(&id)?;
                    to.key_frames.insert(id, KeyFrameState::new(row, pose));
                }
            }
        }
        for (id, pose) in poses {
            to.key_frames.get_mut(&id)?.pose = pose;
        }
        for (id, changed) in self.changed {
            let k = to.key_frames.get_mut(&id)?;
            for (i, landmark) in changed {
                *k.shown.get_mut(usize::from(i))? = landmark;
            }
        }
        let mut shown = self.shown.into_iter();
        for (id, columns) in self.features {
            columns.append(to.key_frames.get_mut(&id)?, &mut shown)?;
        }
        if shown.next().is_some() {
            return None;
        }
        self.motion.apply(to)?;
        self.relative.apply(to)?;
        let ids = sums(&self.landmark_steps);
        let [x, y, z] = &self.at;
        let lengths = [self.anchors.len(), x.len(), y.len(), z.len()];
        let looks: BTreeMap<u32, Descriptor> = sums(&self.descriptor_steps).zip(self.descriptors).collect();
        if lengths != [self.landmark_steps.len(); 4] || looks.len() != self.descriptor_steps.len() {
            return None;
        }
        for (i, id) in ids.enumerate() {
            let (anchor, at) = (self.anchors[i], [x[i], y[i], z[i]]);
            let known = to.landmarks.get(&id).map(|l| l.descriptor);
            let descriptor = looks.get(&id).copied().or(known)?;
            to.landmarks.insert(id, LandmarkState { anchor, at, descriptor });
        }
        for (id, descriptor) in looks {
            to.landmarks.get_mut(&id)?.descriptor = descriptor;
        }
        for (name, bytes) in self.attached {
            match bytes {
                Some(bytes) => drop(to.attached.insert(name, bytes)),
                None => drop(to.attached.remove(&name)?),
            }
        }
        // A landmark that nothing shows any more is no more.
        let seen: BTreeSet<u32> = to.key_frames.values().flat_map(|k| &k.shown).copied().collect();
        to.landmarks.retain(|id, _| seen.contains(id));
        Some(())
    }

    /// Adds up what the bytes are for.
    pub fn count(&self, parts: &mut PartBytes) {
        let bytes = |what: &dyn Fn() -> postcard::Result<Vec<u8>>| what().map_or(0, |bytes| bytes.len());
        parts.features += bytes(&|| postcard::to_stdvec(&self.features));
        parts.shown += bytes(&|| postcard::to_stdvec(&(&self.shown, &self.changed)));
        parts.landmarks += bytes(&|| postcard::to_stdvec(&(&self.landmark_steps, &self.anchors, &self.at)));
        parts.descriptors += bytes(&|| postcard::to_stdvec(&(&self.descriptor_steps, &self.descriptors)));
        parts.imu += bytes(&|| postcard::to_stdvec(&self.motion));
        parts.relative_poses += bytes(&|| postcard::to_stdvec(&self.relative));
        parts.key_frames += bytes(&|| postcard::to_stdvec(&(&self.rows, &self.poses)));
        let other = (self.version, self.next, &self.head, &self.dropped, &self.removed, &self.attached);
        parts.other += bytes(&|| postcard::to_stdvec(&other));
    }
}

impl Columns {
    /// Adds these features to a key frame.
    fn append(self, k: &mut KeyFrameState, shown: &mut impl Iterator<Item = i32>) -> Option<()> {
        let n = self.index_steps.len();
        let lengths = [self.octave.len(), self.angle.len(), self.x.len(), self.y.len(), self.disparity.len()];
        if lengths != [n; 5] || k.features.len() + n > usize::from(u16::MAX) {
            return None;
        }
        let (mut index, mut landmark) = (0u16, 0u32);
        for i in 0..n {
            index = index.wrapping_add(self.index_steps[i]);
            landmark = landmark.wrapping_add(shown.next()?.cast_unsigned());
            k.features.push(Feature {
                index,
                octave: self.octave[i],
                angle: self.angle[i],
                at: [self.x[i], self.y[i]],
                disparity: self.disparity[i],
            });
            k.shown.push(landmark);
        }
        Some(())
    }
}

/// Numbers from their steps.
fn sums(steps: &[u32]) -> impl Iterator<Item = u32> {
    steps.iter().scan(0u32, |sum, step| {
        *sum = sum.wrapping_add(*step);
        Some(*sum)
    })
}
