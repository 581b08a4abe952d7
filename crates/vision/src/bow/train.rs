//! Vocabulary training: hierarchical clustering of descriptors into `k` clusters per node under the Hamming distance.
//!
//! Clustering is k-majority (Grana, Borghesani, Manfredi, Cucchiara, "A fast approach for integrating ORB descriptors
//! in the bag of words model", 2013): each bit of a centre is the majority of its members. Initialised by k-means++
//! (Arthur and Vassilvitskii 2007). Deterministic: the same images in the same order with the same seed give the same
//! bytes.

use super::build::{Header, Tree};
use super::format::{MAX_BRANCHING, MAX_DEPTH};
use super::{Vocabulary, VocabularyError};
use crate::{Descriptor, best_two_of, hamming};
use cairn_random::Random;
use std::fmt;

/// Configuration of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainConfig {
    /// Maximum number of children of a node (2 to 4096).
    pub branching: u32,
    /// Levels below the root (1 to 16).
    pub depth: u32,
    /// Random seed.
    pub seed: u64,
    /// Maximum number of iterations of each clustering.
    pub rounds: u32,
    /// Level of the direct index; `None` chooses the first level with at least 64 nodes.
    pub index_level: Option<u32>,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self { branching: 16, depth: 4, seed: 1, rounds: 12, index_level: None }
    }
}

