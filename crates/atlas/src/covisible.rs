//! Which key frames show landmarks in common, and how many: kept up to date by what changes, since counting anew reads every
//! observation of every landmark of a key frame.

use crate::{KeyFrameId, Observation, Snapshot};

/// Covisible neighbours that a key frame keeps, at most.
const NEIGHBOURS: usize = 40;

/// The first key frame shares so many landmarks more with the second, or fewer.
pub(crate) type Shared = (KeyFrameId, KeyFrameId, i32);

/// A key frame shows a landmark now that these show too (1), or no longer (-1).
pub(crate) fn note(changes: &mut Vec<Shared>, key_frame: KeyFrameId, others: &[Observation], by: i32) {
    for o in others {
        changes.push((key_frame, o.key_frame, by));
        changes.push((o.key_frame, key_frame, by));
    }
}

impl Snapshot {
    /// Brings the counts of shared landmarks up to date, and the covisible neighbours with them.
    pub(crate) fn update_covisible(&mut self, mut changes: Vec<Shared>) {
        changes.sort_unstable();
        for of_one in changes.chunk_by(|a, b| a.0 == b.0) {
            let id = of_one[0].0;
            let Some(k) = self.key_frame(id) else { continue };
            let shares = k.shares.0.as_ref().map_or_else(|| self.shared(id), |before| summed(before, of_one));
            if k.shares.0.as_ref() == Some(&shares) {
                continue;
            }
            if let Some(k) = self.key_frames.get_mut(id.index()) {
                k.covisible = most(&shares);
                k.shares.0 = Some(shares);
            }
        }
    }

    /// Counts anew which key frames share landmarks.
    pub(crate) fn recount_covisible(&mut self) {
        let ids: Vec<KeyFrameId> = self.key_frames().map(|k| k.id).collect();
        for id in ids {
            let shares = self.shared(id);
            if let Some(k) = self.key_frames.get_mut(id.index()) {
                (k.covisible, k.shares.0) = (most(&shares), Some(shares));
            }
        }
    }

    /// Key frames that share landmarks with one, in order, with how many.
    fn shared(&self, id: KeyFrameId) -> Vec<(KeyFrameId, u32)> {
        let mut votes = self.key_frame(id).map_or(Vec::new(), |k| self.votes(k.landmarks.iter().flatten()));
        votes.retain(|(other, _)| *other != id);
        votes.sort_unstable();
        votes
    }
}

/// Counts with changes added to them, both in order; what comes to nothing is left out.
fn summed(before: &[(KeyFrameId, u32)], changes: &[Shared]) -> Vec<(KeyFrameId, u32)> {
    let mut sums = Vec::with_capacity(before.len() + 8);
    let mut rest = before.iter().copied().peekable();
    for of_one in changes.chunk_by(|a, b| a.1 == b.1) {
        let with = of_one[0].1;
        while let Some(smaller) = rest.next_if(|(id, _)| *id < with) {
            sums.push(smaller);
        }
        let count = rest.next_if(|(id, _)| *id == with).map_or(0, |(_, count)| count);
        let sum = count.saturating_add_signed(of_one.iter().map(|(_, _, by)| by).sum());
        if sum > 0 {
            sums.push((with, sum));
        }
    }
    sums.extend(rest);
    sums
}

/// Those that share most, most first.
fn most(shares: &[(KeyFrameId, u32)]) -> Vec<(KeyFrameId, u32)> {
    let key = |(id, count): &(KeyFrameId, u32)| (std::cmp::Reverse(*count), *id);
    let mut best = shares.to_vec();
    if best.len() > NEIGHBOURS {
        best.select_nth_unstable_by_key(NEIGHBOURS - 1, key);
        best.truncate(NEIGHBOURS);
    }
    best.sort_unstable_by_key(key);
    best.shrink_to_fit();
    best
}
