//! What changed of motions and readings.

use super::super::state::State;
use super::{MAX_ALL, Motion, Readings};
use serde::{Deserialize, Serialize};

/// Readings of a key frame without their values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ReadingsHead {
    pub(super) key_frame: u32,
    since: u32,
    noise: u32,
    begins: i64,
    pub(super) count: u32,
    scales: Vec<(u32, f32)>,
}

/// What changed of motions and readings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in super::super) struct MotionDelta {
    pub(super) motions: Vec<(u32, Option<Motion>)>,
    /// Readings of the first continue those of the second, which they began at.
    pub(super) joined: Vec<(u32, u32)>,
    /// Key frames without readings now.
    pub(super) gone: Vec<u32>,
    pub(super) heads: Vec<ReadingsHead>,
    /// Of all these readings: the difference of each step to the one before, and of each value.
    pub(super) steps: Vec<i32>,
    pub(super) values: [Vec<i32>; 6],
}

impl MotionDelta {
    /// What leads from one state to another, where some key frames come anew.
    pub fn between(a: &State, b: &State, is_dropped: impl Fn(u32) -> bool) -> Self {
        let mut delta = Self::default();
        let (mut step, mut values) = (0u32, [0i32; 6]);
        for (id, k) in &b.key_frames {
            let was = a.key_frames.get(id).filter(|_| !is_dropped(*id));
            if was.and_then(|was| was.motion) != k.motion {
                delta.motions.push((*id, k.motion));
            }
            let known = was.and_then(|was| was.readings.as_ref());
            if known == k.readings.as_ref() {
                continue;
            }
            let Some(readings) = &k.readings else {
                delta.gone.push(*id);
                continue;
            };
            let joined = was.and_then(|_| a.readings_since(*id, readings.since));
            if let Some((_, between)) = joined.filter(|(joined, _)| joined == readings) {
                delta.joined.extend(between.into_iter().map(|of| (*id, of)));
                continue;
            }
            let r = readings;
            delta.heads.push(ReadingsHead {
                key_frame: *id,
                since: r.since,
                noise: r.noise,
                begins: r.begins,
                count: r.values.len() as u32,
                scales: r.scales.clone(),
            });
            for (now, of) in r.steps.iter().zip(&r.values) {
                delta.steps.push(now.wrapping_sub(std::mem::replace(&mut step, *now)).cast_signed());
                for ((column, v), was) in delta.values.iter_mut().zip(of).zip(&mut values) {
                    column.push(v.wrapping_sub(std::mem::replace(was, *v)));
                }
            }
        }
        delta
    }

    /// Joins readings, while the key frames that they go through are there.
    pub fn join(&self, to: &mut State) -> Option<()> {
        // Each joins what there was before.
        let (mut joined, mut count): (Vec<(u32, Readings)>, usize) = (Vec::new(), 0);
        for (id, between) in &self.joined {
            let last = joined.last().filter(|(last, _)| last == id).map(|(_, r)| r);
            let of = last.or(to.key_frames.get(id)?.readings.as_ref()).filter(|r| r.since == *between)?;
            let all = to.key_frames.get(between)?.readings.as_ref()?.then(of)?;
            if last.is_some() {
                joined.pop();
            }
            count += all.values.len();
            if count > MAX_ALL {
                return None;
            }
            joined.push((*id, all));
        }
        for (id, readings) in joined {
            to.key_frames.get_mut(&id)?.readings = Some(readings);
        }
        Some(())
    }

    /// Makes all other changes; `None` where they do not fit what is known, or there is too much.
    pub fn apply(self, to: &mut State) -> Option<()> {
        for (id, motion) in self.motions {
            to.key_frames.get_mut(&id)?.motion = motion;
        }
        for id in self.gone {
            to.key_frames.get_mut(&id)?.readings.take()?;
        }
        let n = self.steps.len();
        if n > MAX_ALL || self.values.iter().any(|column| column.len() != n) {
            return None;
        }
        let (mut at, mut step, mut values) = (0usize, 0u32, [0i32; 6]);
        for head in self.heads {
            let end = at.checked_add(head.count as usize).filter(|end| *end <= n)?;
            let ReadingsHead { since, noise, begins, scales, .. } = head;
            let mut of = Readings { since, noise, begins, steps: Vec::new(), values: Vec::new(), scales };
            for i in at..end {
                step = step.wrapping_add(self.steps[i].cast_unsigned());
                values.iter_mut().zip(&self.values).for_each(|(v, column)| *v = v.wrapping_add(column[i]));
                of.steps.push(step);
                of.values.push(values);
            }
            at = end;
            to.key_frames.get_mut(&head.key_frame)?.readings = Some(of);
        }
        let all: usize = to.key_frames.values().flat_map(|k| &k.readings).map(|r| r.values.len()).sum();
        (at == n && all <= MAX_ALL).then_some(())
    }
}
