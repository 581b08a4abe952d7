//! The index that tells a phone which tile to fetch: for each visual word, the tiles that show it, with the greatest weight that it has in
//! any of their key frames. A phone reads the lists of the words of its image only, by ranges of one object.
//!
//! A tile's score is the sum over the words of the image of the lesser of both weights: an upper bound of the similarity (Galvez-Lopez
//! and Tardos 2012) to any key frame of the tile.
//!
//! Layout, little endian: magic; CRC-32 of the vocabulary; number of words `V`; number of tiles `T`; length of each row; `V + 1` offsets
//! of lists (u64 each, counted from where lists begin); `T` rows: digest and length of the map, the atlas, root, cell, key frames; lists of
//! (tile u32, weight u8).

use crate::task::{Blob, Tile};
use crate::{Digest, FleetError};
use cairn::atlas::KeyFrame;
use cairn::vision::bow::Vocabulary;
use std::collections::BTreeMap;

const MAGIC: [u8; 8] = *b"CAIRNTI1";
const HEADER: u64 = 24;
const ROW: usize = 72;
const ENTRY: usize = 5;
/// The weight that the greatest byte stands for; bags sum to 1, so few words weigh more.
const FULL: f32 = 1.0 / 32.0;

/// The words of some key frames, each with its greatest weight.
pub(crate) fn words_of<'a>(key_frames: impl Iterator<Item = &'a KeyFrame>) -> BTreeMap<u32, f32> {
    let mut words: BTreeMap<u32, f32> = BTreeMap::new();
    for (word, weight) in key_frames.flat_map(|k| k.bag.words()) {
        let most = words.entry(word.0).or_insert(0.0);
        *most = most.max(*weight);
    }
    words
}

/// A tile as a reader of the index finds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Row {
    pub(crate) map: Blob,
    /// The atlas, by its place in `atlas.json`.
    pub(crate) atlas: u32,
    pub(crate) cell: Option<[i32; 3]>,
    pub(crate) key_frames: u32,
}

/// The bytes of an index of tiles, each with its atlas and words.
pub(crate) fn write(tiles: &[(u32, Tile, BTreeMap<u32, f32>)]) -> Vec<u8> {
    let facts = Vocabulary::current().facts();
    let words = facts.nodes;
    let mut lists: BTreeMap<u32, Vec<u8>> = BTreeMap::new();
    for (n, (_, _, of_tile)) in tiles.iter().enumerate() {
        for (word, weight) in of_tile {
            let list = lists.entry(*word).or_default();
            list.extend((n as u32).to_le_bytes());
            list.push((weight / FULL * 255.0).ceil().clamp(1.0, 255.0) as u8);
        }
    }
    let mut out = MAGIC.to_vec();
    for number in [facts.checksum, words, tiles.len() as u32, ROW as u32] {
        out.extend(number.to_le_bytes());
    }
    let mut offset = 0u64;
    for word in 0..words {
        out.extend(offset.to_le_bytes());
        offset += lists.get(&word).map_or(0, |list| list.len() as u64);
    }
    out.extend(offset.to_le_bytes());
    for (atlas, tile, _) in tiles {
        let start = out.len();
        out.extend(tile.map.digest.0);
        out.extend(tile.map.bytes.to_le_bytes());
        out.extend(atlas.to_le_bytes());
        out.extend((tile.root as u32).to_le_bytes());
        out.extend(u32::from(tile.cell.is_some()).to_le_bytes());
        tile.cell.unwrap_or_default().iter().for_each(|c| out.extend(c.to_le_bytes()));
        tile.key_frames.iter().for_each(|k| out.extend((*k as u32).to_le_bytes()));
        debug_assert_eq!(out.len() - start, ROW);
    }
    lists.values().for_each(|list| out.extend(list));
    out
}

/// Reads an index by ranges: `read(from, to)` gives those bytes.
pub(crate) struct Reader<R> {
    read: R,
    words: u64,
    tiles: u64,
}

impl<R: FnMut(u64, u64) -> Result<Vec<u8>, FleetError>> Reader<R> {
    pub(crate) fn open(mut read: R) -> Result<Self, FleetError> {
        let header = read(0, HEADER)?;
        let number = |k: usize| {
            header.get(8 + 4 * k..12 + 4 * k).and_then(|b| Some(u32::from_le_bytes(b.try_into().ok()?)))
        };
        let numbers = [number(0), number(1), number(2), number(3)];
        let [Some(vocabulary), Some(words), Some(tiles), Some(row)] = numbers else {
            return Err(FleetError::damaged("index", "it ends early"));
        };
        if !header.starts_with(&MAGIC) || row as usize != ROW {
            return Err(FleetError::new(
                "index",
                "it is of another version",
                "use the program that built it",
            ));
        }
        if vocabulary != Vocabulary::current().facts().checksum {
            let cure = "build the atlas again with this program, or use its vocabulary";
            return Err(FleetError::new("index", "it was made with another vocabulary", cure));
        }
        Ok(Self { read, words: words.into(), tiles: tiles.into() })
    }

