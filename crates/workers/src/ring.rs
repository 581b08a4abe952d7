//! Frames in memory that processes share: a ring of slots in a file under `/dev/shm`.
//!
//! One process writes, any number read, none waits for another. Frame `n` lies in slot `n % slots` until frame
//! `n + slots` takes its place: the number is the generation under which a reader borrows the slot. What is read is
//! whole or it is not given out: the writer marks the slot before it writes and again afterwards, a checksum covers the
//! pixels, and the reader looks at the mark a second time. So it knows that it was overtaken, or that the writer was
//! killed in between.
//!
//! The file is read and written by position (`pread`, `pwrite`), not mapped. A reader needs a copy of its own anyway, since
//! an image outlives its slot; without a mapping there is no `unsafe`, a full `/dev/shm` is an error and not the signal
//! SIGBUS, and so is a file that somebody cut off.
//!
//! ```text
//! header, 4096 bytes: magic 8 | version u32 | slots u32 | slot bytes u64 | crc32 of these 24 bytes u32
//! slots, each:        mark, 64 bytes: number u64 | bytes u64 | crc32 of the bytes u32 | crc32 of these 20 bytes u32
//!                     the bytes
//! ```

use crc32fast::Hasher;
use std::fs::File;
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Format version; another release that changes the layout gets another number.
pub const VERSION: u32 = 1;

const MAGIC: [u8; 8] = *b"\x8ccrn\r\n\x1ar";
const HEADER: u64 = 4096;
const MARK: u64 = 64;
/// In the number of a mark: the slot is being written.
const WRITING: u64 = 1 << 63;

/// Why shared frames cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// A file operation failed.
    #[error("{}: {doing}: {source}", path.display())]
    Io {
        /// The file of the ring.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// There is too little room.
    #[error(
        "{}: {free_mb} MB are free, the shared frames need {need_mb} MB",
        folder.display()
    )]
    Full {
        /// The folder.
        folder: PathBuf,
        /// Free there, in MB of 10^6 bytes.
        free_mb: u64,
        /// Needed, in MB of 10^6 bytes.
        need_mb: u64,
    },
    /// Another program's file.
    #[error("{}: these are no shared frames: {why}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is there instead.
        why: String,
    },
    /// Another release's file.
    #[error(
        "{}: shared frames of version {found}, this program has version {VERSION}: another release left them, remove the file",
        path.display()
    )]
    Version {
        /// The version of the file.
        found: u32,
        /// The file.
        path: PathBuf,
    },
    /// The frame does not fit.
    #[error(
        "a frame of {bytes} bytes does not fit a slot of {slot_bytes}: the images are larger than the rig says"
    )]
    TooLarge {
        /// Bytes of the frame.
        bytes: u64,
        /// Bytes of a slot.
        slot_bytes: u64,
    },
}

/// What a reader found where a frame should be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Borrowed<T> {
    /// The frame, whole.
    Whole(T),
    /// The writer has come round: the slot has this frame by now, or is getting it.
    Overtaken {
        /// The later frame.
        by: u64,
    },
    /// The writer has not finished it; if it is gone, it never will.
    Unwritten,
    /// The bytes are not those that were written: the writer was killed in between, or the file was damaged.
    Torn,
}

/// A ring of frames.
#[derive(Debug)]
pub struct Ring {
    file: File,
    path: PathBuf,
    slots: u64,
    slot_bytes: u64,
}

/// The mark of a slot.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Mark {
    number: u64,
    bytes: u64,
    crc: u32,
}

