//! Messages between peers: what each has and wants, what a robot published, and its blocks on request.

use super::seal::{Identity, hash, is_signed};
use crate::{MAX_REQUESTS_BYTES, MAX_ROBOTS, Refused, RobotId};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Greatest length of a block, in bytes.
pub const BLOCK_BYTES: usize = 64 << 10;
/// Greatest number of blocks of a part.
pub(super) const MAX_BLOCKS: usize = 4096;
/// Bytes of a block in a manifest: its hash, and its length as a varint.
const ENTRY_BYTES: usize = 16 + 3;
/// Greatest length of what a robot publishes, in bytes.
pub const MAX_PART_BYTES: usize = 64 << 20;
/// Greatest length of the words that a robot publishes, in bytes.
pub const MAX_WORDS_PART_BYTES: usize = 8 << 20;
/// Greatest length of the features of key frames that look like what others saw, in bytes.
pub const MAX_PLACES_PART_BYTES: usize = 16 << 20;
/// Greatest length of a message between peers, in bytes.
pub const MAX_PEER_MESSAGE_BYTES: usize = MAX_BLOCKS * ENTRY_BYTES + 1024;
/// Blocks that may be on their way from one peer, by number and bytes.
pub(super) const WINDOW: usize = 48;
pub(super) const WINDOW_BYTES: usize = 1 << 20;

/// A version of what a robot published: its number, and of versions with one number (a robot restored from a copy) the
/// hash decides, so that everyone chooses the same.
pub(super) type Stamp = (u32, [u8; 8]);

/// What a robot publishes, each with versions of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) enum Layer {
    /// The bags of words of its key frames: every robot gets them.
    Words,
    /// Its map: only robots that want it get it.
    Map,
    /// Features of those of its key frames that look like what others saw. Of two robots one looks whether the other saw the same:
    /// that of the greater number, where it wants the map of the other.
    Places,
    /// Which further key frames of others it needs features of to tell that: these are of smaller numbers.
    Requests,
}

/// How many layers there are.
const LAYERS: usize = 4;

impl Layer {
    /// Whether a robot that `wants` maps gets this layer of another robot; its own it gets back where it has lost it.
    pub fn goes_to(self, to: RobotId, of: RobotId, wants: &MapSubscription) -> bool {
        match self {
            Self::Words => true,
            Self::Map => wants.includes(of),
            Self::Places => of <= to && wants.includes(of),
            Self::Requests => of >= to && wants.includes(of),
        }
    }
}

/// A layer of a robot.
pub(super) type Topic = (RobotId, Layer);

/// Whose maps a peer wants; it gets the words of all.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MapSubscription {
    /// Of all robots.
    All,
    /// Of these, and its own if it has lost it.
    Of(BTreeSet<RobotId>),
}

impl MapSubscription {
    /// Whether the map of this robot is wanted.
    pub fn includes(&self, robot: RobotId) -> bool {
        match self {
            Self::All => true,
            Self::Of(robots) => robots.contains(&robot),
        }
    }

    fn is_bounded(&self) -> bool {
        matches!(self, Self::Of(robots) if robots.len() <= MAX_ROBOTS) || *self == Self::All
    }
}

/// Kinds of messages between peers, for counting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PeerKind {
    /// Which versions a peer has, and whose maps it wants.
    Have,
    /// What a robot published: lengths and hashes of the blocks, signed.
    Manifest,
    /// A request for blocks.
    Want,
    /// A block of the words of a robot's key frames.
    Words,
    /// A block of a robot's map.
    Block,
    /// A block of the features of its key frames that look like what others saw.
    Places,
    /// A request for features of further key frames.
    Requests,
}

