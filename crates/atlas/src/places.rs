//! Place recognition index: from the words of an image to the key frames that contain them.
//!
//! A persistent value like the snapshot it is part of: cloning is cheap, and a change costs what it changes, however large
//! the map. The newest key frames keep their bags and are compared one by one; groups of older ones have an inverted index
//! each, which is never written again. A removed key frame is only marked in its group. The score of a key frame is
//! [`BagOfWords::similarity`] with the query, summed over the words in the same order, so that it is equal to the last bit.

use crate::KeyFrameId;
use cairn_vision::bow::BagOfWords;
use std::sync::Arc;

/// So many of the newest key frames are compared one by one.
const NEWEST: usize = 64;
/// So many small groups become one large one.
const SMALL: usize = 8;

/// Key frames by their words.
#[derive(Clone, Debug, Default)]
pub struct PlaceIndex {
    newest: Arc<Vec<(KeyFrameId, Arc<BagOfWords>)>>,
    groups: Vec<Group>,
}

/// An inverted index of some key frames, and which of them are still there.
#[derive(Clone, Debug)]
struct Group {
    lists: Arc<Lists>,
    there: Arc<Vec<bool>>,
}

/// For each word the key frames that contain it, with its weight there.
#[derive(Debug, Default)]
struct Lists {
    ids: Vec<KeyFrameId>,
    /// The lowest and the highest of them.
    range: Option<[KeyFrameId; 2]>,
    /// The words, rising.
    words: Vec<u32>,
    /// Where the entries of each word begin; one more than words.
    starts: Vec<u32>,
    /// Entries: key frame (index in `ids`) and weight.
    at: Vec<u16>,
    weights: Vec<f32>,
}

impl Lists {
    /// Of entries (word, index in `ids`, weight) in any order.
    fn new(ids: Vec<KeyFrameId>, entries: Vec<(u32, u16, f32)>) -> Self {
        // Sorted by counting: words are numbers below the size of the vocabulary, and those of one word stay in their order.
        let most = entries.iter().map(|(word, ..)| *word as usize + 1).max().unwrap_or(0);
        let mut counts = vec![0u32; most];
        entries.iter().for_each(|(word, ..)| counts[*word as usize] += 1);
        let range = ids.iter().min().zip(ids.iter().max()).map(|(a, b)| [*a, *b]);
        let (at, weights) = (vec![0; entries.len()], vec![0.0; entries.len()]);
        let mut lists = Self { ids, range, at, weights, ..Self::default() };
        let mut next = 0;
        for (word, count) in counts.iter_mut().enumerate().filter(|(_, count)| **count > 0) {
            lists.words.push(word as u32);
            lists.starts.push(next);
            next += std::mem::replace(count, next);
        }
        lists.starts.push(next);
        for (word, at, weight) in entries {
            let place = &mut counts[word as usize];
            (lists.at[*place as usize], lists.weights[*place as usize]) = (at, weight);
            *place += 1;
        }
        lists.words.shrink_to_fit();
        lists.starts.shrink_to_fit();
        lists
    }

    /// The words of some key frames.
    fn of<'a>(key_frames: impl Iterator<Item = (KeyFrameId, &'a BagOfWords)>) -> Self {
        let (mut ids, mut entries) = (Vec::new(), Vec::new());
        for (id, bag) in key_frames {
            entries.extend(bag.words().iter().map(|(word, weight)| (word.0, ids.len() as u16, *weight)));
            ids.push(id);
        }
        Self::new(ids, entries)
    }

    /// The key frames of several groups that are still there.
    fn joined(groups: &[Group]) -> Self {
        let (mut ids, mut entries) = (Vec::new(), Vec::new());
        for group in groups {
            let first = ids.len();
            let mut rows: Vec<Option<u16>> = Vec::with_capacity(group.lists.ids.len());
            for (id, there) in group.lists.ids.iter().zip(group.there.iter()) {
                rows.push(there.then_some(ids.len() as u16));
                ids.extend(there.then_some(*id));
            }
            if ids.len() > first {
                entries.extend(group.lists.entries().filter_map(|(word, at, w)| Some((word, rows[at]?, w))));
            }
        }
        Self::new(ids, entries)
    }

    fn entries(&self) -> impl Iterator<Item = (u32, usize, f32)> {
        self.words.iter().zip(self.starts.windows(2)).flat_map(|(word, span)| {
            let span = span[0] as usize..span[1] as usize;
            self.at[span.clone()].iter().zip(&self.weights[span]).map(|(at, w)| (*word, usize::from(*at), *w))
        })
    }

    /// Adds the similarity of each key frame with a bag.
    fn score(&self, bag: &BagOfWords, scores: &mut [f64]) {
        let mut from = 0;
        for &(word, weight) in bag.words() {
            from += first_from(&self.words[from..], word.0);
            if self.words.get(from) != Some(&word.0) {
                continue;
            }
            let span = self.starts[from] as usize..self.starts[from + 1] as usize;
            for (at, w) in self.at[span.clone()].iter().zip(&self.weights[span]) {
                scores[usize::from(*at)] += f64::from(weight.min(*w));
            }
        }
    }
}

