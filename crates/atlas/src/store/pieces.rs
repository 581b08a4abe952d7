//! A saved map as pieces that stay the same from one save to the next, for sending only what is new.
//!
//! A part of a file holds columns over all key frames, and so every save of a growing map changes nearly all its bytes.
//! Here the same bytes stand row by row: the features and words of each key frame by themselves, which never change;
//! which landmarks they show, key frames and landmarks in short runs, which local mapping changes only where the camera
//! is. Two saves then have most pieces in common, byte for byte.
//!
//! ```text
//! length of the index u32 | index (postcard) | pieces, end to end
//! ```
//!
//! A piece holds for each lane (a plane of bytes of a column) the stretch of its rows. [`whole`] needs to know nothing of
//! columns: it puts the stretches of each lane end to end.

use super::VERSION;
use super::container::{Parts, PartsWriter};
use super::error::StoreError;
use super::layout::{CHUNK, FEATURES, SHOWN};
use serde::{Deserialize, Serialize};
use std::io::Cursor;
use std::ops::Range;

/// First bytes of a map in pieces.
const MAGIC: [u8; 8] = *b"\x8ccairn/1";
/// Key frames and landmarks whose ids differ only below this bit are in one run.
const RUN_BITS: [u32; 2] = [3, 8];
/// A piece may unpack to at most so many times its bytes, and all pieces together to so many bytes.
const MAX_RATIO: usize = 64;
const MAX_PLAIN_BYTES: usize = 1 << 30;

/// A part of the file: bytes before its columns, and for each band of columns the lengths of its pieces.
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    name: String,
    head: Vec<u8>,
    bands: Vec<Vec<u32>>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Index {
    version: u32,
    rows: Vec<Row>,
}

/// A piece: bytes of each lane, packed by LZ4 where that is shorter.
#[derive(Debug, Serialize, Deserialize)]
struct Piece<'a> {
    plain_bytes: u32,
    packed: bool,
    bytes: &'a [u8],
}

/// A map in pieces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pieces {
    /// All bytes.
    pub bytes: Vec<u8>,
    /// Lengths of the pieces, in order; together they are all bytes.
    pub lengths: Vec<usize>,
}

