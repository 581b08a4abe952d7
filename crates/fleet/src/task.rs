//! Tasks, and what comes of them: plain data that goes to workers and back as JSON.

use crate::Digest;
use serde::{Deserialize, Serialize};

/// An object named after its content.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Blob {
    /// SHA-256 of the content.
    pub digest: Digest,
    /// Its length.
    pub bytes: u64,
}

/// One task. Each can be done on any machine that reaches the store, any number of times.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "kebab-case")]
pub enum Task {
    /// Map a recording.
    Map {
        /// Its name, below the address of the recordings.
        recording: String,
    },
    /// Put the keys of the places of maps into one shard of the index of places.
    Index {
        /// The maps, each with its keys.
        maps: Vec<(Digest, Digest)>,
    },
    /// Find pairs of maps that may share places.
    Pairs {
        /// All shards.
        shards: Vec<Digest>,
    },
    /// Verify by geometry whether two map files share places.
    Verify {
        /// A map file.
        a: Digest,
        /// Another.
        b: Digest,
    },
    /// Merge maps that are connected by verified pairs.
    Merge {
        /// The maps, in rising order.
        maps: Vec<Digest>,
        /// The pairs: places in `maps`, each with the root of the map of that file.
        pairs: Vec<[(usize, usize); 2]>,
    },
    /// Cut an atlas into tiles.
    Tiles {
        /// The atlas.
        atlas: Digest,
    },
    /// Publish: the index of all tiles, and what they were made from.
    Publish {
        /// The atlases, each with its tiles and where it comes from.
        atlases: Vec<Atlas>,
    },
}

/// An atlas of the build: what is connected.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Atlas {
    /// The map file.
    pub map: Blob,
    /// For each source map: its robot numbers in the atlas, and the recordings that gave it.
    pub sources: Vec<Source>,
    /// What the tiles step wrote.
    pub tiles: Blob,
}

/// A recorded walk in an atlas.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// The recordings; several only where they are the same to the byte.
    pub recordings: Vec<String>,
    /// Its map.
    pub map: Digest,
    /// The robots of its key frames, with their numbers in the atlas.
    pub robots: Vec<(u16, u16)>,
}

/// What came of a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The key of the step; none where it is not kept.
    pub key: Option<Digest>,
    /// Whether it had been done before.
    pub reused: bool,
    /// Seconds that it took here.
    pub seconds: f64,
    /// Bytes read from the store, and from the address of the recordings where that is not this machine.
    pub read_bytes: u64,
    /// Bytes written to the store.
    pub written_bytes: u64,
    /// What it found.
    pub result: Result,
}

/// What a task found. The same, to the byte, wherever and whenever it is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "result", rename_all = "kebab-case")]
pub enum Result {
    /// Of `Map`.
    Mapped(Mapped),
    /// Of `Map`: there is no map of this recording. It is tried again by the next build.
    Unmapped {
        /// Why.
        why: String,
    },
    /// Of `Index`.
    Indexed {
        /// The shard.
        shard: Blob,
    },
    /// Of `Pairs`.
    Paired(Paired),
    /// Of `Verify`.
    Verified(Verified),
    /// Of `Merge`.
    Merged(Merged),
    /// Of `Tiles`.
    Tiled(Tiled),
    /// Of `Publish`.
    Published(Published),
}

/// The map of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mapped {
    /// The map file.
    pub map: Blob,
    /// The keys of its places.
    pub places: Blob,
    /// Key frames.
    pub key_frames: usize,
    /// Maps in the file: more than one where the walk was lost and found no way back.
    pub maps: usize,
    /// Frames of the recording.
    pub frames: usize,
    /// Its length, seconds.
    pub recorded_s: f64,
}

/// Pairs of maps that may share places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Paired {
    /// The pairs, each in rising order.
    pub pairs: Vec<Pair>,
    /// Bits that two of their stretches must have.
    pub enough: u32,
}

