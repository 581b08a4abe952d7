//! The index of a bag: its topics, and the positions of the wanted messages.

use crate::area::InputFile;
use crate::compression::{Compression, MAX_CHUNK, ZSTD_MAGIC, decompress};
use crate::error::Damage;
use crate::message::{MessageKind, is_foxglove};
use crate::wire::{WireFormat, header_stamp};
use std::collections::BTreeMap;

/// Bytes from the start of a message that the index reads: encapsulation or sequence number, and stamp.
pub(crate) const PREFIX: u64 = 20;

/// Times are clamped to these bounds, nanoseconds, so that differences never overflow: up to the year 2109, which
/// covers all stamps of ROS.
const TIMES: [i64; 2] = [-4_400_000_000_000_000_000, 4_400_000_000_000_000_000];

/// A time within these bounds.
pub(crate) fn clamped(ns: i64) -> i64 {
    ns.clamp(TIMES[0], TIMES[1])
}

/// Position of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    /// Index of the file in the bag.
    pub file: u16,
    /// The chunk it is in; [`Place::PLAIN`] when it is in the file itself. In a database: the page.
    pub chunk: u32,
    /// Offset in the file or in the decompressed chunk. In a database: the cell of the page.
    pub offset: u64,
    /// Length in bytes.
    pub length: u32,
}

impl Place {
    /// The value of `chunk` for messages that are not compressed.
    pub const PLAIN: u32 = u32::MAX;
}

/// Position of a compressed chunk in its file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChunkAt {
    /// Offset of its compressed bytes.
    pub at: u64,
    /// Number of its compressed bytes.
    pub length: u64,
    /// How the chunk is compressed.
    pub compression: Compression,
    /// The stated decompressed size, bytes.
    pub size: u64,
}

impl ChunkAt {
    /// The decompressed bytes up to the first damage, and what is wrong there.
    pub fn unpack(&self, file: &mut InputFile) -> Result<(Vec<u8>, Option<String>), Damage> {
        if self.length > MAX_CHUNK || self.size > MAX_CHUNK {
            let why =
                format!("a compressed chunk of {} bytes, {MAX_CHUNK} at most", self.size.max(self.length));
            return Err(Damage::new(self.at, why));
        }
        let packed = file.read(self.at, self.length)?;
        let (bytes, why) = decompress(self.compression, &packed, self.size);
        let short = (bytes.len() as u64) < self.size;
        Ok((bytes, why.or(short.then(|| format!("{} bytes are stated, less is there", self.size)))))
    }
}

/// A message in the index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// The stamp of its header, nanoseconds; the time of recording if it has no header.
    pub stamp_ns: i64,
    /// The time of recording, nanoseconds.
    pub log_ns: i64,
    pub(crate) place: Place,
}

/// A topic of a bag.
#[derive(Clone, Debug)]
pub struct Topic {
    /// Its name, such as `/cam0/image_raw`.
    pub name: String,
    /// The type of its messages without `msg/`, such as `sensor_msgs/Image`.
    pub kind: String,
    /// How its messages are serialised.
    pub format: WireFormat,
    /// Number of all messages found.
    pub count: usize,
    /// The messages that are indexed, in order of recording.
    pub entries: Vec<Entry>,
    keep: usize,
    pub(crate) has_header: bool,
}

impl Topic {
    /// What kind of messages it has.
    pub fn message_kind(&self) -> MessageKind {
        MessageKind::of(&self.kind)
    }

    /// The stamp of a message, from its first bytes.
    pub(crate) fn stamp_ns(has_header: bool, format: WireFormat, log_ns: i64, prefix: &[u8]) -> i64 {
        let stamp = if has_header { header_stamp(format, prefix) } else { None };
        clamped(stamp.filter(|s| *s != 0).unwrap_or(log_ns))
    }
}

/// Returns how many messages of a topic (name, type) to index.
pub(crate) type TopicFilter<'a> = &'a dyn Fn(&str, &str) -> usize;