/// Whether these bytes begin as a map in pieces does.
pub fn is_in_pieces(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// Cuts a saved map into pieces.
///
/// # Errors
/// [`StoreError`] when it is damaged, or of another version than is written now.
pub fn cut(map: &[u8]) -> Result<Pieces, StoreError> {
    let parts = Parts::open(map, VERSION)?;
    let rows = Rows::of(&parts)?;
    let mut index = Index { version: parts.version, rows: Vec::new() };
    let mut pieces: Vec<Vec<u8>> = Vec::new();
    for name in parts.names() {
        let plain = parts.get(name)?;
        let damaged = || StoreError::part(name, "its columns do not fill it");
        let (head, bands) = rows.cut(name, &plain).ok_or_else(damaged)?;
        let lengths = |band: &Vec<Vec<u8>>| band.iter().map(|piece| piece.len() as u32).collect();
        let bands_bytes = bands.iter().map(lengths).collect();
        index.rows.push(Row { name: name.to_owned(), head: head.to_vec(), bands: bands_bytes });
        pieces.extend(bands.into_iter().flatten());
    }
    // Encoding into memory cannot fail.
    let index = postcard::to_stdvec(&index).unwrap_or_default();
    let mut bytes = MAGIC.to_vec();
    bytes.extend((index.len() as u32).to_le_bytes());
    bytes.extend(index);
    let mut all = vec![bytes.len()];
    all.extend(pieces.iter().map(Vec::len));
    pieces.iter().for_each(|piece| bytes.extend(piece));
    Ok(Pieces { bytes, lengths: all })
}

/// The saved map that was cut into these pieces.
///
/// # Errors
/// [`StoreError`] when they are damaged. Whether the map is valid is checked when it is read.
pub fn whole(bytes: &[u8]) -> Result<Vec<u8>, StoreError> {
    let wrong = || StoreError::part("pieces", "they do not make up a map");
    let rest = bytes.strip_prefix(&MAGIC).ok_or_else(wrong)?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(wrong)?;
    let (index, mut rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or_else(wrong)?;
    let index: Index = postcard::from_bytes(index).map_err(|_| wrong())?;
    if index.version == 0 || index.version > VERSION {
        return Err(StoreError::part("pieces", format!("they are of format {}", index.version)));
    }
    let mut file = Cursor::new(Vec::new());
    let names = index.rows.iter().map(|row| row.name.clone()).collect();
    let mut out = PartsWriter::begin(&mut file, index.version, names)?;
    let mut total = 0usize;
    for row in &index.rows {
        let mut plain = row.head.clone();
        for band in &row.bands {
            let lanes = lanes_of(band, &mut rest, &mut total).ok_or_else(wrong)?;
            lanes.iter().for_each(|lane| plain.extend(lane));
        }
        out.put(&plain)?;
    }
    if !rest.is_empty() {
        return Err(wrong());
    }
    out.finish()?;
    Ok(file.into_inner())
}

/// The lanes of a band, from its pieces.
fn lanes_of(band: &[u32], rest: &mut &[u8], total: &mut usize) -> Option<Vec<Vec<u8>>> {
    let mut lanes: Vec<Vec<u8>> = Vec::new();
    for length in band {
        let (piece, after) = rest.split_at_checked(*length as usize)?;
        *rest = after;
        let plain = unpacked(piece)?;
        *total = total.checked_add(plain.len()).filter(|n| *n <= MAX_PLAIN_BYTES)?;
        let own: Vec<&[u8]> = postcard::from_bytes(&plain).ok()?;
        if lanes.is_empty() {
            lanes = vec![Vec::new(); own.len()];
        }
        if own.len() != lanes.len() {
            return None;
        }
        lanes.iter_mut().zip(own).for_each(|(lane, own)| lane.extend(own));
    }
    Some(lanes)
}

fn packed(lanes: &[&[u8]]) -> Vec<u8> {
    let plain = postcard::to_stdvec(lanes).unwrap_or_default();
    let short = lz4_flex::block::compress(&plain);
    let packed = short.len() < plain.len() && plain.len() / MAX_RATIO <= short.len();
    let bytes = if packed { &short } else { &plain };
    postcard::to_stdvec(&Piece { plain_bytes: plain.len() as u32, packed, bytes }).unwrap_or_default()
}

fn unpacked(piece: &[u8]) -> Option<Vec<u8>> {
    let piece: Piece<'_> = postcard::from_bytes(piece).ok()?;
    if !piece.packed {
        return Some(piece.bytes.to_vec());
    }
    let plain_bytes = piece.plain_bytes as usize;
    if plain_bytes / MAX_RATIO > piece.bytes.len() {
        return None;
    }
    let plain = lz4_flex::block::decompress(piece.bytes, plain_bytes).ok()?;
    (plain.len() == plain_bytes).then_some(plain)
}

/// The bytes of a part before its columns, and the pieces of each band.
type Cut<'a> = (&'a [u8], Vec<Vec<Vec<u8>>>);

/// Which rows the columns of a map have.
struct Rows {
    /// Runs of key frames with neighbouring ids, and of landmarks.
    key_frame_runs: Vec<Range<usize>>,
    landmark_runs: Vec<Range<usize>>,
    /// For each key frame: one, its features, loops, covisible neighbours, words, nodes.
    one: Vec<usize>,
    features: Vec<usize>,
    links: Vec<usize>,
    covisible: Vec<usize>,
    words: Vec<usize>,
    nodes: Vec<usize>,
    /// One for each landmark.
    landmarks: Vec<usize>,
}

impl Rows {
    fn of(parts: &Parts) -> Result<Self, StoreError> {
        let (key_frames, words, landmarks) =
            (parts.get("key frames")?, parts.get("words")?, parts.get("landmarks")?);
        let short = |part: &str| StoreError::part(part, "it is too short for its rows");
        // The number of key frames is the third of the six counts that end it.
        let about = parts.get("about")?;
        let at = about.len().checked_sub(16).ok_or_else(|| short("about"))?;
        let count = about.get(at..).and_then(|tail| tail.first_chunk::<4>()).copied();
        let count = u32::from_le_bytes(count.ok_or_else(|| short("about"))?) as usize;
        let column = |k: usize| u32s(&key_frames, 4 * k * count, count).ok_or_else(|| short("key frames"));
        let of_words = |k: usize| u32s(&words, 4 + 4 * k * count, count).ok_or_else(|| short("words"));
        let landmark_count = landmarks.len() / LANDMARK_BYTES;
        let steps = u32s(&landmarks, 0, landmark_count).ok_or_else(|| short("landmarks"))?;
        let ids: Vec<usize> = steps
            .iter()
            .scan(0usize, |sum, step| {
                *sum = sum.wrapping_add(*step);
                Some(*sum)
            })
            .collect();
        Ok(Self {
            key_frame_runs: runs(&column(0)?, RUN_BITS[0]),
            landmark_runs: runs(&ids, RUN_BITS[1]),
            one: vec![1; count],
            features: column(3)?,
            links: column(4)?,
            covisible: column(5)?,
            words: of_words(0)?,
            nodes: of_words(1)?,
            landmarks: vec![1; landmark_count],
        })
    }

    /// Cuts a part.
    fn cut<'a>(&self, name: &str, plain: &'a [u8]) -> Option<Cut<'a>> {
        if let Some(chunk) = name.strip_prefix(FEATURES) {
            return self.cut_features(chunk.parse::<usize>().ok()?.checked_mul(CHUNK)?, plain);
        }
        if name == SHOWN {
            return self.cut_shown(plain);
        }
        let one = &self.one[..];
        let (head, lanes, groups): (usize, Vec<&[usize]>, Vec<Range<usize>>) = match name {
            "words" => {
                let lanes = [vec![one; 8], vec![&self.words[..]; 8], vec![&self.nodes[..]; 6]].concat();
                (4, lanes, alone(one.len()))
            }
            "key frames" => {
                let lists = [vec![&self.links[..]; 4], vec![&self.covisible[..]; 8]].concat();
                (0, [vec![one; KEY_FRAME_BYTES], lists].concat(), self.key_frame_runs.clone())
            }
            "landmarks" => (0, vec![&self.landmarks[..]; LANDMARK_BYTES], self.landmark_runs.clone()),
            _ => return Some((&[], vec![vec![packed(&[plain])]])),
        };
        let (head, mut rest) = plain.split_at_checked(head)?;
        let band = by_rows(&mut rest, &lanes, &groups)?;
        rest.is_empty().then_some((head, vec![band]))
    }

    /// The landmarks that features show; levels, angles and descriptors of landmarks.
    fn cut_shown<'a>(&self, plain: &'a [u8]) -> Option<Cut<'a>> {
        let mut rest = plain;
        let shown = by_rows(&mut rest, &[&self.features[..]; 4], &self.key_frame_runs)?;
        let wide: Vec<usize> = self.landmarks.iter().map(|n| n * 32).collect();
        let lanes = [vec![&self.landmarks[..]; 5], vec![&wide[..]]].concat();
        let look = by_rows(&mut rest, &lanes, &self.landmark_runs)?;
        rest.is_empty().then_some((&[], vec![shown, look]))
    }

    /// Features of a chunk of key frames: pixels, raw pixels where they differ, angle, right x and depth; the landmarks
    /// that they show; octave and descriptor.
    fn cut_features<'a>(&self, first: usize, plain: &'a [u8]) -> Option<Cut<'a>> {
        let end = self.one.len().min(first.checked_add(CHUNK)?);
        let counts = self.features.get(first..end)?;
        let wide: Vec<usize> = counts.iter().map(|n| n * 32).collect();
        let (head, mut rest) = plain.split_at_checked(1)?;
        let before = if head == [0] { 28 } else { 20 };
        let seen = by_rows(&mut rest, &vec![counts; before], &alone(counts.len()))?;
        let of_run = |run: &Range<usize>| {
            let (a, b) = (run.start.max(first), run.end.min(end));
            (a < b).then(|| a - first..b - first)
        };
        let runs: Vec<Range<usize>> = self.key_frame_runs.iter().filter_map(of_run).collect();
        let shown = by_rows(&mut rest, &[counts; 4], &runs)?;
        let described = by_rows(&mut rest, &[counts, &wide], &alone(counts.len()))?;
        rest.is_empty().then_some((head, vec![seen, shown, described]))
    }
}

