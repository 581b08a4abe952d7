//! Writes an MCAP file: chunks compressed by LZ4, with the index that viewers need for seeking (mcap.dev/spec).

use super::foxglove::Schema;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Uncompressed size of a chunk, bytes.
const CHUNK: usize = 1 << 20;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const HEADER: u8 = 1;
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK_RECORD: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const CHUNK_INDEX: u8 = 8;
const STATISTICS: u8 = 11;
const SUMMARY_OFFSET: u8 = 14;
const DATA_END: u8 = 15;

/// A topic of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel(u16);

/// Writes a file; [`McapWriter::finish`] completes it. An incomplete file can still be read up to its last whole chunk.
pub struct McapWriter<W: Write> {
    to: W,
    /// Number of bytes written.
    at: u64,
    schemas: Vec<&'static str>,
    /// Schema and channel records, to be repeated in the summary.
    declared: [Vec<u8>; 2],
    /// Number of messages of each channel.
    counts: Vec<u64>,
    sequence: u32,
    times: Option<[u64; 2]>,
    chunk: Vec<u8>,
    chunk_times: Option<[u64; 2]>,
    /// For each channel the times and offsets of its messages in the current chunk.
    chunk_index: BTreeMap<u16, Vec<(u64, u64)>>,
    chunk_records: Vec<u8>,
    chunks: u32,
}

