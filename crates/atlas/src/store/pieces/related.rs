//! How key frames of pieces lie to each other by their depth: told of a map, what changed of it, and given back to it.

use super::relative::Relative;
use super::state::State;
use crate::{KeyFrame, KeyFrameId, Snapshot};
use serde::{Deserialize, Serialize};

/// So many of a map at most.
const MAX_ALL: usize = 1 << 20;

/// What changed of them: the key frame and the earlier one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct RelativeDelta {
    gone: Vec<[u32; 2]>,
    new: Vec<([u32; 2], Relative)>,
}

impl State {
    /// Adds the relative poses of a map, as they were known `before` where they hardly changed.
    pub(super) fn relate(&mut self, s: &Snapshot, before: &Self) {
        for k in s.key_frames() {
            for z in &k.relative_poses {
                let (at, now) = ([k.id.raw(), z.from.raw()], Relative::of(z));
                let known = before.relative.get(&at).filter(|known| known.is_near(z, &now));
                let kept = known.cloned().unwrap_or(now);
                if kept.root().is_some() && self.relative.len() < MAX_ALL {
                    self.relative.insert(at, kept);
                }
            }
        }
    }
}

impl RelativeDelta {
    /// What leads from one state to another.
    pub fn between(a: &State, b: &State) -> Self {
        let gone = a.relative.keys().filter(|at| !b.relative.contains_key(*at)).copied().collect();
        let new = b.relative.iter().filter(|(at, z)| a.relative.get(*at) != Some(z));
        Self { gone, new: new.map(|(at, z)| (*at, z.clone())).collect() }
    }

    /// Makes the changes; `None` where they do not fit what is known.
    pub fn apply(self, to: &mut State) -> Option<()> {
        for at in &self.gone {
            to.relative.remove(at)?;
        }
        to.relative.extend(self.new);
        (to.relative.len() <= MAX_ALL).then_some(())
    }
}

/// Gives key frames their relative poses; `Err` has the number of the first that cannot be.
pub(super) fn give(state: &State, key_frames: &mut [KeyFrame]) -> Result<(), u32> {
    for ([raw, from], z) in &state.relative {
        let at = |raw: u32| {
            let id = KeyFrameId::from_raw(raw)?;
            key_frames.binary_search_by_key(&id, |k| k.id).ok()
        };
        let (here, from) = at(*raw).zip(at(*from)).ok_or(*raw)?;
        let of_map = from < here && key_frames[from].map == key_frames[here].map;
        let z = z.measured(key_frames[from].id).filter(|z| of_map && z.is_sound());
        key_frames[here].relative_poses.push(z.ok_or(*raw)?);
    }
    Ok(())
}
