//! What the places of a map are found by among those of all walks: keys that two maps have in common where they show the same place, and
//! hardly ever otherwise. Who has a key is looked up, so that finding the walks of a place costs nothing for those of other places.
//!
//! A place is a stretch of a few key frames. Its words are those of its landmarks (a landmark's descriptor is the one in the middle of all that
//! were observed, so it falls into the same word from walk to walk far more often than a single feature does). A key is what [`WORDS`] hash
//! functions draw from that set: min-hash sketches (Chum, Philbin, Zisserman, "Near duplicate image detection: min-hash and tf-idf weighting",
//! 2008, sections 3 and 4.2: a word of weight `d` is drawn by the least `-ln(u) / d`). Two sets with a share `J` in common have a key in common
//! with the probability `J ^ WORDS`.

use crate::FleetError;
use cairn::atlas::store::MapFile;
use cairn::atlas::{KeyFrame, LandmarkId};
use cairn::vision::bow::Vocabulary;
use cairn_random::{Random, mix};
use std::collections::{BTreeMap, BTreeSet};

/// Key frames of a place.
pub(crate) const STRETCH: usize = 8;
/// Key frames of a place that must show a landmark, where there are as many.
const SHOWN: u32 = 2;
/// Keys of a place.
const KEYS: u64 = 64;
/// Words of a key.
const WORDS: u64 = 3;

/// The keys of the places of a map file, rising, each with its place.
pub(crate) fn of_map(file: &MapFile) -> Vec<(u64, u32)> {
    let mut keys = Vec::new();
    let mut place = 0;
    for (map, _) in file.snapshot.maps() {
        let all: Vec<&KeyFrame> = file.snapshot.key_frames_of(map).collect();
        for stretch in all.chunks(STRETCH) {
            let words = words(file, stretch);
            if !words.is_empty() {
                keys.extend((0..KEYS).map(|table| (key(&words, table), place)));
            }
            place += 1;
        }
    }
    keys.sort_unstable();
    keys
}

/// The words of the landmarks that a stretch shows, each with its weight.
fn words(file: &MapFile, stretch: &[&KeyFrame]) -> BTreeMap<u32, f64> {
    let mut shown: BTreeMap<LandmarkId, u32> = BTreeMap::new();
    stretch
        .iter()
        .flat_map(|k| k.landmarks.iter().flatten())
        .for_each(|l| *shown.entry(*l).or_default() += 1);
    let vocabulary = Vocabulary::current();
    let lasting = shown.into_iter().filter(|(_, times)| *times >= SHOWN.min(stretch.len() as u32));
    let landmarks = lasting.filter_map(|(id, _)| file.snapshot.landmark(id));
    let words: BTreeSet<_> = landmarks.map(|l| vocabulary.word(&l.descriptor)).collect();
    let weighed = words.into_iter().map(|word| (word.0, f64::from(vocabulary.weight(word))));
    weighed.filter(|(_, weight)| *weight > 0.0).collect()
}

fn key(words: &BTreeMap<u32, f64>, table: u64) -> u64 {
    let drawn = |n: u64| {
        let lot = |(word, weight): (&u32, &f64)| {
            let u = Random::stream(table * WORDS + n, u64::from(*word)).unit();
            (-u.max(f64::MIN_POSITIVE).ln() / weight, *word)
        };
        words.iter().map(lot).min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, word)| word)
    };
    (0..WORDS).fold(table, |key, n| mix(key ^ u64::from(drawn(n)) << 8).wrapping_add(n))
}

/// Keys as bytes, and back.
pub(crate) fn write(keys: &[(u64, u32)]) -> Result<Vec<u8>, FleetError> {
    postcard::to_stdvec(keys).map_err(|e| FleetError::new("places", e, "report this"))
}

pub(crate) fn read(what: &str, bytes: &[u8]) -> Result<Vec<(u64, u32)>, FleetError> {
    postcard::from_bytes(bytes).map_err(|e| FleetError::damaged(what, e))
}
