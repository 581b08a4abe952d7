//! Training: descriptors are split again and again into `k` clusters under the Hamming distance.
//!
//! Clusters by k-majority (Grana, Borghesani, Manfredi, Cucchiara, "A fast approach for integrating ORB descriptors in the
//! bag of words model", 2013): a centre holds in each bit what most of its members hold. Started by k-means++ (Arthur
//! and Vassilvitskii 2007). Seeded; the same images in the same order give the same bytes.

use super::build::{Head, Tree};
use super::format::{MOST_BRANCHING, MOST_DEPTH};
use super::{Vocabulary, VocabularyError};
use crate::{Descriptor, best_two_of, hamming};
use cairn_solve::ransac::Rng;
use std::fmt;

/// What is asked of the training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainConfig {
    /// Children of a node (2 to 4096).
    pub branching: u32,
    /// Levels below the root (1 to 16).
    pub depth: u32,
    /// Seed.
    pub seed: u64,
    /// Rounds of each clustering, at most.
    pub rounds: u32,
    /// The level whose nodes a bag keeps; without it the first that has at least 64.
    pub index_level: Option<u32>,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self { branching: 16, depth: 4, seed: 1, rounds: 12, index_level: None }
    }
}

/// Why there is no vocabulary.
#[derive(Clone, Debug, PartialEq)]
pub enum TrainError {
    /// Branching or depth is out of range.
    Setting(&'static str),
    /// There is nothing to split: fewer than two different descriptors.
    TooLittle,
    /// More than can be numbered.
    TooMuch,
    /// What was made can not be opened.
    Broken(VocabularyError),
}

impl fmt::Display for TrainError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setting(what) => write!(f, "{what}"),
            Self::TooLittle => write!(f, "the images have fewer than two different descriptors"),
            Self::TooMuch => write!(f, "more descriptors or words than can be numbered"),
            Self::Broken(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for TrainError {}

/// A trained vocabulary and how it went.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The vocabulary, ready for use; its bytes are its file.
    pub vocabulary: Vocabulary,
    /// Mean distance of a training descriptor to the centre of its word, bits.
    pub mean_distance: f64,
}

/// Trains on images, each given by the descriptors of its features.
///
/// # Errors
/// When the setting is out of range or there is too little to learn from.
pub fn train(images: &[Vec<Descriptor>], config: &TrainConfig) -> Result<Trained, TrainError> {
    if !(2..=MOST_BRANCHING).contains(&config.branching) {
        return Err(TrainError::Setting("branching must be 2 to 4096"));
    }
    if !(1..=MOST_DEPTH).contains(&config.depth) {
        return Err(TrainError::Setting("depth must be 1 to 16"));
    }
    let all: Vec<Descriptor> = images.iter().flatten().copied().collect();
    if u32::try_from(all.len()).is_err() || u32::try_from(images.len()).is_err() {
        return Err(TrainError::TooMuch);
    }
    let mut tree = grow(all, config);
    if tree.centres.len() < 2 {
        return Err(TrainError::TooLittle);
    }
    let head = Head {
        branching: config.branching,
        index_level: config.index_level,
        images: images.len() as u32,
        descriptors: images.iter().map(|i| i.len() as u64).sum(),
        seed: config.seed,
    };
    let open = |tree: &Tree| {
        let bytes = tree.to_bytes(&head).ok_or(TrainError::TooMuch)?;
        Vocabulary::open(bytes).map_err(TrainError::Broken)
    };
    let unweighted = open(&tree)?;
    let mean_distance = weigh(&mut tree, &unweighted, images);
    Ok(Trained { vocabulary: open(&tree)?, mean_distance })
}

/// Splits level by level; `all` is reordered so that the members of a node lie side by side.
fn grow(mut all: Vec<Descriptor>, config: &TrainConfig) -> Tree {
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
            let mut rng = Rng::with_stream(config.seed, node as u64);
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

/// Clusters of some descriptors, which are reordered cluster by cluster: centres and sizes. None, when all are one.
fn split(some: &mut [Descriptor], config: &TrainConfig, rng: &mut Rng) -> (Vec<Descriptor>, Vec<usize>) {
    let mut centres = seeds(some, config.branching as usize, rng);
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
    // The centres moved last: who belongs where is settled with what will be asked later.
    let mut sizes = vec![0; centres.len()];
    let mut keyed: Vec<(u32, Descriptor)> =
        some.iter().map(|d| (best_two_of(d, &centres).index, *d)).collect();
    keyed.sort_by_key(|(c, _)| *c);
    for (slot, (c, d)) in some.iter_mut().zip(&keyed) {
        *slot = *d;
        sizes[*c as usize] += 1;
    }
    // A centre without members is no word.
    let kept = centres.into_iter().zip(sizes).filter(|(_, n)| *n > 0);
    kept.unzip()
}

/// First centres: each next one is drawn with a chance that grows with the square of its distance to those before.
fn seeds(some: &[Descriptor], k: usize, rng: &mut Rng) -> Vec<Descriptor> {
    let mut centres: Vec<Descriptor> = Vec::with_capacity(k);
    if some.is_empty() {
        return centres;
    }
    centres.push(some[rng.below(some.len() as u32) as usize]);
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

/// Each centre becomes what most of its members hold, bit by bit; at a tie the bit stays, as does a centre without any.
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

/// Inverse document frequencies, `ln(images / images that show the word)`; gives the mean distance to the word's centre.
fn weigh(tree: &mut Tree, vocabulary: &Vocabulary, images: &[Vec<Descriptor>]) -> f64 {
    let mut shown = vec![0u32; tree.centres.len()];
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
        words.iter().for_each(|w| shown[*w as usize] += 1);
    }
    for n in 0..tree.centres.len() {
        if tree.first[n] == tree.first[n + 1] {
            tree.weights[n] = (images.len() as f64 / f64::from(shown[n].max(1))).ln() as f32;
        }
    }
    distance as f64 / count.max(1) as f64
}
