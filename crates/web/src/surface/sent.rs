//! What a page has of the surface, and what it is sent next: at most [`BYTES_PER_S`], in small messages.
//!
//! The nearest block comes first, one that the page has not seen as if it were [`UNSEEN_M`] nearer, and each that waits as if
//! it came nearer by [`AGING_M_PER_S`] (aging, as in Silberschatz, "Operating System Concepts", section 5.3): so whatever
//! changes beside the camera, every block is sent in the end.
//!
//! A message is little-endian: kind 3, whether the page begins anew (one byte each), two bytes of nothing, the edge of a voxel in
//! metres (32-bit float); then lists, each with its count (32 bits) in front: submaps that are gone (numbers of 32 bits); poses
//! (number, twelve 32-bit floats: rows of the rotation, each followed by its part of the translation); and blocks: number of the
//! submap, key (three signed 32-bit numbers), tenths of a second from the beginning until it had a surface (32 bits), counts of vertices and
//! triangles (16 bits each), vertices (three numbers of 16 bits: 1/4096 of a voxel from the block's corner), corners of the triangles (8 bits each
//! where there are at most 256 vertices, else 16), counter-clockwise as seen from free space. A block without triangles is gone.

use super::{Name, Piece, Pose, Surface};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

const KIND: u8 = 3;
/// The rate at which a page may be sent surface, and how much of it at once after a pause: together the most in any second.
const BYTES_PER_S: f64 = 160_000.0;
const AT_ONCE: f64 = 40_000.0;
const UNSEEN_M: f32 = 10.0;
const AGING_M_PER_S: f32 = 2.0;
/// Bytes of a message without its lists, of a pose, and of a block without its mesh.
const HEAD: usize = 20;
const POSE: usize = 4 + 48;
const BLOCK: usize = 4 + 12 + 4 + 4;

/// What a page has.
pub(crate) struct Sent {
    begun: bool,
    poses: BTreeMap<u32, Pose>,
    /// The blocks that it draws.
    has: BTreeSet<Name>,
    /// Those it lacks, or has an older mesh of, since when.
    waiting: BTreeMap<Name, Instant>,
    /// The change up to which `waiting` is complete.
    seen: u64,
    /// What it may be sent, and when that was so; and the most at once.
    bytes: f64,
    at: Instant,
    at_once: f64,
}

impl Sent {
    /// A page that has nothing.
    pub fn new(now: Instant) -> Self {
        Self {
            begun: false,
            poses: BTreeMap::new(),
            has: BTreeSet::new(),
            waiting: BTreeMap::new(),
            seen: 0,
            bytes: AT_ONCE,
            at: now,
            at_once: AT_ONCE,
        }
    }

    /// A viewer on this machine, which may be sent all at once.
    pub fn beside(now: Instant) -> Self {
        Self { bytes: f64::MAX, at_once: f64::MAX, ..Self::new(now) }
    }

