//! The vocabulary: a checked view of its file, and the way of descriptors down its tree.

use super::bag::Bag;
use super::format::{self, Arrays};
use super::{VocabularyError, WordId};
use crate::{Descriptor, best_two_of};
use std::borrow::Cow;
use std::sync::OnceLock;

/// What a vocabulary is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct VocabularyFacts {
    /// Children of a node, at most.
    pub branching: u32,
    /// Levels below the root.
    pub depth: u32,
    /// Nodes with the root.
    pub nodes: u32,
    /// Leaves.
    pub words: u32,
    /// The level whose nodes a bag keeps for each feature; the root's is 0.
    pub index_level: u32,
    /// Images it was trained on; 0 where that is not known.
    pub images: u32,
    /// Descriptors it was trained on; 0 where that is not known.
    pub descriptors: u64,
    /// Seed of the training.
    pub seed: u64,
    /// CRC-32 of the file: bags of vocabularies that differ in it can not be compared.
    pub checksum: u32,
}

/// A tree of words over binary descriptors; see the module's page.
#[derive(Clone)]
pub struct Vocabulary {
    bytes: Cow<'static, [u8]>,
    facts: VocabularyFacts,
}

impl std::fmt::Debug for Vocabulary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.facts.fmt(f)
    }
}

/// Where it came from is written in `vocabulary/PROVENANCE.md`.
static EMBEDDED: &[u8] = include_bytes!("../../vocabulary/cairn.voc");

impl Vocabulary {
    /// Uses the bytes of a vocabulary file as they are: borrowed for good (embedded, mapped) or owned.
    ///
    /// # Errors
    /// When they are no vocabulary of this version, or not whole.
    pub fn open(bytes: impl Into<Cow<'static, [u8]>>) -> Result<Self, VocabularyError> {
        let bytes = bytes.into();
        let facts = format::check(&bytes)?;
        Ok(Self { bytes, facts })
    }

    /// The vocabulary that is part of this program; checked at the first call.
    pub fn embedded() -> &'static Self {
        static OPENED: OnceLock<Vocabulary> = OnceLock::new();
        OPENED
            .get_or_init(|| Self::open(EMBEDDED).expect("the embedded vocabulary is whole: a test holds it"))
    }

    /// Size, origin and checksum.
    pub fn facts(&self) -> &VocabularyFacts {
        &self.facts
    }

    /// The bytes of its file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The word of a descriptor.
    pub fn word(&self, descriptor: &Descriptor) -> WordId {
        let (word, _) = self.descend(&self.arrays(), descriptor);
        WordId(word)
    }

    /// How rare a word is: the logarithm of the share of images that do not show it; zero for what is no word.
    pub fn weight(&self, word: WordId) -> f32 {
        let node = word.0 as usize;
        if node < self.facts.nodes as usize { self.arrays().weight(node) } else { 0.0 }
    }

    /// The words of an image (at most 65,535 features; what is beyond is left out), weighted by term frequency and
    /// inverse document frequency and scaled to the sum 1, with the node of each feature.
    pub fn bag(&self, descriptors: &[Descriptor]) -> Bag {
        let arrays = self.arrays();
        let mut words = Vec::with_capacity(descriptors.len());
        let mut nodes = Vec::with_capacity(descriptors.len());
        for (i, d) in descriptors.iter().take(u16::MAX as usize).enumerate() {
            let (word, node) = self.descend(&arrays, d);
            words.push(word);
            nodes.push((node, i as u16));
        }
        words.sort_unstable();
        let weighted = words.chunk_by(|a, b| a == b).map(|same| {
            let word = same[0];
            (WordId(word), same.len() as f64 * f64::from(arrays.weight(word as usize)))
        });
        Bag::new(weighted.collect(), nodes)
    }

    /// The leaf where a descriptor ends, and the node it passes at the level of the index (or the leaf, where that
    /// comes first).
    #[inline]
    fn descend(&self, arrays: &Arrays, descriptor: &Descriptor) -> (u32, u32) {
        let (mut node, mut passed) = (0, 0);
        let mut level = 0;
        loop {
            if level <= self.facts.index_level {
                passed = node;
            }
            let children = arrays.children(node);
            if children.is_empty() {
                return (node as u32, passed as u32);
            }
            let best = best_two_of(descriptor, &arrays.centres[children.clone()]);
            node = children.start + best.index as usize;
            level += 1;
        }
    }

    fn arrays(&self) -> Arrays<'_> {
        Arrays::of(&self.bytes, self.facts.nodes as usize)
    }
}
