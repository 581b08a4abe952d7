//! The bag-of-words vector of one image.

use super::error::VocabularyError;

/// A word of a vocabulary: the index of its leaf among all nodes of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WordId(pub u32);

/// The bag-of-words vector of one image (words and weights) and its direct index (the node of each feature).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BagOfWords {
    /// Sorted by word; weights are positive and sum to 1.
    words: Vec<(WordId, f32)>,
    /// Node and feature index, sorted.
    nodes: Vec<(u32, u16)>,
}

impl BagOfWords {
    /// From sorted words with weights of any scale (words of weight zero are dropped) and nodes in any order.
    pub(super) fn new(words: Vec<(WordId, f64)>, mut nodes: Vec<(u32, u16)>) -> Self {
        let sum: f64 = words.iter().map(|(_, w)| *w).sum();
        let scaled = words.into_iter().map(|(word, w)| (word, (w / sum) as f32));
        let mut words: Vec<(WordId, f32)> = scaled.filter(|(_, w)| *w > 0.0).collect();
        nodes.sort_unstable();
        // A key frame keeps its bag for as long as the map lasts.
        words.shrink_to_fit();
        nodes.shrink_to_fit();
        Self { words, nodes }
    }

    /// A bag from the values of [`BagOfWords::words`] and [`BagOfWords::nodes`], for loading one from a file.
    ///
    /// # Errors
    /// When the words or nodes are not strictly sorted, or a weight is not in `0 < weight <= 1`.
    pub fn from_parts(words: Vec<(WordId, f32)>, nodes: Vec<(u32, u16)>) -> Result<Self, VocabularyError> {
        let sorted = words.windows(2).all(|w| w[0].0 < w[1].0) && nodes.windows(2).all(|n| n[0] < n[1]);
        if !sorted || !words.iter().all(|(_, w)| *w > 0.0 && *w <= 1.0) {
            return Err(VocabularyError::Content("a bag of words"));
        }
        Ok(Self { words, nodes })
    }

    /// The words in rising order with their weights, which sum to 1.
    pub fn words(&self) -> &[(WordId, f32)] {
        &self.words
    }

    /// The direct index: node and feature index, sorted, so that the features below one node are contiguous.
    pub fn nodes(&self) -> &[(u32, u16)] {
        &self.nodes
    }

    /// True when the bag has no words.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// L1 similarity score of two images, 0 to 1: `1 - |v - w| / 2` (Galvez-Lopez and Tardos 2012, equation 2). For
    /// weights that sum to 1 it equals the sum over the common words of the smaller weight.
    pub fn similarity(&self, other: &BagOfWords) -> f64 {
        let (mut i, mut j, mut sum) = (0, 0, 0.0);
        while let (Some((a, v)), Some((b, w))) = (self.words.get(i), other.words.get(j)) {
            if a == b {
                sum += f64::from(v.min(*w));
            }
            i += usize::from(a <= b);
            j += usize::from(b <= a);
        }
        sum
    }
}
