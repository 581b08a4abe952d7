//! Place recognition index: an inverted index from words to key frames.
//!
//! A persistent value like the snapshot it is part of: cloning is cheap, and a change copies only the lists
//! it touches. The score of a key frame is [`BagOfWords::similarity`] with the query, summed over the words in the
//! same order, so that it is equal to the last bit.

use crate::KeyFrameId;
use crate::arena::Arena;
use cairn_vision::bow::BagOfWords;

/// Key frames by their words.
#[derive(Clone, Debug, Default)]
pub struct PlaceIndex {
    /// For each word the key frames that contain it, in rising order, with its weight there.
    words: Arena<Vec<(KeyFrameId, f32)>>,
}

impl PlaceIndex {
    /// The index of key frames in rising order of id; the same as inserting them one by one, but faster.
    pub(crate) fn of<'a>(key_frames: impl Iterator<Item = (KeyFrameId, &'a BagOfWords)> + Clone) -> Self {
        let mut counts: Vec<usize> = Vec::new();
        for (word, _) in key_frames.clone().flat_map(|(_, bag)| bag.words()) {
            let word = word.0 as usize;
            if counts.len() <= word {
                counts.resize(word + 1, 0);
            }
            counts[word] += 1;
        }
        let mut lists: Vec<Vec<(KeyFrameId, f32)>> = counts.into_iter().map(Vec::with_capacity).collect();
        for (id, bag) in key_frames {
            bag.words().iter().for_each(|(word, weight)| lists[word.0 as usize].push((id, *weight)));
        }
        let mut index = Self::default();
        for (word, list) in lists.into_iter().enumerate().filter(|(_, list)| !list.is_empty()) {
            index.words.insert(word, list);
        }
        index
    }

    /// Adds a key frame; one that is already there with these words is left as it is.
    pub fn insert(&mut self, id: KeyFrameId, bag: &BagOfWords) {
        for &(word, weight) in bag.words() {
            let word = word.0 as usize;
            match self.words.get_mut(word) {
                Some(list) => {
                    let at = list.partition_point(|(k, _)| *k < id);
                    if list.get(at).is_none_or(|(k, _)| *k != id) {
                        list.insert(at, (id, weight));
                    }
                }
                None => self.words.insert(word, vec![(id, weight)]),
            }
        }
    }

    /// Removes a key frame; `bag` is the one it was added with.
    pub fn remove(&mut self, id: KeyFrameId, bag: &BagOfWords) {
        for &(word, _) in bag.words() {
            let word = word.0 as usize;
            if self.words.get(word).is_none_or(|list| list.iter().all(|(k, _)| *k != id)) {
                continue;
            }
            let Some(list) = self.words.get_mut(word) else { continue };
            list.retain(|(k, _)| *k != id);
            if list.is_empty() {
                self.words.remove(word);
            }
        }
    }

    /// The key frames most similar to a bag, best first (of equals the oldest), with their similarity, which
    /// is above zero; at most `limit`, and only those that `accept` admits.
    pub fn query(
        &self,
        bag: &BagOfWords,
        limit: usize,
        accept: impl Fn(KeyFrameId) -> bool,
    ) -> Vec<(KeyFrameId, f64)> {
        // Similarity by index in order of creation, grown as needed.
        let mut scores: Vec<f64> = Vec::new();
        for &(word, weight) in bag.words() {
            let Some(list) = self.words.get(word.0 as usize) else { continue };
            if let Some((last, _)) = list.last()
                && scores.len() <= last.index()
            {
                scores.resize(last.index() + 1, 0.0);
            }
            for (id, w) in list {
                scores[id.index()] += f64::from(weight.min(*w));
            }
        }
        let mut found: Vec<(KeyFrameId, f64)> = scores
            .iter()
            .enumerate()
            .filter(|(_, s)| **s > 0.0)
            .filter_map(|(i, s)| Some((KeyFrameId::from_index(i)?, *s)))
            .filter(|(id, _)| accept(*id))
            .collect();
        let better = |a: &(KeyFrameId, f64), b: &(KeyFrameId, f64)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
        if limit < found.len() {
            if limit > 0 {
                found.select_nth_unstable_by(limit - 1, better);
            }
            found.truncate(limit);
        }
        found.sort_unstable_by(better);
        found
    }
}