impl std::fmt::Display for PeerKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Have => "have",
            Self::Manifest => "manifest",
            Self::Want => "want",
            Self::Words => "words",
            Self::Block => "block",
            Self::Places => "places",
            Self::Requests => "requests",
        })
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct PeerMessage {
    pub from: RobotId,
    pub body: Body,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Body {
    Have { has: Vec<(Topic, Stamp)>, wants: MapSubscription },
    Manifest(Manifest),
    Want { topic: Topic, stamp: Stamp, blocks: Vec<u16> },
    Block { topic: Topic, stamp: Stamp, index: u16, bytes: Vec<u8> },
}

impl PeerMessage {
    pub fn kind(&self) -> PeerKind {
        match self.body {
            Body::Have { .. } => PeerKind::Have,
            Body::Manifest(_) => PeerKind::Manifest,
            Body::Want { .. } => PeerKind::Want,
            Body::Block { topic: (_, Layer::Words), .. } => PeerKind::Words,
            Body::Block { topic: (_, Layer::Places), .. } => PeerKind::Places,
            Body::Block { topic: (_, Layer::Requests), .. } => PeerKind::Requests,
            Body::Block { .. } => PeerKind::Block,
        }
    }

    pub fn decode(body: &[u8]) -> Result<Self, Refused> {
        let (message, rest) = postcard::take_from_bytes::<Self>(body).map_err(|_| Refused::Encoding)?;
        let sound = match &message.body {
            Body::Have { has, wants } => has.len() <= LAYERS * MAX_ROBOTS && wants.is_bounded(),
            Body::Want { blocks, .. } => blocks.len() <= WINDOW,
            Body::Block { bytes, .. } => bytes.len() <= BLOCK_BYTES,
            Body::Manifest(manifest) => manifest.blocks.len() <= MAX_BLOCKS,
        };
        if rest.is_empty() && sound { Ok(message) } else { Err(Refused::Encoding) }
    }
}

/// What a robot published: signed, so that anybody can pass it on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Manifest {
    pub robot: RobotId,
    pub layer: Layer,
    pub version: u32,
    /// Hash and length of each block.
    pub blocks: Vec<([u8; 16], u32)>,
    pub key: [u8; 32],
    pub signature: Vec<u8>,
}

impl Manifest {
    pub fn new(identity: &Identity, layer: Layer, version: u32, blocks: &[&[u8]]) -> Self {
        let mut manifest = Self {
            robot: identity.robot(),
            layer,
            version,
            blocks: blocks.iter().map(|block| (hash(block), block.len() as u32)).collect(),
            key: identity.public(),
            signature: Vec::new(),
        };
        manifest.signature = identity.sign(&manifest.signed());
        manifest
    }

    /// The bytes that the signature covers.
    fn signed(&self) -> Vec<u8> {
        let mut bytes = match self.layer {
            Layer::Words => b"cairn words".to_vec(),
            Layer::Map => b"cairn map".to_vec(),
            Layer::Places => b"cairn places".to_vec(),
            Layer::Requests => b"cairn requests".to_vec(),
        };
        bytes.extend(self.robot.to_le_bytes());
        bytes.extend(self.version.to_le_bytes());
        for (hash, length) in &self.blocks {
            bytes.extend(hash);
            bytes.extend(length.to_le_bytes());
        }
        bytes
    }

    pub fn topic(&self) -> Topic {
        (self.robot, self.layer)
    }

    pub fn stamp(&self) -> Stamp {
        (self.version, hash(&self.signed()))
    }

    pub fn check(&self) -> Result<(), Refused> {
        let fits = |(_, length): &([u8; 16], u32)| (1..=BLOCK_BYTES).contains(&(*length as usize));
        if self.blocks.is_empty() || !self.blocks.iter().all(fits) {
            return Err(Refused::Inconsistent("its blocks do not make up a map"));
        }
        let most = match self.layer {
            Layer::Words => MAX_WORDS_PART_BYTES,
            Layer::Map => MAX_PART_BYTES,
            Layer::Places => MAX_PLACES_PART_BYTES,
            Layer::Requests => MAX_REQUESTS_BYTES,
        };
        if self.length() > most {
            return Err(Refused::TooLong(self.length()));
        }
        match is_signed(&self.key, &self.signed(), &self.signature) {
            true => Ok(()),
            false => Err(Refused::Signature(self.robot)),
        }
    }

    /// Length in bytes.
    pub fn length(&self) -> usize {
        self.blocks.iter().map(|(_, length)| *length as usize).sum()
    }
}
