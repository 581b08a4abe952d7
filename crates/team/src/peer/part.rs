//! What a robot published, as far as it has arrived.

use super::message::{Manifest, Stamp, WINDOW, WINDOW_BYTES};
use super::seal::hash;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Blocks that did not come within so many ticks after the last one that did are asked for again, of another peer: who sends slowly
/// is waited for.
const PATIENCE_TICKS: usize = 5;

#[derive(Clone, Debug)]
pub(super) struct Part {
    pub manifest: Manifest,
    pub stamp: Stamp,
    blocks: Vec<Option<Arc<Vec<u8>>>>,
    missing: usize,
    /// Blocks that were asked for and have not come yet, and the tick at which they were, or at which another one came since.
    asked: BTreeMap<u16, usize>,
}

impl Part {
    /// Starts with those blocks that another version of the part already has.
    pub fn new(manifest: Manifest, before: &[&Part]) -> Self {
        let mut known = BTreeMap::new();
        for part in before {
            let with_hash = part.manifest.blocks.iter().zip(&part.blocks);
            known.extend(with_hash.filter_map(|(entry, block)| Some((*entry, block.clone()?))));
        }
        let blocks: Vec<_> = manifest.blocks.iter().map(|entry| known.get(entry).cloned()).collect();
        let missing = blocks.iter().filter(|b| b.is_none()).count();
        let stamp = manifest.stamp();
        Self { manifest, stamp, blocks, missing, asked: BTreeMap::new() }
    }

    pub fn whole(manifest: Manifest, blocks: &[&[u8]]) -> Self {
        let blocks = blocks.iter().map(|b| Some(Arc::new(b.to_vec()))).collect();
        let stamp = manifest.stamp();
        Self { manifest, stamp, blocks, missing: 0, asked: BTreeMap::new() }
    }

    pub fn is_complete(&self) -> bool {
        self.missing == 0
    }

    pub fn block(&self, index: u16) -> Option<&Arc<Vec<u8>>> {
        self.blocks.get(usize::from(index))?.as_ref()
    }

    /// The blocks that are there.
    pub fn blocks(&self) -> Vec<&[u8]> {
        self.blocks.iter().flatten().map(|block| &block[..]).collect()
    }

    pub fn bytes(&self) -> Vec<u8> {
        self.blocks.iter().flatten().flat_map(|block| block.iter().copied()).collect()
    }

    /// Accepts a block; false when it is not the one that the manifest names.
    pub fn put(&mut self, index: u16, bytes: Vec<u8>, now: usize) -> bool {
        let k = usize::from(index);
        let Some(expected) = self.manifest.blocks.get(k) else { return false };
        if (hash::<16>(&bytes), bytes.len() as u32) != *expected {
            return false;
        }
        self.asked.remove(&index);
        self.asked.values_mut().for_each(|tick| *tick = now);
        // The same block may be needed in several places.
        let bytes = Arc::new(bytes);
        for (slot, entry) in self.blocks.iter_mut().zip(&self.manifest.blocks) {
            if entry == expected && slot.is_none() {
                *slot = Some(bytes.clone());
                self.missing -= 1;
            }
        }
        true
    }

    /// The next blocks to ask for: those that nobody was asked for, or that did not come for long, as long as not too many
    /// are on their way.
    pub fn next(&mut self, now: usize) -> Vec<u16> {
        let (asked, blocks) = (&mut self.asked, &self.blocks);
        let is_missing = |k: u16| blocks.get(usize::from(k)).is_some_and(Option::is_none);
        asked.retain(|k, tick| is_missing(*k) && now.saturating_sub(*tick) < PATIENCE_TICKS);
        let length = |k: u16| self.manifest.blocks.get(usize::from(k)).map_or(0, |(_, n)| *n as usize);
        let mut bytes: usize = asked.keys().map(|k| length(*k)).sum();
        let mut next = Vec::new();
        for k in (0..blocks.len()).filter_map(|k| u16::try_from(k).ok()) {
            if asked.len() >= WINDOW || bytes >= WINDOW_BYTES {
                break;
            }
            if is_missing(k) && !asked.contains_key(&k) {
                asked.insert(k, now);
                bytes += length(k);
                next.push(k);
            }
        }
        next
    }

    /// Whether so few are on their way that the next can be asked for.
    pub fn has_room(&self) -> bool {
        2 * self.asked.len() <= WINDOW
    }
}
