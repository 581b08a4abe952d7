//! A bag of any format: read once from front to back to build its index, then message by message.

use crate::area::{Area, InputFile};
use crate::compression::{Compression, MAX_CHUNK, ZSTD_MAGIC, decompress, zstd_head};
use crate::error::{BagError, Damage};
use crate::index::{ChunkAt, Entry, Index, PREFIX, Place, Topic, clamped};
use crate::sqlite::Database;
use crate::{mcap, rosbag1, rosbag2, sqlite};
use std::collections::VecDeque;
use std::path::Path;

/// Greatest number of decompressed chunks in the cache.
const KEPT_CHUNKS: usize = 8;
/// Greatest number of bytes of all cached chunks together, unless a single one is larger.
const KEPT_BYTES: usize = 128 << 20;

/// One file of a bag.
enum Storage {
    /// rosbag1 or MCAP: messages are in the file itself or in chunks.
    Flat(InputFile),
    /// SQLite.
    Rows(Database),
}

/// A bag with the index of its messages.
pub struct Bag {
    files: Vec<Storage>,
    topics: Vec<Topic>,
    chunks: Vec<ChunkAt>,
    notes: Vec<String>,
    /// Whether the metadata states that each message is compressed.
    has_zstd_messages: bool,
    /// Cached decompressed chunks by number, the newest last.
    kept: VecDeque<(u32, Vec<u8>)>,
}

/// Whether a path looks like a bag: a file with extension `.bag`, `.bag.active`, `.mcap` or `.db3`, a file that begins
/// like one, or the folder of a rosbag2 recording.
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return rosbag2::is(path);
    }
    let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    path.is_file()
        && ([".bag", ".bag.active", ".mcap", ".db3"].iter().any(|end| name.ends_with(end))
            || InputFile::open(path).is_ok_and(|mut file| kind(&mut file).is_some()))
}

#[derive(Clone, Copy)]
enum Kind {
    Rosbag1,
    Mcap,
    Sqlite,
}

fn kind(file: &mut InputFile) -> Option<Kind> {
    let kinds = [(rosbag1::MAGIC, Kind::Rosbag1), (mcap::MAGIC, Kind::Mcap), (sqlite::MAGIC, Kind::Sqlite)];
    kinds
        .into_iter()
        .find(|(magic, _)| file.get(0, magic.len() as u64).is_ok_and(|b| b == *magic))
        .map(|k| k.1)
}

impl Bag {
    /// Opens a `.bag`, `.mcap` or `.db3` file or the folder of a rosbag2 recording, and indexes its messages. `wanted`
    /// (topic, type such as `sensor_msgs/Image`) returns the greatest number of messages to index for a topic. All
    /// files are read through once.
    ///
    /// # Errors
    /// When a file cannot be read or has an unknown format. Damage is not an error: everything before it is indexed,
    /// and [`Bag::notes`] reports how far that is.
    pub fn open(path: &Path, wanted: &dyn Fn(&str, &str) -> usize) -> Result<Self, BagError> {
        let mut index = Index::new(wanted);
        let mut has_zstd_messages = false;
        let paths = if path.is_dir() {
            let folder = rosbag2::folder(path)?;
            has_zstd_messages = folder.has_zstd_messages;
            index.notes.extend(folder.notes);
            folder.files
        } else {
            vec![path.to_owned()]
        };
        let mut files = Vec::new();
        for path in &paths {
            let number = u16::try_from(files.len()).map_err(|_| BagError::Unsupported {
                path: path.display().to_string(),
                why: "more than 65535 files in one recording".into(),
                cure: "give a part of them".into(),
            })?;
            files.push(scan(path, number, &mut index)?);
        }
        let is_compressed = has_zstd_messages || index.has_zstd_messages;
        let (topics, chunks, notes) = index.finish();
        let mut bag = Self { files, topics, chunks, notes, has_zstd_messages, kept: VecDeque::new() };
        if is_compressed {
            bag.stamp_compressed();
        }
        Ok(bag)
    }

    /// If single messages are compressed, their stamps are inside; messages that cannot be decompressed are left out.
    fn stamp_compressed(&mut self) {
        let mut topics = std::mem::take(&mut self.topics);
        for topic in topics.iter_mut().filter(|topic| topic.has_header) {
            let (before, format) = (topic.entries.len(), topic.format);
            topic.entries.retain_mut(|entry| match self.head(entry) {
                Ok(bytes) => {
                    entry.stamp_ns = Topic::stamp_ns(true, format, entry.log_ns, &bytes);
                    true
                }
                Err(_) => false,
            });
            let lost = before - topic.entries.len();
            if lost > 0 {
                self.notes.push(format!("{}: {lost} messages cannot be unpacked, left out", topic.name));
            }
        }
        self.topics = topics;
    }

    /// The topics in the order of their declaration.
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Gives the messages of a topic other stamps, in nanoseconds: `stamp_of` maps each entry to its own, and entries without
    /// one are left out.
    pub fn restamp(&mut self, topic: usize, mut stamp_of: impl FnMut(&Entry) -> Option<i64>) {
        let Some(topic) = self.topics.get_mut(topic) else { return };
        topic.entries.retain_mut(|entry| match stamp_of(entry) {
            Some(stamp_ns) => {
                entry.stamp_ns = clamped(stamp_ns);
                true
            }
            None => false,
        });
    }