/// Why training failed.
#[derive(Clone, Debug, PartialEq)]
pub enum TrainError {
    /// Branching or depth is out of range.
    Config(&'static str),
    /// Fewer than two different descriptors: nothing to split.
    TooLittle,
    /// More descriptors, images or nodes than the file format can number.
    TooMuch,
    /// The trained vocabulary does not pass validation.
    Broken(VocabularyError),
}

impl fmt::Display for TrainError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(what) => write!(f, "{what}"),
            Self::TooLittle => write!(f, "the images have fewer than two different descriptors"),
            Self::TooMuch => write!(f, "more descriptors, images or words than the format can number"),
            Self::Broken(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for TrainError {}

/// A trained vocabulary and its quantisation error.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The vocabulary, ready for use; its bytes are the file to save.
    pub vocabulary: Vocabulary,
    /// Mean Hamming distance in bits of a training descriptor to the centre of its word.
    pub mean_distance: f64,
}

/// Trains a vocabulary on images, each given by the descriptors of its features.
///
/// # Errors
/// When the configuration is out of range, or there are too few or too many descriptors.
pub fn train(images: &[Vec<Descriptor>], config: &TrainConfig) -> Result<Trained, TrainError> {
    if !(2..=MAX_BRANCHING).contains(&config.branching) {
        return Err(TrainError::Config("branching must be 2 to 4096"));
    }
    if !(1..=MAX_DEPTH).contains(&config.depth) {
        return Err(TrainError::Config("depth must be 1 to 16"));
    }
    let all: Vec<Descriptor> = images.iter().flatten().copied().collect();
    if u32::try_from(all.len()).is_err() || u32::try_from(images.len()).is_err() {
        return Err(TrainError::TooMuch);
    }
    let mut tree = build_tree(all, config);
    if tree.centres.len() < 2 {
        return Err(TrainError::TooLittle);
    }
    let header = Header {
        branching: config.branching,
        index_level: config.index_level,
        images: images.len() as u32,
        descriptors: images.iter().map(|i| i.len() as u64).sum(),
        seed: config.seed,
    };
    let open = |tree: &Tree| {
        let bytes = tree.to_bytes(&header).ok_or(TrainError::TooMuch)?;
        Vocabulary::open(bytes).map_err(TrainError::Broken)
    };
    let unweighted = open(&tree)?;
    let mean_distance = set_weights(&mut tree, &unweighted, images);
    Ok(Trained { vocabulary: open(&tree)?, mean_distance })
}

/// Builds the tree level by level; `all` is reordered so that the members of a node are contiguous.
fn build_tree(mut all: Vec<Descriptor>, config: &TrainConfig) -> Tree {
    let mut tree = Tree { centres: vec![[0; 32]], first: Vec::new(), weights: Vec::new() };
    let everything = 0..all.len();
    let mut members = vec![everything];
    let mut level = 0..1;
    for depth in 0..=config.depth {
        for node in level.clone() {
            tree.first.push(tree.centres.len() as u32);
            if depth == config.depth {
                continue;
            }
            let range = members[node].clone();
            let mut rng = Random::stream(config.seed, node as u64);
            let (centres, sizes) = split(&mut all[range.clone()], config, &mut rng);
            let mut from = range.start;
            for (centre, size) in centres.into_iter().zip(sizes) {
                tree.centres.push(centre);
                members.push(from..from + size);
                from += size;
            }
        }
        level = level.end..tree.centres.len();
    }
    tree.first.push(tree.centres.len() as u32);
    tree.weights = vec![0.0; tree.centres.len()];
    tree
}

/// Clusters some descriptors, which are reordered cluster by cluster; returns centres and sizes, both empty when all
/// descriptors are equal.
fn split(some: &mut [Descriptor], config: &TrainConfig, rng: &mut Random) -> (Vec<Descriptor>, Vec<usize>) {
    let mut centres = initial_centres(some, config.branching as usize, rng);
    if centres.len() < 2 {
        return (Vec::new(), Vec::new());
    }
    let mut owner: Vec<u32> = vec![u32::MAX; some.len()];
    for _ in 0..config.rounds.max(1) {
        let mut changed = false;
        for (o, d) in owner.iter_mut().zip(some.iter()) {
            let nearest = best_two_of(d, &centres).index;
            changed |= nearest != *o;
            *o = nearest;
        }
        if !changed {
            break;
        }
        majority(some, &owner, &mut centres);
    }
    // The centres moved in the last step: members are assigned once more to the final centres, as quantisation will do.
    let mut sizes = vec![0; centres.len()];
    let mut keyed: Vec<(u32, Descriptor)> =
        some.iter().map(|d| (best_two_of(d, &centres).index, *d)).collect();
    keyed.sort_by_key(|(c, _)| *c);
    for (slot, (c, d)) in some.iter_mut().zip(&keyed) {
        *slot = *d;
        sizes[*c as usize] += 1;
    }
    // Centres without members are dropped.
    let non_empty = centres.into_iter().zip(sizes).filter(|(_, n)| *n > 0);
    non_empty.unzip()
}

/// Initial centres (k-means++): each next one is drawn with probability proportional to its squared distance to the
/// nearest centre so far.
fn initial_centres(some: &[Descriptor], k: usize, rng: &mut Random) -> Vec<Descriptor> {
    let mut centres: Vec<Descriptor> = Vec::with_capacity(k);
    if some.is_empty() {
        return centres;
    }
    centres.push(some[rng.below(some.len())]);
    let mut nearest: Vec<u32> = vec![u32::MAX; some.len()];
    while centres.len() < k {
        let newest = centres[centres.len() - 1];
        let mut sum = 0u64;
        for (n, d) in nearest.iter_mut().zip(some) {
            *n = (*n).min(hamming(&newest, d).pow(2));
            sum += u64::from(*n);
        }
        if sum == 0 {
            break;
        }
        let mut left = (rng.unit() * sum as f64) as u64;
        let drawn = nearest.iter().position(|n| {
            let here = u64::from(*n);
            let found = left < here;
            left = left.saturating_sub(here);
            found
        });
        let Some(drawn) = drawn else { break };
        centres.push(some[drawn]);
    }
    centres
}

/// Sets each bit of each centre to the majority of its members; at a tie the bit stays, as does a centre without
/// members.
fn majority(some: &[Descriptor], owner: &[u32], centres: &mut [Descriptor]) {
    let mut ones = vec![[0u32; 256]; centres.len()];
    let mut sizes = vec![0u32; centres.len()];
    for (d, o) in some.iter().zip(owner) {
        let ones = &mut ones[*o as usize];
        for (byte, counts) in d.iter().zip(ones.as_chunks_mut::<8>().0) {
            for (bit, count) in counts.iter_mut().enumerate() {
                *count += u32::from(byte >> bit & 1);
            }
        }
        sizes[*o as usize] += 1;
    }
    for ((centre, ones), size) in centres.iter_mut().zip(&ones).zip(sizes) {
        for (byte, counts) in centre.iter_mut().zip(ones.as_chunks::<8>().0) {
            for (bit, count) in counts.iter().enumerate() {
                match (2 * u64::from(*count)).cmp(&u64::from(size)) {
                    std::cmp::Ordering::Greater => *byte |= 1 << bit,
                    std::cmp::Ordering::Less => *byte &= !(1 << bit),
                    std::cmp::Ordering::Equal => {}
                }
            }
        }
    }
}

/// Sets the inverse document frequencies, `ln(images / images that contain the word)`; returns the mean distance of a
/// descriptor to the centre of its word.
fn set_weights(tree: &mut Tree, vocabulary: &Vocabulary, images: &[Vec<Descriptor>]) -> f64 {
    let mut images_with = vec![0u32; tree.centres.len()];
    let (mut distance, mut count) = (0u64, 0u64);
    for image in images {
        let mut words: Vec<u32> = Vec::with_capacity(image.len());
        for d in image {
            let word = vocabulary.word(d).0;
            distance += u64::from(hamming(d, &tree.centres[word as usize]));
            count += 1;
            words.push(word);
        }
        words.sort_unstable();
        words.dedup();
        words.iter().for_each(|w| images_with[*w as usize] += 1);
    }
    for n in 0..tree.centres.len() {
        if tree.first[n] == tree.first[n + 1] {
            tree.weights[n] = (images.len() as f64 / f64::from(images_with[n].max(1))).ln() as f32;
        }
    }
    distance as f64 / count.max(1) as f64
}
