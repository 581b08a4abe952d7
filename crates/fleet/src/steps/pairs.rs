//! Pairs of maps that may share places: those of which two stretches have enough keys in common ([`crate::places`]).
//!
//! The index of places is in shards by map, so that a map that is added changes one of them. Of the stretches that have a key each is paired with
//! the next few only, in an order drawn for that key: where thousands walked, a walk has no more partners than the keys of
//! its own places allow, and over several keys all of them are connected.

use crate::places::{self, Key};
use crate::shelf::Shelf;
use crate::task::{Pair, Paired, Result as Found};
use crate::{Digest, FleetError};
use cairn_random::mix;
use std::collections::BTreeMap;

/// Stretches with the same key that a stretch is paired with, to either side.
const NEXT: usize = 8;
/// Keys of key frames and of landmarks that two stretches of different places have in common, on average: 0.02 and 0.0004 on the street of `bench
/// city` (40 m in 80 key frames, 990 words each); no more in rendered houses, an office, and real recordings of other places.
const BY_CHANCE: [f64; 2] = [0.02, 4e-4];

/// Keys of some maps, each with how many stretches it has.
type Shard = Vec<(Digest, (Vec<Key>, u32))>;

/// A stretch of a map, both by number.
type Stretch = (u32, u32);

/// Puts the keys of maps into one shard.
pub(crate) fn index(shelf: &Shelf, maps: &[(Digest, Digest)]) -> Result<Found, FleetError> {
    let keys =
        maps.iter().map(|(map, keys)| Ok((*map, places::read(&keys.to_string(), &shelf.blob(*keys)?)?)));
    let shard: Shard = keys.collect::<Result<_, FleetError>>()?;
    let bytes = postcard::to_stdvec(&shard).map_err(|e| FleetError::new("index", e, "report this"))?;
    Ok(Found::Indexed { shard: shelf.keep(&bytes)? })
}

/// Finds the pairs.
pub(crate) fn pairs(shelf: &Shelf, shards: &[Digest]) -> Result<Found, FleetError> {
    let (mut maps, mut keys, mut stretches) = (Vec::new(), Vec::new(), 0);
    for shard in shards {
        let read: Shard = postcard::from_bytes(&shelf.blob(*shard)?)
            .map_err(|e| FleetError::damaged(shard.to_string(), e))?;
        for (map, (of_map, count)) in read {
            keys.extend(of_map.into_iter().map(|(key, stretch)| (key, (maps.len() as u32, stretch))));
            maps.push(map);
            stretches += u64::from(count);
        }
    }
    // Whatever the shards, the same order.
    keys.sort_unstable_by_key(|(key, (map, stretch))| (*key, maps[*map as usize], *stretch));
    // No more than one stretch a map shall look like one of another place by chance.
    let enough = (stretches as f64 * stretches as f64 / maps.len().max(1) as f64).log2().ceil() as u32;
    let mut pairs: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    for (at, bits) in in_common(&keys).into_iter().map(|(at, common)| (at, bits(common))) {
        if bits >= enough {
            let most = pairs.entry(at).or_default();
            *most = bits.max(*most);
        }
    }
    let pair = |((a, b), bits): ((u32, u32), u32)| {
        let (a, b) = (maps[a as usize], maps[b as usize]);
        Pair { a: a.min(b), b: a.max(b), bits }
    };
    let mut pairs: Vec<Pair> = pairs.into_iter().map(pair).collect();
    pairs.sort_by_key(|p| (p.a, p.b));
    Ok(Found::Paired(Paired { pairs, enough }))
}

/// For each two stretches of different maps that have keys in common their maps, and how many keys of either kind.
fn in_common(keys: &[(u64, Stretch)]) -> Vec<((u32, u32), [u32; 2])> {
    let mut met: Vec<([Stretch; 2], bool)> = Vec::new();
    for having in keys.chunk_by(|a, b| a.0 == b.0).filter(|having| having.len() > 1) {
        let key = having[0].0;
        let mut drawn: Vec<Stretch> = having.iter().map(|(_, stretch)| *stretch).collect();
        if drawn.len() > NEXT + 1 {
            drawn.sort_by_key(|(map, stretch)| mix(key ^ mix(u64::from(*map) << 32 | u64::from(*stretch))));
        }
        for (n, a) in drawn.iter().enumerate() {
            let others = drawn.iter().skip(n + 1).take(NEXT).filter(|b| a.0 != b.0);
            met.extend(others.map(|b| ([*a.min(b), *a.max(b)], key & 1 == 1)));
        }
    }
    met.sort_unstable();
    let counted = met.chunk_by(|x, y| x.0 == y.0).map(|same| {
        let landmarks = same.iter().filter(|(_, landmarks)| *landmarks).count() as u32;
        let [a, b] = same[0].0;
        ((a.0, b.0), [same.len() as u32 - landmarks, landmarks])
    });
    counted.collect()
}

/// How unlikely it is that two stretches of different places have so many keys in common, as minus the logarithm of the probability to the base 2:
/// the first term of the tail of a Poisson distribution, `m^k / k!`, which for small means is nearly all of it.
fn bits(common: [u32; 2]) -> u32 {
    let of = |(mean, keys): (f64, u32)| (1..=keys).map(|k| (f64::from(k) / mean).log2()).sum::<f64>();
    BY_CHANCE.into_iter().zip(common).map(of).sum::<f64>() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_landmarks_say_more_than_those_of_key_frames() {
        assert_eq!([[0, 0], [1, 0], [2, 0], [3, 0], [0, 1], [1, 1]].map(bits), [0, 5, 12, 19, 11, 16]);
    }

    #[test]
    fn keys_of_two_stretches_are_counted_and_crowds_are_thinned() {
        let keys =
            [(7, (0, 0)), (7, (1, 4)), (8, (0, 0)), (8, (1, 4)), (8, (1, 5)), (9, (2, 0)), (9, (2, 3))];
        assert_eq!(in_common(&keys), [((0, 1), [1, 1]), ((0, 1), [1, 0])]);
        let crowd: Vec<(u64, Stretch)> =
            (0..50).flat_map(|key| (0..200).map(move |map| (key, (map, 0)))).collect();
        let met = in_common(&crowd);
        let pairs = met.iter().map(|(_, [a, b])| (a + b) as usize).sum::<usize>();
        assert!(pairs <= 50 * 200 * NEXT, "{pairs}");
        let mut reached = std::collections::BTreeSet::from([0]);
        for _ in 0..200 {
            for ((a, b), _) in &met {
                if reached.contains(a) || reached.contains(b) {
                    reached.extend([*a, *b]);
                }
            }
        }
        assert_eq!(reached.len(), 200, "all are connected");
    }
}
