//! Fetching a tile by place: from an image or the beginning of a recording to the tile that shows the same place.
//!
//! By words first, reading of the index only the lists of the heaviest words. A recording is then tracked in the best tiles until one of
//! them holds it; of a single image no more is known than its words.

use crate::place_index::Reader;
use crate::shelf::blob_name;
use crate::task::Blob;
use crate::{Digest, FleetError, Store};
use cairn::Slam;
use cairn::atlas::store::MapFile;
use cairn::sensor::GrayImage;
use cairn::vision::bow::{BagOfWords, Vocabulary};
use cairn::vision::{Features, OrbConfig, OrbExtractor};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Words of an image that are looked up.
const WORDS: usize = 96;
/// Images of a recording that are looked up, and every how many frames one.
const IMAGES: usize = 5;
const EVERY: usize = 10;
/// Frames that are tracked in a tile to see whether it is the right one.
const TRACKED: usize = 30;
/// Tiles that are fetched and tried, at most.
const TRIED: usize = 3;

/// What is looked for.
pub struct Query {
    address: String,
    /// For each image its heaviest words.
    images: Vec<Vec<(u32, f32)>>,
    recording: bool,
}

/// A tile that shows words of the query.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// Its map file.
    pub map: Blob,
    /// Which atlas it belongs to, by its place in `atlas.json`.
    pub atlas: u32,
    /// Its cube.
    pub cell: Option<[i32; 3]>,
    /// Key frames.
    pub key_frames: u32,
    /// Weight of words of the query that it shows, 0 to 1, the mean of the images.
    pub score: f64,
}

/// What was fetched.
#[derive(Clone, Debug, Serialize)]
pub struct Fetched {
    /// The tile.
    pub tile: Found,
    /// Of the first frames of the recording so many have a pose in it, and so many there were; none for an image, where only
    /// words speak for the tile.
    pub tracked: Option<[usize; 2]>,
    /// The score of the best other tile.
    pub next_score: f64,
    /// Bytes read: index, and tiles.
    pub index_bytes: u64,
    /// Bytes of the tiles that were read.
    pub tile_bytes: u64,
}

/// The words of an image (PNG or JPEG), or of the beginning of a recording.
///
/// # Errors
/// When it cannot be read.
pub fn query_of(address: &str) -> Result<Query, FleetError> {
    let path = Path::new(address);
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let image = path.is_file() && ["png", "jpg", "jpeg"].contains(&ending.as_str());
    let mut extractor = OrbExtractor::new(OrbConfig::default());
    let images = if image {
        let image = cairn::sources::read_gray(path).map_err(|e| {
            FleetError::new(address, e.to_string(), "give a PNG or JPEG image, or a recording")
        })?;
        vec![words(&mut extractor, &image)]
    } else {
        let unread = |e: &dyn std::fmt::Display| FleetError::new(address, e, "give an image or a recording");
        let mut source = cairn::open(address).map_err(|e| unread(&e))?;
        let mut images = Vec::new();
        for n in 0..IMAGES * EVERY {
            let Some(packet) = source.next_packet().map_err(|e| unread(&e))? else { break };
            if n % EVERY == 0
                && let Some(image) = packet.images.first()
            {
                images.push(words(&mut extractor, image));
            }
        }
        images
    };
    Ok(Query { address: address.to_owned(), images, recording: !image })
}

fn words(extractor: &mut OrbExtractor, image: &GrayImage) -> Vec<(u32, f32)> {
    let mut features = Features::default();
    extractor.extract(image, &mut features);
    heaviest(&Vocabulary::current().bag(&features.descriptors), WORDS)
}

/// The heaviest words of a bag, heaviest first.
fn heaviest(bag: &BagOfWords, most: usize) -> Vec<(u32, f32)> {
    let mut words: Vec<(u32, f32)> = bag.words().iter().map(|(word, weight)| (word.0, *weight)).collect();
    words.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    words.truncate(most);
    words
}