/// The index while a bag is being scanned.
pub(crate) struct Index<'a> {
    pub topics: Vec<Topic>,
    pub chunks: Vec<ChunkAt>,
    wanted: TopicFilter<'a>,
    /// Topic by file and connection (channel, topic id).
    connections: BTreeMap<(u16, u32), usize>,
    /// Problems of the bag, one sentence each.
    pub notes: Vec<String>,
    /// Number of messages of connections that were never declared.
    undeclared: usize,
    /// Whether CDR messages were found that are Zstandard frames.
    pub has_zstd_messages: bool,
    pub last_log_ns: Option<i64>,
}

impl<'a> Index<'a> {
    pub fn new(wanted: TopicFilter<'a>) -> Self {
        Self {
            topics: Vec::new(),
            chunks: Vec::new(),
            wanted,
            connections: BTreeMap::new(),
            notes: Vec::new(),
            undeclared: 0,
            has_zstd_messages: false,
            last_log_ns: None,
        }
    }

    /// Adds a compressed chunk; returns its number for [`Place::chunk`].
    pub fn chunk(&mut self, at: ChunkAt) -> u32 {
        self.chunks.push(at);
        // A chunk takes at least 50 bytes of the file; `u32::MAX` marks messages without a chunk.
        u32::try_from(self.chunks.len() - 1).unwrap_or(Place::PLAIN)
    }

    /// Declares a connection of a file; connections of the same topic and type are merged into one topic.
    pub fn connection(&mut self, file: u16, id: u32, name: &str, kind: &str, format: WireFormat) {
        let kind = kind.replace("/msg/", "/");
        // In ROS 1, Foxglove's types begin with a bare time; that form is not supported.
        let format = match format {
            WireFormat::Ros1 if is_foxglove(&kind) => WireFormat::Other,
            other => other,
        };
        let same = |t: &Topic| t.name == name && t.kind == kind && t.format == format;
        let topic = self.topics.iter().position(same).unwrap_or_else(|| {
            let keep = (self.wanted)(name, &kind);
            // All other types begin with their stamp.
            let has_header = MessageKind::of(&kind) != MessageKind::Other;
            self.topics.push(Topic {
                name: name.to_owned(),
                kind,
                format,
                count: 0,
                entries: Vec::new(),
                keep,
                has_header,
            });
            self.topics.len() - 1
        });
        self.connections.insert((file, id), topic);
    }

    /// Adds a message, given its first bytes.
    pub fn message(&mut self, id: u32, log_ns: i64, prefix: &[u8], place: Place) {
        let Some(&topic) = self.connections.get(&(place.file, id)) else {
            self.undeclared += 1;
            return;
        };
        let topic = &mut self.topics[topic];
        let log_ns = clamped(log_ns);
        topic.count += 1;
        self.last_log_ns = self.last_log_ns.max(Some(log_ns));
        if topic.entries.len() >= topic.keep {
            return;
        }
        self.has_zstd_messages |= topic.format == WireFormat::Cdr && prefix.starts_with(&ZSTD_MAGIC);
        let stamp_ns = Topic::stamp_ns(topic.has_header, topic.format, log_ns, prefix);
        topic.entries.push(Entry { stamp_ns, log_ns, place });
    }

    /// Number of messages found so far.
    pub fn count(&self) -> usize {
        self.topics.iter().map(|t| t.count).sum()
    }

    /// Sorts the messages of each topic by recording time.
    pub fn finish(mut self) -> (Vec<Topic>, Vec<ChunkAt>, Vec<String>) {
        if self.undeclared > 0 {
            self.notes.push(format!("{} messages belong to no topic, left out", self.undeclared));
        }
        for topic in &mut self.topics {
            topic.entries.sort_by_key(|e| e.log_ns);
        }
        (self.topics, self.chunks, self.notes)
    }
}
