//! Pairs of maps that may share places: those that have keys of places in common ([`crate::places`]).
//!
//! The index of places is in shards by map, so that a map that is added changes one of them. Pairs are looked for in parts by key. Of the maps
//! that have a key each is paired with the next few only, in an order drawn for that key: where thousands walked, a walk still has
//! as many partners as the keys of its own places allow, and over several keys all of them are connected.

use crate::shelf::Shelf;
use crate::task::{Pair, Paired, Result as Found};
use crate::{Digest, FleetError, places};
use cairn_random::mix;
use std::collections::BTreeMap;

/// Maps with the same key that a map is paired with, to either side.
const NEXT: usize = 8;

/// The keys of the places of some maps.
type Shard = Vec<(Digest, Vec<(u64, u32)>)>;

/// Puts the keys of maps into one shard.
pub(crate) fn index(shelf: &Shelf, maps: &[(Digest, Digest)]) -> Result<Found, FleetError> {
    let keys =
        maps.iter().map(|(map, keys)| Ok((*map, places::read(&keys.to_string(), &shelf.blob(*keys)?)?)));
    let shard: Shard = keys.collect::<Result<_, FleetError>>()?;
    let bytes = postcard::to_stdvec(&shard).map_err(|e| FleetError::new("index", e, "report this"))?;
    Ok(Found::Indexed { shard: shelf.keep(&bytes)? })
}

/// Finds the pairs that have a key of one part in common: of so many parts, that with this number.
pub(crate) fn pairs(shelf: &Shelf, shards: &[Digest], part: usize) -> Result<Found, FleetError> {
    let mut having: BTreeMap<u64, Vec<Digest>> = BTreeMap::new();
    for shard in shards {
        let maps: Shard = postcard::from_bytes(&shelf.blob(*shard)?)
            .map_err(|e| FleetError::damaged(shard.to_string(), e))?;
        for (map, keys) in maps {
            for (key, _) in keys.iter().filter(|(key, _)| (key % shards.len() as u64) as usize == part) {
                let of_key = having.entry(*key).or_default();
                if of_key.last() != Some(&map) {
                    of_key.push(map);
                }
            }
        }
    }
    let mut shared: BTreeMap<(Digest, Digest), u32> = BTreeMap::new();
    for (key, mut maps) in having {
        maps.sort_by_key(|map| map.0.iter().fold(key, |drawn, byte| mix(drawn ^ u64::from(*byte))));
        for (n, a) in maps.iter().enumerate() {
            for b in maps.iter().skip(n + 1).take(NEXT) {
                *shared.entry((*a.min(b), *a.max(b))).or_default() += 1;
            }
        }
    }
    let pairs = shared.into_iter().map(|((a, b), keys)| Pair { a, b, keys }).collect();
    Ok(Found::Paired(Paired { pairs }))
}