impl Ring {
    /// A new ring; its memory is taken now, so that no frame fails for want of room later.
    ///
    /// # Errors
    /// [`RingError`] when there is too little room or the file cannot be made.
    pub fn create(path: &Path, slots: u32, slot_bytes: u64) -> Result<Self, RingError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let need = HEADER + u64::from(slots.max(1)).saturating_mul(MARK.saturating_add(slot_bytes));
        let full = |free: u64| RingError::Full {
            folder: folder.to_owned(),
            free_mb: free / 1_000_000,
            need_mb: need.div_ceil(1_000_000),
        };
        let free = free_bytes(folder).map_err(failed(folder, "ask for its free room"))?;
        if need > free {
            return Err(full(free));
        }
        // Under another name until it is whole: a process that is killed here leaves no half of a ring.
        let unfinished = path.with_extension("new");
        let mut options = File::options();
        let file = options.read(true).write(true).create(true).truncate(true).mode(0o600).open(&unfinished);
        let file = file.map_err(failed(path, "create"))?;
        let ring = Self { file, path: path.to_owned(), slots: u64::from(slots.max(1)), slot_bytes };
        ring.take_memory(need).map_err(|e| match e.kind() {
            io::ErrorKind::StorageFull => full(free_bytes(folder).unwrap_or(0)),
            _ => failed(path, "write")(e),
        })?;
        ring.file.write_all_at(&ring.header(), 0).map_err(failed(path, "write"))?;
        std::fs::rename(&unfinished, path).map_err(failed(path, "name"))?;
        Ok(ring)
    }

    /// A ring that another process has made.
    ///
    /// # Errors
    /// [`RingError`] when it cannot be opened, is none, or is of another release.
    pub fn open(path: &Path) -> Result<Self, RingError> {
        let file = File::options().read(true).write(true).open(path).map_err(failed(path, "open"))?;
        let foreign = |why: &str| RingError::Foreign { path: path.to_owned(), why: why.to_owned() };
        let length = file.metadata().map_err(failed(path, "read"))?.len();
        let mut header = [0; 28];
        file.read_exact_at(&mut header, 0).map_err(|_| foreign("it is too short"))?;
        let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| header[at + i]));
        if header[..8] != MAGIC {
            return Err(foreign("it begins with other bytes"));
        }
        if u32_at(8) != VERSION {
            return Err(RingError::Version { found: u32_at(8), path: path.to_owned() });
        }
        if crc32fast::hash(&header[..24]) != u32_at(24) {
            return Err(foreign("the checksum of its header is wrong"));
        }
        let slots = u64::from(u32_at(12));
        let slot_bytes = u64::from_le_bytes(std::array::from_fn(|i| header[16 + i]));
        let whole = slots.checked_mul(MARK + slot_bytes).and_then(|b| b.checked_add(HEADER));
        if slots == 0 || whole != Some(length) {
            return Err(foreign(&format!(
                "it has {length} bytes, not those of {slots} slots of {slot_bytes}"
            )));
        }
        Ok(Self { file, path: path.to_owned(), slots, slot_bytes })
    }

    /// How many frames are kept.
    pub fn slots(&self) -> u64 {
        self.slots
    }

    /// Bytes of a frame, at most.
    pub fn slot_bytes(&self) -> u64 {
        self.slot_bytes
    }

    /// Writes a frame, whose bytes are given in pieces. Only one process writes at a time.
    ///
    /// # Errors
    /// [`RingError`] when it does not fit or cannot be written.
    pub fn write(&self, number: u64, pieces: &[&[u8]]) -> Result<(), RingError> {
        let bytes = pieces.iter().map(|p| p.len() as u64).sum();
        if bytes > self.slot_bytes {
            return Err(RingError::TooLarge { bytes, slot_bytes: self.slot_bytes });
        }
        let at = self.place(number);
        let write = |bytes: &[u8], at| self.file.write_all_at(bytes, at).map_err(failed(&self.path, "write"));
        write(&Mark { number: number | WRITING, bytes: 0, crc: 0 }.bytes(), at)?;
        let (mut hasher, mut to) = (Hasher::new(), at + MARK);
        for piece in pieces {
            write(piece, to)?;
            hasher.update(piece);
            to += piece.len() as u64;
        }
        write(&Mark { number, bytes, crc: hasher.finalize() }.bytes(), at)
    }

    /// Reads a frame into a buffer that is used again.
    ///
    /// # Errors
    /// [`RingError::Io`] when the file cannot be read.
    pub fn read(&self, number: u64, into: &mut Vec<u8>) -> Result<Borrowed<()>, RingError> {
        let at = self.place(number);
        let Some(before) = self.mark(at)? else { return Ok(Borrowed::Torn) };
        match before.number & !WRITING {
            found if found > number => return Ok(Borrowed::Overtaken { by: found }),
            found if found < number || before.number & WRITING != 0 => return Ok(Borrowed::Unwritten),
            _ => {}
        }
        // Not trusted before it is compared with the slot.
        let Some(bytes) = usize::try_from(before.bytes).ok().filter(|b| *b as u64 <= self.slot_bytes) else {
            return Ok(Borrowed::Torn);
        };
        into.resize(bytes, 0);
        self.file.read_exact_at(into, at + MARK).map_err(failed(&self.path, "read"))?;
        let whole = crc32fast::hash(into) == before.crc;
        match self.mark(at)? {
            Some(after) if after == before && whole => Ok(Borrowed::Whole(())),
            Some(after) if after.number & !WRITING > number => {
                Ok(Borrowed::Overtaken { by: after.number & !WRITING })
            }
            _ => Ok(Borrowed::Torn),
        }
    }

    fn place(&self, number: u64) -> u64 {
        HEADER + (number % self.slots) * (MARK + self.slot_bytes)
    }

    /// The mark of a slot; `None` while it is being changed.
    fn mark(&self, at: u64) -> Result<Option<Mark>, RingError> {
        let mut bytes = [0; 24];
        self.file.read_exact_at(&mut bytes, at).map_err(failed(&self.path, "read"))?;
        let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let mark = Mark { number: u64_at(0), bytes: u64_at(8), crc: u32_at(16) };
        // A slot that was never written is all zero: frame 0, unwritten.
        if bytes == [0; 24] {
            return Ok(Some(Mark { number: WRITING, ..mark }));
        }
        Ok((crc32fast::hash(&bytes[..20]) == u32_at(20)).then_some(mark))
    }

    fn header(&self) -> [u8; 28] {
        let mut header = [0; 28];
        header[..8].copy_from_slice(&MAGIC);
        header[8..12].copy_from_slice(&VERSION.to_le_bytes());
        header[12..16].copy_from_slice(&(self.slots as u32).to_le_bytes());
        header[16..24].copy_from_slice(&self.slot_bytes.to_le_bytes());
        let crc = crc32fast::hash(&header[..24]);
        header[24..].copy_from_slice(&crc.to_le_bytes());
        header
    }

    /// Writes zeros all over.
    fn take_memory(&self, bytes: u64) -> io::Result<()> {
        let zeros = vec![0; 1 << 20];
        let mut at = 0;
        while at < bytes {
            let piece = (bytes - at).min(zeros.len() as u64);
            self.file.write_all_at(&zeros[..piece as usize], at)?;
            at += piece;
        }
        Ok(())
    }
}

impl Mark {
    fn bytes(&self) -> [u8; 24] {
        let mut bytes = [0; 24];
        bytes[..8].copy_from_slice(&self.number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.bytes.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.crc.to_le_bytes());
        let crc = crc32fast::hash(&bytes[..20]);
        bytes[20..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }
}

/// Bytes that are free for this user in a folder.
///
/// # Errors
/// The system's, as when there is no such folder.
pub fn free_bytes(folder: &Path) -> io::Result<u64> {
    let system = rustix::fs::statvfs(folder)?;
    Ok(system.f_bavail.saturating_mul(system.f_frsize))
}

fn failed(path: &Path, doing: &'static str) -> impl Fn(io::Error) -> RingError {
    let path = path.to_owned();
    move |source| RingError::Io { path: path.clone(), doing, source }
}