#[derive(Deserialize)]
struct About {
    index: Blob,
}

/// The tiles that show most of a query, best first, at most `most`; and how many bytes were read for that.
///
/// # Errors
/// When nothing was published in the store, or it cannot be read.
pub fn find(store: &dyn Store, query: &Query, most: usize) -> Result<(Vec<Found>, u64), FleetError> {
    let about = store.get("atlas.json")?.ok_or_else(|| {
        FleetError::new(
            "atlas.json",
            "nothing was published in this store",
            "build it with cairn fleet build",
        )
    })?;
    let mut read_bytes = about.len() as u64;
    let about: About = serde_json::from_slice(&about).map_err(|e| FleetError::damaged("atlas.json", e))?;
    let name = blob_name(about.index.digest);
    let mut reader = Reader::open(|from, to| {
        read_bytes += to - from;
        store.get_range(&name, from..to)
    })?;
    let mut sum = std::collections::BTreeMap::<u32, f64>::new();
    for image in &query.images {
        for (tile, score) in reader.scores(image)? {
            *sum.entry(tile).or_default() += score / query.images.len() as f64;
        }
    }
    let mut scores: Vec<(u32, f64)> = sum.into_iter().collect();
    scores.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let found = scores.into_iter().take(most).map(|(tile, score)| {
        let row = reader.row(tile)?;
        Ok(Found { map: row.map, atlas: row.atlas, cell: row.cell, key_frames: row.key_frames, score })
    });
    let found = found.collect::<Result<Vec<_>, FleetError>>()?;
    Ok((found, read_bytes))
}

/// Fetches the tile for a query; its bytes are those of a map file. `None` where no tile shows any of its words, or the recording is tracked in
/// none of the best.
///
/// # Errors
/// When nothing was published in the store, or it cannot be read, or the recording cannot be.
pub fn fetch(store: &dyn Store, query: &Query) -> Result<Option<(Fetched, Vec<u8>)>, FleetError> {
    let (found, index_bytes) = find(store, query, TRIED + 1)?;
    let next_score = |n: usize| found.iter().enumerate().find(|(k, _)| *k != n).map_or(0.0, |(_, f)| f.score);
    let mut tile_bytes = 0;
    for (n, tile) in found.iter().enumerate().take(TRIED) {
        let name = blob_name(tile.map.digest);
        let bytes = store.get(&name)?.filter(|bytes| Digest::of(bytes) == tile.map.digest);
        let bytes = bytes.ok_or_else(|| FleetError::damaged(&name, "the tile is missing or damaged"))?;
        tile_bytes += bytes.len() as u64;
        let tracked = if query.recording { Some(tracked(&query.address, &bytes)?) } else { None };
        if tracked.is_none_or(|[held, of]| 2 * held > of) {
            let fetched =
                Fetched { tile: tile.clone(), tracked, next_score: next_score(n), index_bytes, tile_bytes };
            return Ok(Some((fetched, bytes)));
        }
    }
    Ok(None)
}

/// How many of the first frames of a recording have a pose in a tile, and how many there were.
fn tracked(address: &str, tile: &[u8]) -> Result<[usize; 2], FleetError> {
    let failed =
        |e: &dyn std::fmt::Display| FleetError::new(address, e, "check the recording with cairn run");
    let file = MapFile::read(tile).map_err(|e| failed(&e))?;
    let mut source = cairn::open(address).map_err(|e| failed(&e))?;
    let mut slam = match Slam::for_source(&*source).localize_in(file).build() {
        Ok(slam) => slam,
        // A tile of other sensors or octaves holds no frame of this recording.
        Err(_) => return Ok([0, 1]),
    };
    let (mut held, mut frames) = (0, 0);
    while frames < TRACKED {
        let Some(packet) = source.next_packet().map_err(|e| failed(&e))? else { break };
        frames += 1;
        held += usize::from(slam.track(&packet).is_ok_and(|output| output.pose.is_some()));
    }
    Ok([held, frames])
}