    /// Time has passed: more may be sent.
    pub fn wait(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.at).as_secs_f64();
        (self.bytes, self.at) = ((self.bytes + BYTES_PER_S * passed).min(self.at_once), now);
    }

    /// What else may be sent now, in bytes.
    pub fn left(&self) -> usize {
        self.bytes as usize
    }

    /// So much else was sent.
    pub fn spend(&mut self, bytes: usize) {
        self.bytes -= bytes as f64;
    }

    /// The next message of at most `room` bytes; `None` where nothing is to be sent or nothing may be.
    pub fn message(&mut self, surface: &Surface, room: usize, now: Instant) -> Option<Vec<u8>> {
        self.wait(now);
        let most = room.min(self.at_once as usize);
        let room = room.min(self.bytes as usize);
        self.notice(surface, now);
        let mut out = Message::new(!self.begun, surface.voxel_m);
        let gone: Vec<u32> =
            self.poses.keys().copied().filter(|id| !surface.parts.contains_key(id)).collect();
        for id in gone {
            if !out.fits(4, room) {
                break;
            }
            out.gone(id);
            self.poses.remove(&id);
        }
        for (id, part) in &surface.parts {
            if self.poses.get(id) != Some(&part.pose) && out.fits(POSE, room) {
                out.pose(*id, &part.pose);
                self.poses.insert(*id, part.pose);
            }
        }
        for name in self.in_order(surface, now) {
            let piece = surface.piece(&name);
            // On a link too slow for it this block is left out, and keeps no other from being sent.
            if HEAD + BLOCK + piece.map_or(0, bytes) > most {
                continue;
            }
            if !out.fits(BLOCK + piece.map_or(0, bytes), room) {
                break;
            }
            out.block(&name, piece);
            self.waiting.remove(&name);
            match piece {
                Some(_) => self.has.insert(name),
                None => self.has.remove(&name),
            };
        }
        let message = out.end()?;
        self.begun = true;
        self.spend(message.len());
        Some(message)
    }

    /// What has changed since the last message waits.
    fn notice(&mut self, surface: &Surface, now: Instant) {
        for (_, name) in surface.changes.range(self.seen + 1..) {
            if surface.piece(name).is_some() || self.has.contains(name) {
                self.waiting.entry(*name).or_insert(now);
            } else {
                self.waiting.remove(name);
            }
        }
        self.seen = surface.version;
        let is_left = |(id, _): &Name| surface.parts.contains_key(id);
        self.waiting.retain(|name, _| is_left(name));
        self.has.retain(is_left);
    }

    /// What waits and can be placed, the most wanted first.
    fn in_order(&self, surface: &Surface, now: Instant) -> Vec<Name> {
        let placed = self.waiting.iter().filter(|((id, _), _)| self.poses.contains_key(id));
        let mut all: Vec<(f32, Name)> = placed
            .map(|(name, since)| {
                let waited = now.saturating_duration_since(*since).as_secs_f32();
                let unseen = if self.has.contains(name) { 0.0 } else { UNSEEN_M };
                (surface.away(name) - unseen - AGING_M_PER_S * waited, *name)
            })
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.into_iter().map(|(_, name)| name).collect()
    }
}

/// Bytes of a mesh.
fn bytes(piece: &Piece) -> usize {
    6 * piece.positions.len() + 3 * piece.triangles.len() * if is_small(piece) { 1 } else { 2 }
}

fn is_small(piece: &Piece) -> bool {
    piece.positions.len() <= 256
}

/// A message, its lists one after another.
struct Message {
    head: Vec<u8>,
    lists: [(u32, Vec<u8>); 3],
    length: usize,
}

impl Message {
    fn new(whole: bool, voxel_m: f32) -> Self {
        let mut head = vec![KIND, u8::from(whole), 0, 0];
        head.extend(voxel_m.to_le_bytes());
        Self { head, lists: Default::default(), length: HEAD }
    }

    fn fits(&self, bytes: usize, room: usize) -> bool {
        self.length + bytes <= room
    }

    fn add(&mut self, list: usize, bytes: impl IntoIterator<Item = u8>) {
        let before = self.lists[list].1.len();
        self.lists[list].1.extend(bytes);
        self.length += self.lists[list].1.len() - before;
    }

    fn gone(&mut self, id: u32) {
        self.lists[0].0 += 1;
        self.add(0, id.to_le_bytes());
    }

    fn pose(&mut self, id: u32, pose: &Pose) {
        self.lists[1].0 += 1;
        self.add(1, id.to_le_bytes().into_iter().chain(pose.iter().flat_map(|v| v.to_le_bytes())));
    }

    fn block(&mut self, (id, key): &Name, piece: Option<&Piece>) {
        self.lists[2].0 += 1;
        self.add(2, id.to_le_bytes().into_iter().chain(key.iter().flat_map(|v| v.to_le_bytes())));
        let Some(piece) = piece else { return self.add(2, [0; 8]) };
        self.add(2, piece.born.to_le_bytes());
        for count in [piece.positions.len(), piece.triangles.len()] {
            self.add(2, (count as u16).to_le_bytes());
        }
        self.add(2, piece.positions.iter().flatten().flat_map(|v| v.to_le_bytes()));
        let corners = piece.triangles.iter().flatten();
        match is_small(piece) {
            true => self.add(2, corners.map(|v| *v as u8)),
            false => self.add(2, corners.flat_map(|v| v.to_le_bytes())),
        }
    }

    /// The bytes; `None` where all lists are empty.
    fn end(self) -> Option<Vec<u8>> {
        if self.lists.iter().all(|(count, _)| *count == 0) {
            return None;
        }
        let mut out = self.head;
        for (count, list) in self.lists {
            out.extend(count.to_le_bytes());
            out.extend(list);
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests;
