//! The words of one image.

use super::VocabularyError;

/// A word of a vocabulary: the number of its leaf among all nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WordId(pub u32);

/// The words of one image with their weights, and which feature passed which node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bag {
    /// Rising by word; weights above zero, sum 1.
    words: Vec<(WordId, f32)>,
    /// Node and feature, rising.
    nodes: Vec<(u32, u16)>,
}

impl Bag {
    /// From rising words with weights of any scale (those without weight are left out) and nodes in any order.
    pub(super) fn new(words: Vec<(WordId, f64)>, mut nodes: Vec<(u32, u16)>) -> Self {
        let sum: f64 = words.iter().map(|(_, w)| *w).sum();
        let scaled = words.into_iter().map(|(word, w)| (word, (w / sum) as f32));
        let words = scaled.filter(|(_, w)| *w > 0.0).collect();
        nodes.sort_unstable();
        Self { words, nodes }
    }

    /// A bag from what [`Bag::words`] and [`Bag::nodes`] gave, for reading it back from a file.
    ///
    /// # Errors
    /// When the words or nodes do not rise, or a weight is not one.
    pub fn from_parts(words: Vec<(WordId, f32)>, nodes: Vec<(u32, u16)>) -> Result<Self, VocabularyError> {
        let rising = words.windows(2).all(|w| w[0].0 < w[1].0) && nodes.windows(2).all(|n| n[0] < n[1]);
        if !rising || !words.iter().all(|(_, w)| *w > 0.0 && *w <= 1.0) {
            return Err(VocabularyError::Content("a bag of words"));
        }
        Ok(Self { words, nodes })
    }

    /// The words, rising, with their weights, which sum to 1.
    pub fn words(&self) -> &[(WordId, f32)] {
        &self.words
    }

    /// Node and feature, rising: the features that passed one node stand side by side.
    pub fn nodes(&self) -> &[(u32, u16)] {
        &self.nodes
    }

    /// True when there is no word.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// How alike two images are, 0 to 1: `1 - |v - w| / 2` in the L1 norm (Galvez-Lopez and Tardos 2012, equation 2), which
    /// for weights that sum to 1 is the sum of the lesser weight of each common word.
    pub fn similarity(&self, other: &Bag) -> f64 {
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