/// Each row by itself.
fn alone(rows: usize) -> Vec<Range<usize>> {
    (0..rows).map(|k| k..k + 1).collect()
}

/// Bytes of a key frame in the columns of one row each, and of a landmark.
const KEY_FRAME_BYTES: usize = 6 * 4 + 8 + 8 * 8;
const LANDMARK_BYTES: usize = 4 + 3 * 8 + 4;

/// A column of numbers in planes.
fn u32s(bytes: &[u8], at: usize, n: usize) -> Option<Vec<usize>> {
    let planes = bytes.get(at..at.checked_add(n.checked_mul(4)?)?)?;
    let value = |i: usize| u32::from_le_bytes(std::array::from_fn(|k| planes[k * n + i])) as usize;
    Some((0..n).map(value).collect())
}

/// Rows whose rising ids differ only below this bit.
fn runs(ids: &[usize], bits: u32) -> Vec<Range<usize>> {
    let mut at = 0;
    let run = |same: &[usize]| {
        at += same.len();
        at - same.len()..at
    };
    ids.chunk_by(|a, b| a >> bits == b >> bits).map(run).collect()
}

/// Cuts columns off into pieces of these groups of rows; `None` when there are too few bytes. Each lane has for every
/// row a number of bytes.
fn by_rows(bytes: &mut &[u8], lanes: &[&[usize]], groups: &[Range<usize>]) -> Option<Vec<Vec<u8>>> {
    let mut pieces: Vec<Vec<&[u8]>> = vec![Vec::with_capacity(lanes.len()); groups.len()];
    for lane in lanes {
        for (piece, group) in pieces.iter_mut().zip(groups) {
            let n = lane.get(group.clone())?.iter().try_fold(0usize, |sum, n| sum.checked_add(*n))?;
            let (own, after) = bytes.split_at_checked(n)?;
            piece.push(own);
            *bytes = after;
        }
    }
    Some(pieces.iter().map(|piece| packed(piece)).collect())
}