    /// Problems of the bag, one sentence each: where it is damaged and how far it was read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The bytes of a message.
    ///
    /// # Errors
    /// When they can no longer be read, or a compressed message is damaged.
    pub fn read(&mut self, entry: &Entry) -> Result<Vec<u8>, BagError> {
        let (bytes, is_zstd) = self.stored(entry)?;
        match is_zstd {
            true => unpacked(decompress(Compression::Zstd, &bytes, MAX_CHUNK), entry),
            false => Ok(bytes),
        }
    }

    /// The first bytes of a message, or all of it.
    fn head(&mut self, entry: &Entry) -> Result<Vec<u8>, BagError> {
        let (bytes, is_zstd) = self.stored(entry)?;
        if is_zstd { unpacked(zstd_head(&bytes, PREFIX), entry) } else { Ok(bytes) }
    }

    /// The bytes of a message as they are stored, and whether they are a Zstandard frame of their own.
    fn stored(&mut self, entry: &Entry) -> Result<(Vec<u8>, bool), BagError> {
        let place = entry.place;
        let Some(storage) = self.files.get_mut(usize::from(place.file)) else {
            return Err(BagError::Damaged {
                path: "bag".into(),
                at: 0,
                why: "an entry of another bag".into(),
            });
        };
        match storage {
            Storage::Rows(database) => {
                let bytes = rosbag2::read(database, &place).map_err(|d| database.file.damaged(d))?;
                // The RealSense SDK compresses messages without stating it. CDR begins with a zero byte.
                let is_zstd = self.has_zstd_messages || bytes.starts_with(&ZSTD_MAGIC);
                Ok((bytes, is_zstd))
            }
            Storage::Flat(file) if place.chunk == Place::PLAIN => {
                let bytes = file.read(place.offset, u64::from(place.length)).map_err(|d| file.damaged(d))?;
                Ok((bytes, self.has_zstd_messages))
            }
            Storage::Flat(file) => {
                let found = in_chunk(file, &self.chunks, &mut self.kept, &place);
                Ok((found.map_err(|d| file.damaged(d))?, self.has_zstd_messages))
            }
        }
    }
}

/// A message that was compressed by itself, if all of it could be decompressed.
fn unpacked((bytes, why): (Vec<u8>, Option<String>), entry: &Entry) -> Result<Vec<u8>, BagError> {
    let path = "a compressed message".to_owned();
    why.map_or(Ok(bytes), |why| Err(BagError::Damaged { path, at: entry.place.offset, why }))
}

/// A copy of a message in a compressed chunk.
fn in_chunk(
    file: &mut InputFile,
    chunks: &[ChunkAt],
    kept: &mut VecDeque<(u32, Vec<u8>)>,
    place: &Place,
) -> Result<Vec<u8>, Damage> {
    match kept.iter().position(|(number, _)| *number == place.chunk) {
        Some(at) => {
            let chunk = kept.remove(at);
            kept.extend(chunk);
        }
        None => {
            let at = chunks.get(place.chunk as usize);
            let at = at.ok_or_else(|| Damage::new(place.offset, "an entry of another bag"))?;
            let (bytes, _) = at.unpack(file)?;
            while !kept.is_empty()
                && (kept.len() >= KEPT_CHUNKS
                    || kept.iter().map(|(_, b)| b.len()).sum::<usize>() + bytes.len() > KEPT_BYTES)
            {
                kept.pop_front();
            }
            kept.push_back((place.chunk, bytes));
        }
    }
    let bytes = kept.back().map_or(&[][..], |(_, bytes)| bytes);
    let end = place.offset as usize + place.length as usize;
    let found = bytes.get(place.offset as usize..end);
    found
        .map(<[u8]>::to_vec)
        .ok_or_else(|| Damage::new(place.offset, "the file has changed while it was read"))
}

fn scan(path: &Path, number: u16, index: &mut Index) -> Result<Storage, BagError> {
    let mut file = InputFile::open(path)?;
    match kind(&mut file) {
        Some(Kind::Rosbag1) => rosbag1::scan(&mut file, number, index).map(|()| Storage::Flat(file)),
        Some(Kind::Mcap) => mcap::scan(&mut file, number, index).map(|()| Storage::Flat(file)),
        Some(Kind::Sqlite) => {
            let mut wal = path.as_os_str().to_owned();
            wal.push("-wal");
            if std::fs::metadata(&wal).is_ok_and(|about| about.len() > 0) {
                index.notes.push(format!(
                    "{}: the last messages are still in the journal beside it and are not read; \
                     sqlite3 FILE 'pragma wal_checkpoint' adds them",
                    path.display()
                ));
            }
            let mut database = Database::open(file)?;
            rosbag2::scan(&mut database, number, index).map(|()| Storage::Rows(database))
        }
        None => {
            let old = file.get(0, 8).is_ok_and(|b| b == b"#ROSBAG ");
            let (why, cure) = match (old, file.end()) {
                (_, 0) => ("is empty", "record it again"),
                (true, _) => ("is a bag of an old version", "convert it with rosbag migrate"),
                _ => (
                    "is neither rosbag1 (#ROSBAG V2.0), MCAP nor SQLite",
                    "give a .bag, .mcap or .db3 file, or the folder of a rosbag2 recording",
                ),
            };
            Err(BagError::Unsupported {
                path: path.display().to_string(),
                why: why.into(),
                cure: cure.into(),
            })
        }
    }
}
