//! The vocabulary: a validated view of its file, and quantisation of descriptors by descending its tree.

use super::bag::{BagOfWords, WordId};
use super::error::VocabularyError;
use super::format::{self, Arrays, VocabularyFacts};
use crate::{Descriptor, best_two_of};
use std::borrow::Cow;
use std::sync::OnceLock;

/// A vocabulary tree over binary descriptors; see the [module documentation](super).
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

/// Its origin is documented in `vocabulary/PROVENANCE.md`.
static EMBEDDED: &[u8] = include_bytes!("../../vocabulary/cairn.voc");

/// See [`Vocabulary::current`].
static CURRENT: OnceLock<Vocabulary> = OnceLock::new();

impl Vocabulary {
    /// Opens the bytes of a vocabulary file in place, either borrowed (`'static`: embedded or mapped) or owned.
    ///
    /// # Errors
    /// When the bytes are not a vocabulary of the supported version, or are truncated or damaged.
    pub fn open(bytes: impl Into<Cow<'static, [u8]>>) -> Result<Self, VocabularyError> {
        let bytes = bytes.into();
        let facts = format::check(&bytes)?;
        Ok(Self { bytes, facts })
    }

    /// The vocabulary embedded in this crate; validated on the first call.
    pub fn embedded() -> &'static Self {
        static OPENED: OnceLock<Vocabulary> = OnceLock::new();
        OPENED
            .get_or_init(|| Self::open(EMBEDDED).expect("the embedded vocabulary is valid, as a test checks"))
    }

    /// The vocabulary of this process: the one that was [installed](Self::install), else the embedded one.
    pub fn current() -> &'static Self {
        CURRENT.get_or_init(|| Self::embedded().clone())
    }

    /// Makes this the vocabulary of the process, for words of key frames and of saved maps. Words of different
    /// vocabularies cannot be compared, so there is one for a process, chosen before the first use.
    ///
    /// # Errors
    /// Gives the vocabulary back where another is in use already.
    pub fn install(vocabulary: Self) -> Result<(), Self> {
        CURRENT.set(vocabulary)
    }

    /// Size, origin and checksum.
    pub fn facts(&self) -> &VocabularyFacts {
        &self.facts
    }

    /// The bytes of its file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Quantises a descriptor to its word.
    pub fn word(&self, descriptor: &Descriptor) -> WordId {
        let (word, _) = self.descend(&self.arrays(), descriptor);
        WordId(word)
    }

    /// Inverse document frequency of a word, `ln(images / images that contain it)`; zero for an id that is not a word.
    pub fn weight(&self, word: WordId) -> f32 {
        let node = word.0 as usize;
        if node < self.facts.nodes as usize { self.arrays().weight(node) } else { 0.0 }
    }

    /// The bag of an image (at most 65,535 features; the rest is ignored): words weighted by tf-idf and normalised to
    /// sum 1, with the direct index of the features.
    pub fn bag(&self, descriptors: &[Descriptor]) -> BagOfWords {
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
        BagOfWords::new(weighted.collect(), nodes)
    }

    /// The leaf that a descriptor reaches, and the node it passes at the level of the direct index (or the leaf, if it
    /// is reached first).
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