/// The index of the first value that is not below `least`, in steps that double from the start: it is near.
fn first_from(rising: &[u32], least: u32) -> usize {
    let mut end = 1;
    while rising.get(end - 1).is_some_and(|v| *v < least) {
        end *= 2;
    }
    let start = end / 2;
    start + rising[start..end.min(rising.len())].partition_point(|v| *v < least)
}

impl Group {
    fn new(lists: Lists) -> Self {
        let there = Arc::new(vec![true; lists.ids.len()]);
        Self { lists: Arc::new(lists), there }
    }

    fn is_small(&self) -> bool {
        self.lists.ids.len() <= NEWEST
    }

    fn position(&self, id: KeyFrameId) -> Option<usize> {
        self.lists.range.filter(|[first, last]| (*first..=*last).contains(&id))?;
        (0..self.there.len()).find(|at| self.lists.ids[*at] == id && self.there[*at])
    }
}

/// Makes the index of many key frames, of which only some bags are held at a time.
#[derive(Default)]
pub(crate) struct PlaceIndexBuilder {
    waiting: Vec<(KeyFrameId, Arc<BagOfWords>)>,
    groups: Vec<Group>,
}

impl PlaceIndexBuilder {
    /// Adds a key frame, each once.
    pub fn insert(&mut self, id: KeyFrameId, bag: Arc<BagOfWords>) {
        self.waiting.push((id, bag));
        if self.waiting.len() == NEWEST * SMALL {
            let bags = self.waiting.iter().map(|(id, bag)| (*id, &**bag));
            self.groups.push(Group::new(Lists::of(bags)));
            self.waiting.clear();
        }
    }

    /// The index.
    pub fn finish(self) -> PlaceIndex {
        let mut index = PlaceIndex { newest: Arc::default(), groups: self.groups };
        self.waiting.iter().for_each(|(id, bag)| index.insert(*id, bag));
        index
    }
}

impl PlaceIndex {
    /// The index of key frames; the same as inserting them one by one, but faster.
    pub(crate) fn of(key_frames: impl Iterator<Item = (KeyFrameId, Arc<BagOfWords>)>) -> Self {
        let mut builder = PlaceIndexBuilder::default();
        key_frames.for_each(|(id, bag)| builder.insert(id, bag));
        builder.finish()
    }

    /// Adds a key frame; one that is already there is left as it is.
    pub fn insert(&mut self, id: KeyFrameId, bag: &Arc<BagOfWords>) {
        if bag.is_empty() || self.contains(id) {
            return;
        }
        if self.newest.len() == NEWEST {
            let newest = std::mem::take(&mut self.newest);
            self.groups.push(Group::new(Lists::of(newest.iter().map(|(id, bag)| (*id, &**bag)))));
            let small = self.groups.iter().rev().take_while(|group| group.is_small()).count();
            if small >= SMALL {
                let parts = self.groups.split_off(self.groups.len() - small);
                self.groups.push(Group::new(Lists::joined(&parts)));
            }
        }
        Arc::make_mut(&mut self.newest).push((id, bag.clone()));
    }

    fn contains(&self, id: KeyFrameId) -> bool {
        self.newest.iter().any(|(k, _)| *k == id)
            || self.groups.iter().any(|group| group.position(id).is_some())
    }

    /// Removes a key frame.
    pub fn remove(&mut self, id: KeyFrameId) {
        if self.newest.iter().any(|(k, _)| *k == id) {
            Arc::make_mut(&mut self.newest).retain(|(k, _)| *k != id);
            return;
        }
        for group in &mut self.groups {
            if let Some(at) = group.position(id) {
                Arc::make_mut(&mut group.there)[at] = false;
            }
        }
        self.groups.retain(|group| group.there.contains(&true));
    }

    /// The key frames most similar to a bag, best first (of equals the oldest), with their similarity, which
    /// is above zero; at most `limit`, and only those that `accept` admits.
    pub fn query(
        &self,
        bag: &BagOfWords,
        limit: usize,
        accept: impl Fn(KeyFrameId) -> bool,
    ) -> Vec<(KeyFrameId, f64)> {
        let mut found: Vec<(KeyFrameId, f64)> =
            self.newest.iter().map(|(id, own)| (*id, bag.similarity(own))).collect();
        let mut scores: Vec<f64> = Vec::new();
        for group in &self.groups {
            scores.clear();
            scores.resize(group.there.len(), 0.0);
            group.lists.score(bag, &mut scores);
            let there = group.lists.ids.iter().zip(&scores).zip(group.there.iter());
            found.extend(there.filter(|(_, there)| **there).map(|((id, score), _)| (*id, *score)));
        }
        found.retain(|(id, score)| *score > 0.0 && accept(*id));
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
