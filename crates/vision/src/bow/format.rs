//! The file of a vocabulary: what the bytes mean, and the check that they mean it.
//!
//! All numbers little-endian. A head of 64 bytes, then three arrays over the nodes, which stand in the order of a walk
//! level by level, so that the children of a node lie side by side and those of the next node follow:
//!
//! | at | what |
//! |---|---|
//! | 0 | `CAIRNVOC` |
//! | 8 | version, u32: 1 |
//! | 12 | CRC-32 (IEEE) of all that follows, u32 |
//! | 16 | children of a node at most, u32 |
//! | 20 | levels below the root, u32 |
//! | 24 | nodes with the root, u32 |
//! | 28 | words (leaves), u32 |
//! | 32 | level whose nodes a bag keeps for each feature, u32 |
//! | 36 | images trained on, u32; 0 where not known |
//! | 40 | descriptors trained on, u64 |
//! | 48 | seed of the training, u64 |
//! | 56 | zero, 8 bytes |
//! | 64 | centres: nodes times 32 bytes; the root's is zero |
//! | .. | first child of each node, u32, and one more entry: node `n` has the children `first[n]..first[n + 1]` |
//! | .. | weight of each node, f32: for a word its inverse document frequency, else zero |

use super::vocabulary::VocabularyFacts;
use crate::Descriptor;
use std::fmt;

pub(super) const MAGIC: [u8; 8] = *b"CAIRNVOC";
pub(super) const VERSION: u32 = 1;
pub(super) const HEAD: usize = 64;
/// Children of a node, levels and nodes at most: far more than is of use.
pub(super) const MOST_BRANCHING: u32 = 4096;
pub(super) const MOST_DEPTH: u32 = 16;
pub(super) const MOST_NODES: u32 = 1 << 26;

/// Why bytes are no vocabulary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VocabularyError {
    /// Does not begin with the magic of a vocabulary.
    NotAVocabulary,
    /// Written by a later program.
    Version(u32),
    /// The length is not what the head says.
    Length {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        expected: usize,
    },
    /// Some byte is not what was written.
    Checksum,
    /// The checksum is right, and yet the content makes no sense.
    Content(&'static str),
}

impl fmt::Display for VocabularyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotAVocabulary => write!(f, "this is no vocabulary (it does not begin with CAIRNVOC)"),
            Self::Version(v) => {
                write!(f, "the vocabulary has version {v}, this program reads version {VERSION}")
            }
            Self::Length { found, expected } => {
                write!(
                    f,
                    "the vocabulary has {found} bytes, its head asks for {expected}: it is cut off or damaged"
                )
            }
            Self::Checksum => write!(f, "the vocabulary is damaged (its checksum does not fit)"),
            Self::Content(what) => write!(f, "the vocabulary makes no sense: {what}"),
        }
    }
}

impl std::error::Error for VocabularyError {}

/// The arrays, as they lie in the bytes.
#[derive(Clone, Copy)]
pub(super) struct Arrays<'a> {
    pub centres: &'a [Descriptor],
    first: &'a [[u8; 4]],
    weights: &'a [[u8; 4]],
}

impl<'a> Arrays<'a> {
    /// The arrays of so many nodes; `bytes` must have the length for it.
    pub fn of(bytes: &'a [u8], nodes: usize) -> Self {
        let (centres, rest) = bytes[HEAD..].split_at(nodes * 32);
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

/// Bytes of a vocabulary of so many nodes.
pub(super) fn length(nodes: u32) -> usize {
    HEAD + nodes as usize * 40 + 4
}

/// The head, once all of the file is known to be sound: every number that quantising relies on is checked here.
pub(super) fn check(bytes: &[u8]) -> Result<VocabularyFacts, VocabularyError> {
    if bytes.len() < HEAD || bytes[..8] != MAGIC {
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
    if facts.nodes < 2 || facts.nodes > MOST_NODES {
        return Err(VocabularyError::Content("the count of nodes"));
    }
    let expected = length(facts.nodes);
    if bytes.len() != expected {
        return Err(VocabularyError::Length { found: bytes.len(), expected });
    }
    if crc32fast::hash(&bytes[16..]) != facts.checksum {
        return Err(VocabularyError::Checksum);
    }
    content(&Arrays::of(bytes, facts.nodes as usize), &facts).map_err(VocabularyError::Content)?;
    Ok(facts)
}

/// The tree is one, and as large as its head says.
fn content(a: &Arrays, facts: &VocabularyFacts) -> Result<(), &'static str> {
    let nodes = facts.nodes as usize;
    if facts.branching > MOST_BRANCHING {
        return Err("the children of a node");
    }
    if a.children(0).start != 1 || a.children(nodes - 1).end != nodes {
        return Err("nodes without a parent");
    }
    let mut words = 0;
    for n in 0..nodes {
        let children = a.children(n);
        if children.start > children.end || children.len() > facts.branching as usize {
            return Err("the children of a node");
        }
        // A way down always ends, because it only goes on to later nodes.
        if !children.is_empty() && children.start <= n {
            return Err("a node that is its own descendant");
        }
        words += u32::from(children.is_empty());
        if !(a.weight(n) >= 0.0 && a.weight(n).is_finite()) {
            return Err("the weight of a word");
        }
    }
    if words != facts.words {
        return Err("the count of words");
    }
    // The children of the nodes of one level are the next level, side by side.
    let (mut level, mut depth) = (0..1, 0);
    loop {
        level = a.children(level.start).start..a.children(level.end - 1).end;
        if level.is_empty() {
            break;
        }
        depth += 1;
        if depth > MOST_DEPTH {
            return Err("the count of levels");
        }
    }
    if depth != facts.depth || facts.index_level > depth {
        return Err("the count of levels");
    }
    Ok(())
}
