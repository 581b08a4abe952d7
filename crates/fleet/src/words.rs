//! The words of maps: bags of words of key frames as [`cairn::words_of_map`] writes them, and the heaviest words of a map.

use crate::FleetError;
use cairn::MapWords;
use cairn::atlas::store::MapFile;
use cairn::vision::bow::BagOfWords;
use std::collections::BTreeSet;

/// Of each key frame so many of its heaviest words are looked up to find maps that may show the same places.
pub(crate) const HEAVY: usize = 32;

/// The words of a map file, and which they are when read back.
pub(crate) fn of_map(file: &MapFile) -> Vec<u8> {
    // The number of the robot is no part of the bytes that matter here; maps of one recording have one.
    cairn::words_of_map(0, file).0
}

/// Reads words.
pub(crate) fn read(what: &str, bytes: &[u8]) -> Result<MapWords, FleetError> {
    MapWords::read(0, bytes).map_err(|e| FleetError::damaged(what, e))
}

/// The heaviest words of a bag, heaviest first.
pub(crate) fn heaviest(bag: &BagOfWords, most: usize) -> Vec<(u32, f32)> {
    let mut words: Vec<(u32, f32)> = bag.words().iter().map(|(word, weight)| (word.0, *weight)).collect();
    words.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    words.truncate(most);
    words
}

/// The heaviest words of all key frames of a map.
pub(crate) fn heavy_words(words: &MapWords) -> BTreeSet<u32> {
    words.bags().iter().flat_map(|bag| heaviest(bag, HEAVY)).map(|(word, _)| word).collect()
}