    /// The scores of the tiles that show any of these words, as place in the index, best first.
    pub(crate) fn scores(&mut self, query: &[(u32, f32)]) -> Result<Vec<(u32, f64)>, FleetError> {
        let lists = HEADER + 8 * (self.words + 1) + ROW as u64 * self.tiles;
        let mut scores: BTreeMap<u32, f64> = BTreeMap::new();
        for (word, weight) in query.iter().filter(|(word, _)| u64::from(*word) < self.words) {
            let at = HEADER + 8 * u64::from(*word);
            let ends = (self.read)(at, at + 16)?;
            let end = |k: usize| {
                ends.get(8 * k..8 * k + 8).and_then(|b| Some(u64::from_le_bytes(b.try_into().ok()?)))
            };
            let (Some(from), Some(to)) = (end(0), end(1)) else {
                return Err(FleetError::damaged("index", "it ends early"));
            };
            // A list names a tile at most once.
            if from > to || to - from > ENTRY as u64 * self.tiles {
                return Err(FleetError::damaged(
                    "index",
                    format!("the list of word {word} is longer than all tiles"),
                ));
            }
            if from == to {
                continue;
            }
            let list = (self.read)(lists.saturating_add(from), lists.saturating_add(to))?;
            for (entry, _) in list.as_chunks::<ENTRY>().0.iter().zip(0..self.tiles) {
                let tile = u32::from_le_bytes([entry[0], entry[1], entry[2], entry[3]]);
                let there = f32::from(entry[4]) / 255.0 * FULL;
                *scores.entry(tile).or_default() += f64::from(weight.min(there));
            }
        }
        let mut sorted: Vec<(u32, f64)> = scores.into_iter().collect();
        sorted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        Ok(sorted)
    }

    /// A tile by its place in the index.
    pub(crate) fn row(&mut self, tile: u32) -> Result<Row, FleetError> {
        let damaged = || FleetError::damaged("index", format!("it has no tile {tile}"));
        if u64::from(tile) >= self.tiles {
            return Err(damaged());
        }
        let at = HEADER + 8 * (self.words + 1) + ROW as u64 * u64::from(tile);
        let row = (self.read)(at, at + ROW as u64)?;
        let row: &[u8; ROW] = row.as_slice().try_into().map_err(|_| damaged())?;
        let u32_at = |k: usize| u32::from_le_bytes([row[k], row[k + 1], row[k + 2], row[k + 3]]);
        let mut digest = [0; 32];
        digest.copy_from_slice(&row[..32]);
        let bytes = u64::from(u32_at(32)) | u64::from(u32_at(36)) << 32;
        let cell = [u32_at(52) as i32, u32_at(56) as i32, u32_at(60) as i32];
        Ok(Row {
            map: Blob { digest: Digest(digest), bytes },
            atlas: u32_at(40),
            cell: (u32_at(48) != 0).then_some(cell),
            key_frames: u32_at(68),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(n: u8, cell: Option<[i32; 3]>) -> Tile {
        let map = Blob { digest: Digest([n; 32]), bytes: 1 << 33 };
        Tile { map, root: 7, cell, key_frames: [3, 5 + usize::from(n)] }
    }

    #[test]
    fn an_index_finds_what_was_put_in_and_refuses_damage() {
        let words = |all: &[(u32, f32)]| all.iter().copied().collect::<BTreeMap<_, _>>();
        let tiles = [
            (0, tile(1, Some([-2, 3, 0])), words(&[(5, 0.01), (6, 0.02)])),
            (1, tile(2, None), words(&[(6, 0.005), (900, 0.03)])),
        ];
        let bytes = write(&tiles);
        let from = |bytes: &[u8]| {
            let bytes = bytes.to_vec();
            Reader::open(move |from, to| {
                let range = usize::try_from(from).unwrap()..usize::try_from(to).unwrap();
                bytes.get(range).map(<[u8]>::to_vec).ok_or_else(|| FleetError::damaged("index", "short"))
            })
        };
        let mut reader = from(&bytes).unwrap();
        let scores = reader.scores(&[(5, 0.02), (6, 0.01), (123, 0.4), (u32::MAX, 0.1)]).unwrap();
        assert_eq!(scores.iter().map(|s| s.0).collect::<Vec<_>>(), [0, 1]);
        assert!((scores[0].1 - 0.02).abs() < 2e-4 && (scores[1].1 - 0.005).abs() < 2e-4, "{scores:?}");
        let row = reader.row(0).unwrap();
        assert_eq!(
            (row.map, row.atlas, row.cell, row.key_frames),
            (tiles[0].1.map.clone(), 0, Some([-2, 3, 0]), 6)
        );
        assert_eq!(reader.row(1).unwrap().cell, None);
        assert!(reader.row(2).is_err());
        for cut in [0, 3, 20, 30, bytes.len() - 1] {
            if let Ok(mut reader) = from(&bytes[..cut]) {
                assert!(reader.scores(&[(900, 0.1)]).is_err(), "{cut}");
            }
        }
        let mut other = bytes.clone();
        other[8] ^= 1;
        assert!(from(&other).err().unwrap().to_string().contains("another vocabulary"));
    }
}
