//! From a tree in memory to the bytes of a vocabulary.

use super::format::{HEAD, MAGIC, MOST_NODES, VERSION, length};
use crate::Descriptor;

/// A tree whose nodes stand level by level; node 0 is the root.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    pub centres: Vec<Descriptor>,
    /// First child of each node, and one entry more.
    pub first: Vec<u32>,
    /// Zero for inner nodes.
    pub weights: Vec<f32>,
}

/// What the head tells besides the tree.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Head {
    pub branching: u32,
    /// Where not given, the first level with at least this many nodes is kept for matching.
    pub index_level: Option<u32>,
    pub images: u32,
    pub descriptors: u64,
    pub seed: u64,
}

/// Nodes that the level kept for matching has, at least.
const INDEX_NODES: usize = 64;

impl Tree {
    /// The file; `None` when there are too many nodes or none but the root.
    pub fn to_bytes(&self, head: &Head) -> Option<Vec<u8>> {
        let nodes = u32::try_from(self.centres.len()).ok().filter(|n| (2..=MOST_NODES).contains(n))?;
        let levels = self.levels();
        let depth = levels.len() - 1;
        let wide = || levels.iter().position(|n| *n >= INDEX_NODES).unwrap_or(depth);
        let index_level = head.index_level.unwrap_or(wide() as u32).min(depth as u32);
        let words = (0..self.centres.len()).filter(|n| self.first[*n] == self.first[n + 1]).count();

        let mut out = Vec::with_capacity(length(nodes));
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend([0; 4]);
        for v in [head.branching, depth as u32, nodes, words as u32, index_level, head.images] {
            out.extend(v.to_le_bytes());
        }
        out.extend(head.descriptors.to_le_bytes());
        out.extend(head.seed.to_le_bytes());
        out.resize(HEAD, 0);
        out.extend(self.centres.as_flattened());
        out.extend(self.first.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(self.weights.iter().flat_map(|v| v.to_le_bytes()));
        let checksum = crc32fast::hash(&out[16..]);
        out[12..16].copy_from_slice(&checksum.to_le_bytes());
        Some(out)
    }

    /// How many nodes each level has, the root's first.
    fn levels(&self) -> Vec<usize> {
        let (mut from, mut to) = (0, 1);
        let mut sizes = Vec::new();
        while from < to {
            sizes.push(to - from);
            (from, to) = (self.first[from] as usize, self.first[to] as usize);
        }
        sizes
    }
}
