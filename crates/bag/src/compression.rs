//! Compressed chunks: bzip2, LZ4 frames and Zstandard, decoded in bounded memory and up to the first damage.

use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Size of the largest chunk that is decompressed, bytes. Recorders write chunks of 0.75 to 4 MB.
pub(crate) const MAX_CHUNK: u64 = 512 << 20;

/// The first bytes of a Zstandard frame (RFC 8878, 3.1.1).
pub(crate) const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// A compression that is not read, by its name.
#[derive(Debug, thiserror::Error)]
#[error("compression \"{0}\" is unknown, known are none, bz2, lz4 and zstd")]
pub(crate) struct UnknownCompression(String);

/// How a chunk is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    /// Not compressed.
    None,
    /// bzip2.
    Bz2,
    /// An LZ4 frame.
    Lz4,
    /// A Zstandard frame.
    Zstd,
}

impl Compression {
    /// From its name in rosbag1 and MCAP files.
    pub fn named(name: &[u8]) -> Result<Self, UnknownCompression> {
        match name {
            b"" | b"none" => Ok(Self::None),
            b"bz2" => Ok(Self::Bz2),
            b"lz4" => Ok(Self::Lz4),
            b"zstd" => Ok(Self::Zstd),
            other => Err(UnknownCompression(String::from_utf8_lossy(other).into_owned())),
        }
    }
}

/// The decompressed bytes, at most `limit` of them, and what is wrong after them, if anything.
pub(crate) fn decompress(kind: Compression, bytes: &[u8], limit: u64) -> (Vec<u8>, Option<String>) {
    // The decoders are third-party code: if one panics on damaged data, its output until then is kept.
    let mut out = Vec::new();
    let ended = catch_unwind(AssertUnwindSafe(|| match kind {
        Compression::None => drain(bytes, limit, &mut out),
        Compression::Bz2 => drain(bzip2::read::BzDecoder::new(bytes), limit, &mut out),
        Compression::Lz4 => drain(lz4_flex::frame::FrameDecoder::new(bytes), limit, &mut out),
        Compression::Zstd => match ruzstd::decoding::StreamingDecoder::new(bytes) {
            Ok(decoder) => drain(decoder, limit, &mut out),
            Err(e) => Some(e.to_string()),
        },
    }));
    let why = ended.unwrap_or_else(|_| Some("the decoder failed".into()));
    (out, why.map(|why| format!("{kind:?} data: {why}")))
}

/// The first bytes of a Zstandard frame, at most `most` of them: no more of it is decompressed than their block.
pub(crate) fn zstd_head(bytes: &[u8], most: u64) -> (Vec<u8>, Option<String>) {
    let mut out = Vec::new();
    let ended = catch_unwind(AssertUnwindSafe(|| match ruzstd::decoding::StreamingDecoder::new(bytes) {
        Ok(decoder) => drain(decoder.take(most), most, &mut out),
        Err(e) => Some(e.to_string()),
    }));
    let why = ended.unwrap_or_else(|_| Some("the decoder failed".into()));
    (out, why)
}

/// Reads to the end; memory grows with the actual data, never by a stated size.
fn drain(mut from: impl Read, limit: u64, out: &mut Vec<u8>) -> Option<String> {
    let mut buffer = vec![0; 64 << 10];
    loop {
        match from.read(&mut buffer) {
            Ok(0) => return None,
            Ok(n) if (out.len() + n) as u64 > limit => {
                return Some(format!("holds more than the {limit} bytes that are stated"));
            }
            Ok(n) => out.extend_from_slice(&buffer[..n]),
            Err(e) => return Some(e.to_string()),
        }
    }
}