/// Two maps that may share places.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pair {
    /// A map.
    pub a: Digest,
    /// Another, greater one.
    pub b: Digest,
    /// How unlikely what two stretches of theirs have in common is by chance: minus the logarithm to the base 2, the most of all.
    pub bits: u32,
}

/// Whether two map files share places, by geometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verified {
    /// The pairs of their maps that do.
    pub joined: Vec<Joined>,
    /// Why others stay apart, one line for each pair of their maps.
    pub apart: Vec<String>,
}

/// A map of each of two files that share places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joined {
    /// The roots of the map of file `a` and of that of file `b`.
    pub roots: [usize; 2],
    /// Seams that agree, and recognised places that do not.
    pub seams: [usize; 2],
    /// Key frames that should show the other map, and how many do.
    pub support: [usize; 2],
    /// How far they overlap, metres; none where lengths are not metres.
    pub overlap_m: Option<f64>,
}

/// Maps in one file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Merged {
    /// The map file.
    pub map: Blob,
    /// For each of the maps, in their order, its robots with their numbers in the file.
    pub robots: Vec<Vec<(u16, u16)>>,
    /// The maps of the file, each with the source maps (as places in the task's list) that became one.
    pub parts: Vec<Vec<usize>>,
    /// Key frames.
    pub key_frames: usize,
    /// Pairs that geometry had verified, but that did not become one in the end, with the reason.
    pub apart: Vec<String>,
}

/// The tiles of an atlas.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tiled {
    /// The list of tiles with their words, as the step `publish` reads it.
    pub list: Blob,
    /// How many tiles.
    pub tiles: usize,
    /// Bytes of all.
    pub bytes: u64,
    /// Key frames of all, those of margins counted again.
    pub key_frames: usize,
}

/// A piece of an atlas: a map file of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tile {
    /// The map file.
    pub map: Blob,
    /// Which map of the atlas it was cut from: the index of that map's root.
    pub root: usize,
    /// Its cube, counted from the root along the three axes; none where lengths are not metres, and the tile is the whole map.
    pub cell: Option<[i32; 3]>,
    /// Key frames in the cube, and with its margin.
    pub key_frames: [usize; 2],
}

/// The published atlas.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Published {
    /// What `atlas.json` of the store holds; its digest is the digest of the whole atlas.
    pub atlas: Blob,
    /// The index of tiles by words.
    pub index: Blob,
    /// How many tiles.
    pub tiles: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tasks and outcomes go to workers and back, and lie in the store, as JSON.
    #[test]
    fn what_is_written_as_json_is_read_back() {
        let blob = Blob { digest: Digest([7; 32]), bytes: 5 };
        let robots = vec![(0, 0), (3, 12)];
        let source = Source { recordings: vec!["a".into()], map: blob.digest, robots: robots.clone() };
        let atlas = Atlas { map: blob.clone(), sources: vec![source], tiles: blob.clone() };
        let joined = Joined { roots: [0, 25], seams: [9, 1], support: [8, 9], overlap_m: Some(6.25) };
        for task in [
            Task::Publish { atlases: vec![atlas] },
            Task::Merge { maps: vec![blob.digest], pairs: vec![[(0, 0), (1, 25)]] },
        ] {
            let text = serde_json::to_string(&task).unwrap();
            assert_eq!(serde_json::from_str::<Task>(&text).unwrap(), task, "{text}");
        }
        for result in [
            Result::Verified(Verified { joined: vec![joined], apart: vec!["no".into()] }),
            Result::Merged(Merged {
                map: blob,
                robots: vec![robots],
                parts: vec![vec![0]],
                key_frames: 3,
                apart: Vec::new(),
            }),
        ] {
            let (key, reused, seconds) = (Some(Digest([1; 32])), true, 0.25);
            let outcome = Outcome { key, reused, seconds, read_bytes: 1, written_bytes: 2, result };
            let text = serde_json::to_string(&outcome).unwrap();
            assert_eq!(serde_json::from_str::<Outcome>(&text).unwrap(), outcome, "{text}");
        }
    }
}
