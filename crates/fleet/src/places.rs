//! What the places of a map are found by among those of all walks: keys that two maps have in common where they show the same place, and
//! hardly ever otherwise. Who has a key is looked up, so that finding the walks of a place costs nothing for those of other places.
//!
//! A key is what [`WORDS`] hash functions draw from a set of visual words: min-hash sketches (Chum, Philbin, Zisserman, "Near duplicate image
//! detection: min-hash and tf-idf weighting", 2008, sections 3 and 4.2). Two sets with a share `J` in common have a key in common with the
//! probability `J ^ WORDS`. The sets are the words of each key frame, and those of the landmarks that a stretch of key frames shows:
//! a landmark's descriptor is the one in the middle of all observed ones, which is the same word from walk to walk far more often
//! than a single feature, but less often where it was seen from elsewhere.

use crate::FleetError;
use cairn::atlas::store::MapFile;
use cairn::atlas::{KeyFrame, LandmarkId};
use cairn::vision::bow::{Vocabulary, WordId};
use cairn_random::{Random, mix};
use std::collections::{BTreeMap, BTreeSet};

/// Key frames of a stretch: how exactly a key says where in a map it is.
pub(crate) const STRETCH: usize = 8;
/// Key frames of a stretch that must show a landmark, where there are as many.
const SHOWN: u32 = 2;
/// Keys of a key frame, and of the landmarks of a stretch.
const KEYS: [u64; 2] = [256, 128];
/// Words of a key.
const WORDS: usize = 3;
/// Bits that decide which word a hash function draws.
const BITS: usize = 21;

/// A key with its stretch. Its lowest bit says whether it is of a key frame (0) or of landmarks (1).
pub(crate) type Key = (u64, u32);

/// The keys of a map file, rising, and how many stretches it has.
pub(crate) fn of_map(file: &MapFile) -> (Vec<Key>, u32) {
    let (mut keys, mut stretch) = (BTreeSet::new(), 0);
    for (map, _) in file.snapshot.maps() {
        let all: Vec<&KeyFrame> = file.snapshot.key_frames_of(map).collect();
        for key_frames in all.chunks(STRETCH) {
            let landmarks = weighed(landmark_words(file, key_frames));
            let own = key_frames.iter().map(|k| weighed(k.bag.words().iter().map(|(word, _)| *word)));
            let sets = own.map(|words| (words, 0..KEYS[0])).chain([(landmarks, KEYS[0]..KEYS[0] + KEYS[1])]);
            for (words, tables) in sets.filter(|(words, _)| !words.is_empty()) {
                keys.extend(
                    tables.map(|table| (key(&words, table) << 1 | u64::from(table >= KEYS[0]), stretch)),
                );
            }
            stretch += 1;
        }
    }
    (keys.into_iter().collect(), stretch)
}

/// The words of the landmarks that a stretch shows.
fn landmark_words(file: &MapFile, stretch: &[&KeyFrame]) -> BTreeSet<WordId> {
    let mut shown: BTreeMap<LandmarkId, u32> = BTreeMap::new();
    stretch
        .iter()
        .flat_map(|k| k.landmarks.iter().flatten())
        .for_each(|l| *shown.entry(*l).or_default() += 1);
    let lasting = shown.into_iter().filter(|(_, times)| *times >= SHOWN.min(stretch.len() as u32));
    let landmarks = lasting.filter_map(|(id, _)| file.snapshot.landmark(id));
    landmarks.map(|l| Vocabulary::current().word(&l.descriptor)).collect()
}

/// Words, each with how much less often it is drawn than one of weight 1.
fn weighed(words: impl IntoIterator<Item = WordId>) -> Vec<(u32, f64)> {
    let vocabulary = Vocabulary::current();
    let weighed = words.into_iter().map(|word| (word.0, f64::from(vocabulary.weight(word))));
    weighed.filter(|(_, weight)| *weight > 0.0).map(|(word, weight)| (word, 1.0 / weight)).collect()
}

/// What the hash functions of a table draw. A word of weight `d` has the lot `u / d`, which among hundreds of words is as good as the
/// `-ln(1 - u) / d` of the paper, and the same on every machine.
fn key(words: &[(u32, f64)], table: u64) -> u64 {
    let mut least = [(f64::INFINITY, 0); WORDS];
    for (word, rarity) in words {
        let bits = Random::stream(table, u64::from(*word)).bits();
        for (n, least) in least.iter_mut().enumerate() {
            let lot = ((bits >> (BITS * n)) & ((1 << BITS) - 1)) as f64 * rarity;
            if lot < least.0 {
                *least = (lot, *word);
            }
        }
    }
    least.iter().fold(table, |key, (_, word)| mix(key << 1 ^ u64::from(*word) << 32 ^ table))
}

/// Keys as bytes.
pub(crate) fn write(keys: &(Vec<Key>, u32)) -> Result<Vec<u8>, FleetError> {
    postcard::to_stdvec(keys).map_err(|e| FleetError::new("places", e, "report this"))
}

/// Reads what [`write`] made.
pub(crate) fn read(what: &str, bytes: &[u8]) -> Result<(Vec<Key>, u32), FleetError> {
    postcard::from_bytes(bytes).map_err(|e| FleetError::damaged(what, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half of the words of both are those of the other: a share of a third, so that a key of three is the same once in 27.
    #[test]
    fn sets_have_as_many_keys_in_common_as_their_share_says() {
        let words = |from: u32| -> Vec<(u32, f64)> { (from..from + 400).map(|w| (w, 0.5)).collect() };
        let same =
            |a: &[(u32, f64)], b: &[(u32, f64)]| (0..8000).filter(|t| key(a, *t) == key(b, *t)).count();
        let common = same(&words(0), &words(200));
        assert!((230..370).contains(&common), "{common} of 8000, not 296");
        assert_eq!(same(&words(0), &words(1000)), 0);
        assert_eq!(same(&words(0), &words(0)), 8000);
    }
}
