//! Serialises a tree to the bytes of a vocabulary file.

use super::error::VERSION;
use super::format::{HEADER_BYTES, MAGIC, MAX_NODES, file_length};
use crate::Descriptor;

/// A tree whose nodes are stored level by level (breadth first); node 0 is the root.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    pub centres: Vec<Descriptor>,
    /// First child of each node, plus one final entry.
    pub first: Vec<u32>,
    /// Zero for inner nodes.
    pub weights: Vec<f32>,
}

/// Header fields that do not follow from the tree.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Header {
    pub branching: u32,
    /// Level of the direct index; `None` chooses the first level with at least [`INDEX_NODES`] nodes.
    pub index_level: Option<u32>,
    pub images: u32,
    pub descriptors: u64,
    pub seed: u64,
}

/// Minimum number of nodes on the automatically chosen level of the direct index.
const INDEX_NODES: usize = 64;

impl Tree {
    /// The bytes of the file; `None` when there are too many nodes or only the root.
    pub fn to_bytes(&self, header: &Header) -> Option<Vec<u8>> {
        let nodes = u32::try_from(self.centres.len()).ok().filter(|n| (2..=MAX_NODES).contains(n))?;
        let levels = self.levels();
        let depth = levels.len() - 1;
        let automatic = || levels.iter().position(|n| *n >= INDEX_NODES).unwrap_or(depth);
        let index_level = header.index_level.unwrap_or(automatic() as u32).min(depth as u32);
        let words = (0..self.centres.len()).filter(|n| self.first[*n] == self.first[n + 1]).count();

        let mut out = Vec::with_capacity(file_length(nodes));
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend([0; 4]);
        for v in [header.branching, depth as u32, nodes, words as u32, index_level, header.images] {
            out.extend(v.to_le_bytes());
        }
        out.extend(header.descriptors.to_le_bytes());
        out.extend(header.seed.to_le_bytes());
        out.resize(HEADER_BYTES, 0);
        out.extend(self.centres.as_flattened());
        out.extend(self.first.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(self.weights.iter().flat_map(|v| v.to_le_bytes()));
        let checksum = crc32fast::hash(&out[16..]);
        out[12..16].copy_from_slice(&checksum.to_le_bytes());
        Some(out)
    }

    /// Number of nodes on each level, starting with the root.
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
