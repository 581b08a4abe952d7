//! What a robot published, as far as it has arrived.

use super::message::{Manifest, Stamp, WINDOW};
use super::seal::hash;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(super) struct Part {
    pub manifest: Manifest,
    pub stamp: Stamp,
    blocks: Vec<Option<Arc<Vec<u8>>>>,
    missing: usize,
    /// Blocks that were asked for and have not come yet.
    asked: BTreeSet<u16>,
}

impl Part {
    /// Starts with those blocks that another version of the part already has.
    pub fn new(manifest: Manifest, before: &[&Part]) -> Self {
        let mut known = BTreeMap::new();
        for part in before {
            let with_hash = part.manifest.blocks.iter().zip(&part.blocks);
            known.extend(with_hash.filter_map(|(hash, block)| Some((*hash, block.clone()?))));
        }
        let blocks: Vec<_> = manifest.blocks.iter().map(|hash| known.get(hash).cloned()).collect();
        let missing = blocks.iter().filter(|b| b.is_none()).count();
        let stamp = manifest.stamp();
        Self { manifest, stamp, blocks, missing, asked: BTreeSet::new() }
    }

    pub fn whole(manifest: Manifest, bytes: &[u8]) -> Self {
        let blocks = bytes.chunks(super::BLOCK_BYTES).map(|b| Some(Arc::new(b.to_vec()))).collect();
        let stamp = manifest.stamp();
        Self { manifest, stamp, blocks, missing: 0, asked: BTreeSet::new() }
    }

    pub fn is_complete(&self) -> bool {
        self.missing == 0
    }

    pub fn block(&self, index: u16) -> Option<&Arc<Vec<u8>>> {
        self.blocks.get(usize::from(index))?.as_ref()
    }

    pub fn bytes(&self) -> Vec<u8> {
        self.blocks.iter().flatten().flat_map(|block| block.iter().copied()).collect()
    }

    /// Accepts a block; false when it is not the one that the manifest names.
    pub fn put(&mut self, index: u16, bytes: Vec<u8>) -> bool {
        let k = usize::from(index);
        let Some(expected) = self.manifest.blocks.get(k) else { return false };
        if bytes.len() != self.manifest.block_length(k) || hash::<16>(&bytes) != *expected {
            return false;
        }
        self.asked.remove(&index);
        if let Some(slot @ None) = self.blocks.get_mut(k) {
            *slot = Some(Arc::new(bytes));
            self.missing -= 1;
        }
        true
    }

    /// Whether nothing that was asked for is still to come.
    pub fn is_idle(&self) -> bool {
        self.asked.is_empty()
    }

    /// The next blocks to ask for. Those that did not come are asked for again.
    pub fn next(&mut self) -> Vec<u16> {
        let missing = self.blocks.iter().enumerate().filter(|(_, block)| block.is_none());
        let next: Vec<u16> = missing.filter_map(|(k, _)| u16::try_from(k).ok()).take(WINDOW).collect();
        self.asked = next.iter().copied().collect();
        next
    }
}