impl<W: Write> McapWriter<W> {
    /// Starts a file of ROS 2 messages.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn new(to: W) -> io::Result<Self> {
        let mut file = Self {
            to,
            at: 0,
            schemas: Vec::new(),
            declared: [Vec::new(), Vec::new()],
            counts: Vec::new(),
            sequence: 0,
            times: None,
            chunk: Vec::new(),
            chunk_times: None,
            chunk_index: BTreeMap::new(),
            chunk_records: Vec::new(),
            chunks: 0,
        };
        let mut header = Vec::new();
        text(&mut header, "ros2");
        text(&mut header, concat!("cairn ", env!("CARGO_PKG_VERSION")));
        file.write(MAGIC)?;
        file.write(&record(HEADER, &header))?;
        Ok(file)
    }

    /// Adds a topic.
    pub fn channel(&mut self, topic: &str, schema: &Schema) -> Channel {
        let known = self.schemas.iter().position(|name| *name == schema.name);
        let schema_id = known.unwrap_or_else(|| {
            self.schemas.push(schema.name);
            let mut content = (self.schemas.len() as u16).to_le_bytes().to_vec();
            text(&mut content, schema.name);
            text(&mut content, "ros2msg");
            text(&mut content, &schema.text());
            self.declare(0, &record(SCHEMA, &content));
            self.schemas.len() - 1
        }) + 1;
        let id = self.counts.len() as u16;
        let mut content = id.to_le_bytes().to_vec();
        content.extend((schema_id as u16).to_le_bytes());
        text(&mut content, topic);
        text(&mut content, "cdr");
        content.extend(0u32.to_le_bytes());
        self.declare(1, &record(CHANNEL, &content));
        self.counts.push(0);
        Channel(id)
    }

    /// Writes a schema or channel before the messages that use it, and keeps it for the summary.
    fn declare(&mut self, kind: usize, record: &[u8]) {
        self.chunk.extend_from_slice(record);
        self.declared[kind].extend_from_slice(record);
    }

    /// Adds a message with a time in nanoseconds.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn message(&mut self, channel: Channel, stamp_ns: i64, message: &[u8]) -> io::Result<()> {
        let time = stamp_ns.max(0) as u64;
        let spread = |old: Option<[u64; 2]>| Some(old.map_or([time; 2], |[a, b]| [a.min(time), b.max(time)]));
        (self.times, self.chunk_times) = (spread(self.times), spread(self.chunk_times));
        self.chunk_index.entry(channel.0).or_default().push((time, self.chunk.len() as u64));
        if let Some(count) = self.counts.get_mut(usize::from(channel.0)) {
            *count += 1;
        }
        let mut content = channel.0.to_le_bytes().to_vec();
        content.extend(self.sequence.to_le_bytes());
        content.extend(time.to_le_bytes());
        content.extend(time.to_le_bytes());
        content.extend_from_slice(message);
        self.sequence = self.sequence.wrapping_add(1);
        self.chunk.extend(record(MESSAGE, &content));
        if self.chunk.len() >= CHUNK { self.end_chunk() } else { Ok(()) }
    }

    /// Writes the chunk and its index.
    fn end_chunk(&mut self) -> io::Result<()> {
        let records = std::mem::take(&mut self.chunk);
        let index = std::mem::take(&mut self.chunk_index);
        let [first, last] = self.chunk_times.take().unwrap_or_default();
        if records.is_empty() {
            return Ok(());
        }
        let mut packer = lz4_flex::frame::FrameEncoder::new(Vec::new());
        packer.write_all(&records)?;
        let packed = packer.finish().map_err(io::Error::other)?;
        let mut content = Vec::with_capacity(packed.len() + 50);
        content.extend(first.to_le_bytes());
        content.extend(last.to_le_bytes());
        content.extend((records.len() as u64).to_le_bytes());
        content.extend(crc32fast::hash(&records).to_le_bytes());
        text(&mut content, "lz4");
        content.extend((packed.len() as u64).to_le_bytes());
        content.extend_from_slice(&packed);
        let start = self.at;
        let chunk = record(CHUNK_RECORD, &content);
        self.write(&chunk)?;
        let indices_at = self.at;
        let mut offsets = Vec::new();
        for (channel, entries) in &index {
            offsets.extend(channel.to_le_bytes());
            offsets.extend(self.at.to_le_bytes());
            let mut content = channel.to_le_bytes().to_vec();
            content.extend((16 * entries.len() as u32).to_le_bytes());
            for (time, offset) in entries {
                content.extend(time.to_le_bytes());
                content.extend(offset.to_le_bytes());
            }
            self.write(&record(MESSAGE_INDEX, &content))?;
        }
        let mut about = Vec::new();
        for v in [first, last, start, chunk.len() as u64] {
            about.extend(v.to_le_bytes());
        }
        about.extend((offsets.len() as u32).to_le_bytes());
        about.extend(offsets);
        about.extend((self.at - indices_at).to_le_bytes());
        text(&mut about, "lz4");
        about.extend((packed.len() as u64).to_le_bytes());
        about.extend((records.len() as u64).to_le_bytes());
        self.chunk_records.extend(record(CHUNK_INDEX, &about));
        self.chunks += 1;
        Ok(())
    }

    /// Writes the last chunk and the summary; returns the writer that was passed in.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(mut self) -> io::Result<W> {
        self.end_chunk()?;
        self.write(&record(DATA_END, &0u32.to_le_bytes()))?;
        let statistics = record(STATISTICS, &self.statistics());
        let [schemas, channels] = std::mem::take(&mut self.declared);
        let chunks = std::mem::take(&mut self.chunk_records);
        let summary_at = self.at;
        let mut offsets = Vec::new();
        let groups =
            [(SCHEMA, schemas), (CHANNEL, channels), (STATISTICS, statistics), (CHUNK_INDEX, chunks)];
        for (kind, records) in groups {
            if records.is_empty() {
                continue;
            }
            let mut content = vec![kind];
            content.extend(self.at.to_le_bytes());
            content.extend((records.len() as u64).to_le_bytes());
            offsets.extend(record(SUMMARY_OFFSET, &content));
            self.write(&records)?;
        }
        let mut footer = summary_at.to_le_bytes().to_vec();
        footer.extend(self.at.to_le_bytes());
        footer.extend(0u32.to_le_bytes()); // no checksum of the summary
        self.write(&offsets)?;
        self.write(&record(FOOTER, &footer))?;
        self.write(MAGIC)?;
        self.to.flush()?;
        Ok(self.to)
    }

    fn statistics(&self) -> Vec<u8> {
        let mut out = self.counts.iter().sum::<u64>().to_le_bytes().to_vec();
        out.extend((self.schemas.len() as u16).to_le_bytes());
        out.extend((self.counts.len() as u32).to_le_bytes());
        out.extend([0; 8]); // attachments, metadata
        out.extend(self.chunks.to_le_bytes());
        self.times.unwrap_or_default().into_iter().for_each(|t| out.extend(t.to_le_bytes()));
        out.extend((10 * self.counts.len() as u32).to_le_bytes());
        for (id, count) in self.counts.iter().enumerate() {
            out.extend((id as u16).to_le_bytes());
            out.extend(count.to_le_bytes());
        }
        out
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.to.write_all(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }
}

fn record(kind: u8, content: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(content.len() + 9);
    out.push(kind);
    out.extend((content.len() as u64).to_le_bytes());
    out.extend_from_slice(content);
    out
}

fn text(to: &mut Vec<u8>, text: &str) {
    to.extend((text.len() as u32).to_le_bytes());
    to.extend_from_slice(text.as_bytes());
}
