//! A map as a robot sends it to its team: what joining needs of it, in pieces of which each save adds one.
//!
//! Of a map go the features that show landmarks, in parts of a pixel (`state.rs`), one descriptor for each landmark, landmarks
//! by where their first key frame sees them, the poses of key frames, and what an IMU (`motion.rs`) and depth (`relative.rs`) measured between them. What local
//! mapping moves by less than can matter is not sent again, and a landmark moves along with its key frame. Words and features without
//! landmarks stay; words are computed again.
//!
//! ```text
//! magic 8 | piece | piece | ..      piece: bytes u32 | postcard of what changed since the pieces before
//! ```
//!
//! So all pieces but the last stay the same from one save to the next, byte for byte.

mod delta;
mod measured;
mod motion;
mod pose;
mod rebuild;
mod related;
mod relative;
mod state;

use super::error::StoreError;
use super::layout::MapFile;
use delta::Delta;
use serde::{Deserialize, Serialize};
use state::State;

/// First bytes of a map in pieces, before its format, a digit.
const PREFIX: &[u8] = b"\x8ccairn/";
/// The format that is written and read.
const FORMAT: u8 = b'5';
/// A piece may unpack to at most so many times its bytes, and all pieces together to so many bytes.
const MAX_RATIO: usize = 64;
const MAX_PLAIN_BYTES: usize = 1 << 30;
/// So many pieces, at most, or all is said anew in one.
const MAX_PIECES: usize = 2_000;
/// Whether the pieces have become too long is asked when they are so much longer than last time.
const LONGER: usize = 2;
/// Pieces so much longer than one that says the same are replaced by it.
const WORTH: f64 = 1.5;

/// Where the bytes of a map in pieces are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartBytes {
    /// Pixels, levels, angles and depths of features.
    pub features: usize,
    /// Which landmarks they show.
    pub shown: usize,
    /// Positions of landmarks.
    pub landmarks: usize,
    /// Descriptors of landmarks.
    pub descriptors: usize,
    /// Key frames: time, pose, parent, loops.
    pub key_frames: usize,
    /// Readings of an IMU, velocities and biases.
    pub imu: usize,
    /// Poses of key frames relative to others, as depth measured them.
    pub relative_poses: usize,
    /// Cameras, maps, removed key frames, what is attached.
    pub other: usize,
}

/// A map in pieces, which grows with each save.
#[derive(Clone, Debug)]
pub struct Pieces {
    bytes: Vec<u8>,
    lengths: Vec<usize>,
    state: State,
    /// Length at which is asked whether one piece would be shorter.
    review: usize,
}

impl Default for Pieces {
    fn default() -> Self {
        let bytes = [PREFIX, &[FORMAT]].concat();
        Self { lengths: Vec::new(), bytes, state: State::default(), review: 1 << 20 }
    }
}

/// A piece as it is stored, packed by LZ4 where that is shorter.
#[derive(Debug, Serialize, Deserialize)]
struct Stored<'a> {
    plain_bytes: u32,
    packed: bool,
    bytes: &'a [u8],
}

/// Whether these bytes begin as a map in pieces does, of any format.
pub fn is_in_pieces(bytes: &[u8]) -> bool {
    bytes.starts_with(PREFIX)
}

/// The map that these pieces make up, as far as it was sent.
///
/// # Errors
/// [`StoreError`] when they are damaged, of another format, or what they say contradicts itself.
pub fn read(bytes: &[u8]) -> Result<MapFile, StoreError> {
    rebuild::map_of(&Pieces::open(bytes)?.state)
}

