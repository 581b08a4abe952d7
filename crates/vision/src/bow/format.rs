//! The vocabulary file format and its validation.
//!
//! All numbers are little-endian. A header of 64 bytes is followed by three arrays over the nodes in breadth-first
//! order, so that the children of a node are contiguous and followed by those of the next node:
//!
//! | offset | content |
//! |---|---|
//! | 0 | `CAIRNVOC` |
//! | 8 | version, u32: 1 |
//! | 12 | CRC-32 (IEEE) of everything that follows, u32 |
//! | 16 | branching: maximum number of children of a node, u32 |
//! | 20 | depth: levels below the root, u32 |
//! | 24 | number of nodes including the root, u32 |
//! | 28 | number of words (leaves), u32 |
//! | 32 | level of the direct index, u32 |
//! | 36 | number of training images, u32; 0 if unknown |
//! | 40 | number of training descriptors, u64; 0 if unknown |
//! | 48 | training seed, u64 |
//! | 56 | zero, 8 bytes |
//! | 64 | centres: 32 bytes per node; the root's is zero |
//! | .. | first child of each node, u32, plus one final entry: node `n` has the children `first[n]..first[n + 1]` |
//! | .. | weight of each node, f32: the inverse document frequency of a word, zero for inner nodes |

use super::error::{VERSION, VocabularyError};
use crate::Descriptor;

pub(super) const MAGIC: [u8; 8] = *b"CAIRNVOC";
pub(super) const HEADER_BYTES: usize = 64;
/// Limits on branching, depth and node count, far above any useful size: they bound the work on a corrupt file.
pub(super) const MAX_BRANCHING: u32 = 4096;
pub(super) const MAX_DEPTH: u32 = 16;
pub(super) const MAX_NODES: u32 = 1 << 26;

/// Header of a vocabulary: size, origin and checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct VocabularyFacts {
    /// Maximum number of children of a node.
    pub branching: u32,
    /// Levels below the root.
    pub depth: u32,
    /// Number of nodes including the root.
    pub nodes: u32,
    /// Number of words (leaves).
    pub words: u32,
    /// Level of the direct index, whose node a bag keeps for each feature; the root is level 0.
    pub index_level: u32,
    /// Number of training images; 0 if unknown.
    pub images: u32,
    /// Number of training descriptors; 0 if unknown.
    pub descriptors: u64,
    /// Training seed.
    pub seed: u64,
    /// CRC-32 of the file: bags of vocabularies with different checksums cannot be compared.
    pub checksum: u32,
}

/// The arrays of the file, borrowed from its bytes.
#[derive(Clone, Copy)]
pub(super) struct Arrays<'a> {
    pub centres: &'a [Descriptor],
    first: &'a [[u8; 4]],
    weights: &'a [[u8; 4]],
}

impl<'a> Arrays<'a> {
    /// The arrays for a number of nodes; `bytes` must have the matching [`file_length`].
    pub fn of(bytes: &'a [u8], nodes: usize) -> Self {
        let (centres, rest) = bytes[HEADER_BYTES..].split_at(nodes * 32);
        let (first, weights) = rest.split_at((nodes + 1) * 4);
        Self { centres: centres.as_chunks().0, first: first.as_chunks().0, weights: weights.as_chunks().0 }
    }

    /// Children of a node; empty for a word.
    #[inline]
    pub fn children(&self, node: usize) -> std::ops::Range<usize> {
        let at = |i: usize| u32::from_le_bytes(self.first[i]) as usize;
        at(node)..at(node + 1)
    }

    /// Weight of a node.
    #[inline]
    pub fn weight(&self, node: usize) -> f32 {
        f32::from_le_bytes(self.weights[node])
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

/// Length in bytes of a vocabulary file with this number of nodes.
pub(super) fn file_length(nodes: u32) -> usize {
    HEADER_BYTES + nodes as usize * 40 + 4
}

/// Validates the whole file and returns its header: every number that quantisation relies on is checked here.
pub(super) fn check(bytes: &[u8]) -> Result<VocabularyFacts, VocabularyError> {
    if bytes.len() < HEADER_BYTES || bytes[..8] != MAGIC {
        return Err(VocabularyError::NotAVocabulary);
    }
    let version = u32_at(bytes, 8);
    if version != VERSION {
        return Err(VocabularyError::Version(version));
    }
    let facts = VocabularyFacts {
        branching: u32_at(bytes, 16),
        depth: u32_at(bytes, 20),
        nodes: u32_at(bytes, 24),
        words: u32_at(bytes, 28),
        index_level: u32_at(bytes, 32),
        images: u32_at(bytes, 36),
        descriptors: u64_at(bytes, 40),
        seed: u64_at(bytes, 48),
        checksum: u32_at(bytes, 12),
    };
    if facts.nodes < 2 || facts.nodes > MAX_NODES {
        return Err(VocabularyError::Content("the number of nodes"));
    }
    let expected = file_length(facts.nodes);
    if bytes.len() != expected {
        return Err(VocabularyError::Length { found: bytes.len(), expected });
    }
    if crc32fast::hash(&bytes[16..]) != facts.checksum {
        return Err(VocabularyError::Checksum);
    }
    content(&Arrays::of(bytes, facts.nodes as usize), &facts)?;
    Ok(facts)
}

/// Checks that the nodes form a tree of the size that the header gives.
fn content(a: &Arrays, facts: &VocabularyFacts) -> Result<(), VocabularyError> {
    let nodes = facts.nodes as usize;
    if facts.branching > MAX_BRANCHING {
        return Err(VocabularyError::Content("the number of children of a node"));
    }
    if a.children(0).start != 1 || a.children(nodes - 1).end != nodes {
        return Err(VocabularyError::Content("nodes without a parent"));
    }
    let mut words = 0;
    for n in 0..nodes {
        let children = a.children(n);
        if children.start > children.end || children.len() > facts.branching as usize {
            return Err(VocabularyError::Content("the number of children of a node"));
        }
        // Every descent ends, because children always come after their parent.
        if !children.is_empty() && children.start <= n {
            return Err(VocabularyError::Content("a node that is its own descendant"));
        }
        words += u32::from(children.is_empty());
        if !(a.weight(n) >= 0.0 && a.weight(n).is_finite()) {
            return Err(VocabularyError::Content("the weight of a word"));
        }
    }
    if words != facts.words {
        return Err(VocabularyError::Content("the number of words"));
    }
    // The children of the nodes of one level are the next level, contiguous.
    let (mut level, mut depth) = (0..1, 0);
    loop {
        level = a.children(level.start).start..a.children(level.end - 1).end;
        if level.is_empty() {
            break;
        }
        depth += 1;
        if depth > MAX_DEPTH {
            return Err(VocabularyError::Content("the number of levels"));
        }
    }
    if depth != facts.depth || facts.index_level > depth {
        return Err(VocabularyError::Content("the number of levels"));
    }
    Ok(())
}
