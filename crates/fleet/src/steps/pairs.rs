//! Pairs of maps that may share places, by visual words alone.
//!
//! The index of places is in shards; a shard holds the words of its maps. For each two shards, and for each with itself, an inverted
//! list of the heaviest words of each key frame (by tf-idf; Sivic and Zisserman, "Video Google", 2003) counts how many of them
//! every two maps share; those that share enough are compared key frame by key frame ([`MapWords::overlaps`]). So the work on pairs that
//! have nothing in common is that of a short list.

use crate::shelf::Shelf;
use crate::task::{Pair, Paired, Result as Found};
use crate::{Digest, FleetError, words};
use cairn::MapWords;
use std::collections::BTreeMap;

/// Heavy words that two maps must share before their key frames are compared, as a share of those of the map that has fewer.
const SHARED: f64 = 0.1;

/// Puts the words of maps into one shard: for each map its digest, the length of its words, and they.
pub(crate) fn index(shelf: &Shelf, maps: &[(Digest, Digest)]) -> Result<Found, FleetError> {
    let mut bytes = Vec::new();
    for (map, words) in maps {
        let words = shelf.blob(*words)?;
        bytes.extend(map.0);
        bytes.extend((words.len() as u64).to_le_bytes());
        bytes.extend(words);
    }
    Ok(Found::Indexed { shard: shelf.keep(&bytes)? })
}

/// The maps of a shard with their words.
fn shard(shelf: &Shelf, digest: Digest) -> Result<Vec<(Digest, MapWords)>, FleetError> {
    let bytes = shelf.blob(digest)?;
    let (mut rest, mut maps) = (bytes.as_slice(), Vec::new());
    while !rest.is_empty() {
        let next = rest.split_first_chunk::<32>().and_then(|(map, rest)| {
            let (length, rest) = rest.split_first_chunk::<8>()?;
            let (words, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
            Some((Digest(*map), words, rest))
        });
        let (map, bytes, after) =
            next.ok_or_else(|| FleetError::damaged(digest.to_string(), "a shard that ends early"))?;
        maps.push((map, words::read(&map.to_string(), bytes)?));
        rest = after;
    }
    Ok(maps)
}

/// Finds pairs between two shards, or within one.
pub(crate) fn pairs(shelf: &Shelf, a: Digest, b: Digest) -> Result<Found, FleetError> {
    let here = shard(shelf, a)?;
    let other = if a == b { None } else { Some(shard(shelf, b)?) };
    let there = other.as_ref().unwrap_or(&here);
    let mut lists: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    let heavy: Vec<usize> = (there.iter().enumerate())
        .map(|(n, (_, words))| {
            let heavy = words::heavy_words(words);
            heavy.iter().for_each(|word| lists.entry(*word).or_default().push(n));
            heavy.len()
        })
        .collect();
    let mut found = Paired { pairs: Vec::new(), all: 0, compared: 0 };
    for (k, (map, own)) in here.iter().enumerate() {
        let words = words::heavy_words(own);
        let mut shared = vec![0usize; there.len()];
        words.iter().flat_map(|w| lists.get(w).into_iter().flatten()).for_each(|n| shared[*n] += 1);
        for n in if other.is_some() { 0..there.len() } else { 0..k } {
            found.all += 1;
            if (shared[n] as f64) < SHARED * words.len().min(heavy[n]) as f64 {
                continue;
            }
            found.compared += 1;
            if own.overlaps(&there[n].1) {
                let (a, b) = (*map.min(&there[n].0), *map.max(&there[n].0));
                found.pairs.push(Pair { a, b });
            }
        }
    }
    found.pairs.sort_by_key(|p| (p.a, p.b));
    Ok(Found::Paired(found))
}