impl Pieces {
    /// The pieces of an earlier time, to go on with.
    ///
    /// # Errors
    /// [`StoreError`] when they are damaged or of another format.
    pub fn open(bytes: &[u8]) -> Result<Self, StoreError> {
        let wrong = || StoreError::part("pieces", "they do not make up a map");
        let format = bytes.strip_prefix(PREFIX).and_then(|rest| rest.first()).ok_or_else(wrong)?;
        if *format != FORMAT {
            let [found, known] = [*format, FORMAT].map(char::from);
            let why = format!("they are of format {found:?}, this program reads {known:?}");
            return Err(StoreError::part("pieces", why));
        }
        let mut pieces = Self { bytes: bytes.to_vec(), ..Self::default() };
        let mut at = PREFIX.len() + 1;
        let (mut begins, mut total) = (0, 0usize);
        while at < bytes.len() {
            let (plain, end) = next(bytes, at).ok_or_else(wrong)?;
            total = total.saturating_add(plain.len());
            let delta = (total <= MAX_PLAIN_BYTES).then(|| postcard::take_from_bytes::<Delta>(&plain).ok());
            let Some((delta, [])) = delta.flatten() else { return Err(wrong()) };
            delta.apply(&mut pieces.state).ok_or_else(wrong)?;
            pieces.lengths.push(end - begins);
            (at, begins) = (end, end);
        }
        pieces.review = pieces.review.max(bytes.len());
        if pieces.lengths.is_empty() { Err(wrong()) } else { Ok(pieces) }
    }

    /// Adds what is new in a save, if there is anything; where the pieces have become much longer than need be, all is said
    /// anew.
    ///
    /// # Errors
    /// [`StoreError`] when features cannot be read.
    pub fn add(&mut self, file: &MapFile) -> Result<(), StoreError> {
        let state = State::of(file, &self.state)?;
        let delta = Delta::between(&self.state, &state);
        if !self.lengths.is_empty() && delta.is_empty() {
            return Ok(());
        }
        self.push(&delta);
        self.state = state;
        if self.bytes.len() > self.review || self.lengths.len() > MAX_PIECES {
            let mut anew = Self { state: State::of(file, &State::default())?, ..Self::default() };
            anew.push(&Delta::between(&State::default(), &anew.state));
            let shorter = anew.bytes.len() as f64 * WORTH < self.bytes.len() as f64;
            if shorter || self.lengths.len() > MAX_PIECES {
                *self = anew;
            }
            self.review = self.review.max(LONGER * self.bytes.len());
        }
        Ok(())
    }

    fn push(&mut self, delta: &Delta) {
        let before = if self.lengths.is_empty() { 0 } else { self.bytes.len() };
        // Encoding into memory cannot fail.
        let stored = packed(&postcard::to_stdvec(delta).unwrap_or_default());
        self.bytes.extend((stored.len() as u32).to_le_bytes());
        self.bytes.extend(stored);
        self.lengths.push(self.bytes.len() - before);
    }

    /// All pieces, end to end.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Their lengths; together they are all bytes.
    pub fn lengths(&self) -> &[usize] {
        &self.lengths
    }

    /// What the bytes of all pieces are for, before they are packed.
    ///
    /// # Errors
    /// [`StoreError`] when they are damaged.
    pub fn parts(&self) -> Result<PartBytes, StoreError> {
        let wrong = || StoreError::part("pieces", "they do not make up a map");
        let (mut at, mut parts) = (PREFIX.len() + 1, PartBytes::default());
        while at < self.bytes.len() {
            let (plain, end) = next(&self.bytes, at).ok_or_else(wrong)?;
            postcard::from_bytes::<Delta>(&plain).map_err(|_| wrong())?.count(&mut parts);
            at = end;
        }
        Ok(parts)
    }
}

/// The piece that begins here, unpacked, and where it ends.
fn next(bytes: &[u8], at: usize) -> Option<(Vec<u8>, usize)> {
    let (length, rest) = bytes.get(at..)?.split_first_chunk::<4>()?;
    let length = u32::from_le_bytes(*length) as usize;
    Some((unpacked(rest.get(..length)?)?, at + 4 + length))
}

fn packed(plain: &[u8]) -> Vec<u8> {
    let short = lz4_flex::block::compress(plain);
    let packed = short.len() < plain.len() && plain.len() / MAX_RATIO <= short.len();
    let bytes = if packed { &short } else { plain };
    postcard::to_stdvec(&Stored { plain_bytes: plain.len() as u32, packed, bytes }).unwrap_or_default()
}

fn unpacked(piece: &[u8]) -> Option<Vec<u8>> {
    let (piece, []) = postcard::take_from_bytes::<Stored<'_>>(piece).ok()? else { return None };
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
