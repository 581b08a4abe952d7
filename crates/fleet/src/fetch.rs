//! Fetching a tile by place: from an image or the beginning of a recording to the tile that shows the same place.
//!
//! By words first, reading of the index only the lists of the heaviest words. Geometry decides: a recording is tracked in the best tiles until
//! one of them holds it, and an image must show landmarks of one of them ([`crate::seen`]). Otherwise the place is unknown.

use crate::place_index::Reader;
use crate::seen::{Image, Seen};
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
    images: Vec<Image>,
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

/// What geometry says of a query in a tile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Evidence {
    /// Of a recording: so many of the first frames have a pose in it, of so many.
    Tracked([usize; 2]),
    /// Of an image.
    Seen(Seen),
}

impl Evidence {
    /// Whether it is enough.
    pub fn suffices(&self) -> bool {
        match self {
            Self::Tracked([held, of]) => 2 * held > *of,
            Self::Seen(seen) => seen.position.is_some(),
        }
    }

    /// How much there is, to compare tiles by.
    fn amount(&self) -> usize {
        match self {
            Self::Tracked([held, _]) => *held,
            Self::Seen(seen) => seen.landmarks,
        }
    }
}

/// Where a query is.
#[derive(Debug)]
pub enum Answer {
    /// In this tile, whose bytes are those of a map file.
    Place(Fetched, Vec<u8>),
    /// In no tile; with the most that speaks for any that was tried.
    Unknown(Option<Evidence>),
}

/// What was fetched.
#[derive(Clone, Debug, Serialize)]
pub struct Fetched {
    /// The tile.
    pub tile: Found,
    /// What speaks for it.
    pub evidence: Evidence,
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
        vec![features(&mut extractor, &image)]
    } else {
        let unread = |e: &dyn std::fmt::Display| FleetError::new(address, e, "give an image or a recording");
        let mut source = cairn::open(address).map_err(|e| unread(&e))?;
        let mut images = Vec::new();
        for n in 0..IMAGES * EVERY {
            let Some(packet) = source.next_packet().map_err(|e| unread(&e))? else { break };
            if n % EVERY == 0
                && let Some(image) = packet.images.first()
            {
                images.push(features(&mut extractor, image));
            }
        }
        images
    };
    Ok(Query { address: address.to_owned(), images, recording: !image })
}

fn features(extractor: &mut OrbExtractor, image: &GrayImage) -> Image {
    let mut features = Features::default();
    extractor.extract(image, &mut features);
    let bag = Vocabulary::current().bag(&features.descriptors);
    Image { bag, features, size: [image.width(), image.height()] }
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
        for (tile, score) in reader.scores(&heaviest(&image.bag, WORDS))? {
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

/// Fetches the tile for a query: of those with most of its words the first in which geometry finds it.
///
/// # Errors
/// When nothing was published in the store, or it cannot be read, or the recording cannot be.
pub fn fetch(store: &dyn Store, query: &Query) -> Result<Answer, FleetError> {
    let (found, index_bytes) = find(store, query, TRIED + 1)?;
    let next_score = |n: usize| found.iter().enumerate().find(|(k, _)| *k != n).map_or(0.0, |(_, f)| f.score);
    let (mut tile_bytes, mut most) = (0, None::<Evidence>);
    for (n, tile) in found.iter().enumerate().take(TRIED) {
        let name = blob_name(tile.map.digest);
        let bytes = store.get(&name)?.filter(|bytes| Digest::of(bytes) == tile.map.digest);
        let bytes = bytes.ok_or_else(|| FleetError::damaged(&name, "the tile is missing or damaged"))?;
        tile_bytes += bytes.len() as u64;
        let file = MapFile::read(&bytes).map_err(|e| FleetError::damaged(&name, e))?;
        let evidence = match query.images.first() {
            Some(image) if !query.recording => Evidence::Seen(image.in_tile(&file)),
            _ => Evidence::Tracked(tracked(&query.address, file)?),
        };
        if evidence.suffices() {
            let (tile, next_score) = (tile.clone(), next_score(n));
            let fetched = Fetched { tile, evidence, next_score, index_bytes, tile_bytes };
            return Ok(Answer::Place(fetched, bytes));
        }
        most = most.into_iter().chain([evidence]).max_by_key(Evidence::amount);
    }
    Ok(Answer::Unknown(most))
}

/// How many of the first frames of a recording have a pose in a tile, and how many there were.
fn tracked(address: &str, file: MapFile) -> Result<[usize; 2], FleetError> {
    let failed =
        |e: &dyn std::fmt::Display| FleetError::new(address, e, "check the recording with cairn run");
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
