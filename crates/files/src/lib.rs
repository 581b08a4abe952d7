#![doc = include_str!("../README.md")]

pub mod yaml;

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Memory for the dictionary of xz, which has 64 MiB at most, in KiB.
const XZ_KIB: u32 = 80 << 10;

/// Bytes in a mebibyte.
pub const MIB: u64 = 1 << 20;

/// Opens a regular file of at most `most` bytes, without reading from it.
///
/// # Errors
/// The system's error; [`ErrorKind::InvalidInput`] for a device, a pipe or a folder; [`ErrorKind::FileTooLarge`] for a
/// file that is larger.
pub fn open(path: &Path, most: u64) -> io::Result<File> {
    // Checked before opening: opening a pipe waits for its writer.
    check(&std::fs::metadata(path)?, most)?;
    let file = File::open(path)?;
    check(&file.metadata()?, most)?;
    Ok(file)
}

/// The content of a regular file of at most `most` bytes.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open(path, most)?;
    let length = file.metadata()?.len();
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    // The file may grow while it is read.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(too_large(bytes.len() as u64, most));
    }
    Ok(bytes)
}

/// The text of a regular file of at most `most` bytes: UTF-8, or UTF-16 with a byte order mark, which is left out; where it
/// is compressed by gzip, bzip2, xz or zstd, of at most as many bytes when decompressed.
///
/// # Errors
/// As [`open`]; [`ErrorKind::InvalidData`] where it is not text, or the compressed data is damaged.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let bytes = unpacked(read(path, most)?, most)?;
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        io::Error::new(ErrorKind::InvalidData, format!("it is not text (byte {at} is not UTF-8)"))
    })
}

/// As [`read_text`], but bytes that are not UTF-8 (comments of old editors) become replacement characters.
///
/// # Errors
/// As [`open`]; [`ErrorKind::InvalidData`] where compressed data is damaged.
pub fn read_text_lossy(path: &Path, most: u64) -> io::Result<String> {
    let bytes = unpacked(read(path, most)?, most)?;
    Ok(String::from_utf8(bytes).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned()))
}

/// A text's bytes decompressed, as UTF-8, and without the byte order mark.
fn unpacked(bytes: Vec<u8>, most: u64) -> io::Result<Vec<u8>> {
    // The decoders are third-party code, which may panic on damaged data.
    let unpack = || -> io::Result<Option<Vec<u8>>> {
        Ok(Some(match &bytes[..] {
            [0x1f, 0x8b, ..] => drained(flate2::read::MultiGzDecoder::new(&bytes[..]), most)?,
            [b'B', b'Z', b'h', b'1'..=b'9', ..] => {
                drained(bzip2::read::MultiBzDecoder::new(&bytes[..]), most)?
            }
            [0xfd, b'7', b'z', b'X', b'Z', 0, ..] => {
                drained(lzma_rust2::XzReader::new_mem_limit(&bytes[..], true, XZ_KIB), most)?
            }
            [0x28, 0xb5, 0x2f, 0xfd, ..] => zstd(&bytes, most)?,
            _ => return Ok(None),
        }))
    };
    let failed = |_| Err(io::Error::new(ErrorKind::InvalidData, "its compressed data is damaged"));
    let bytes = catch_unwind(AssertUnwindSafe(unpack)).unwrap_or_else(failed)?.unwrap_or(bytes);
    let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|two| unit([two[0], two[1]])).collect();
        let damaged = |_| io::Error::new(ErrorKind::InvalidData, "it begins as UTF-16, but is not");
        String::from_utf16(&units).map(String::into_bytes).map_err(damaged)
    };
    match &bytes[..] {
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(rest.to_vec()),
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ => Ok(bytes),
    }
}

/// All frames of zstd.
fn zstd(mut rest: &[u8], most: u64) -> io::Result<Vec<u8>> {
    let mut all = Vec::new();
    while !rest.is_empty() {
        let damaged = |e| io::Error::new(ErrorKind::InvalidData, format!("its zstd is damaged: {e}"));
        let decoder = ruzstd::decoding::StreamingDecoder::new(&mut rest).map_err(damaged)?;
        all.extend(drained(decoder, most - all.len() as u64)?);
    }
    Ok(all)
}

fn drained(from: impl Read, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let why = format!("decompressed it has more than {}, the most of a file of this kind", size(most));
        return Err(io::Error::new(ErrorKind::FileTooLarge, why));
    }
    Ok(bytes)
}

fn check(metadata: &Metadata, most: u64) -> io::Result<()> {
    if metadata.is_dir() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is a folder, not a file"));
    }
    if !metadata.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is a device or a pipe, not a file"));
    }
    if metadata.len() > most { Err(too_large(metadata.len(), most)) } else { Ok(()) }
}

fn too_large(bytes: u64, most: u64) -> io::Error {
    let why = format!("it has {}, a file of this kind at most {}", size(bytes), size(most));
    io::Error::new(ErrorKind::FileTooLarge, why)
}

/// A size for display, in decimal units.
fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} bytes"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn large_files_are_refused_without_reading_them() {
        let path = std::env::temp_dir().join(format!("cairn-files-large-{}", std::process::id()));
        // A sparse file: it takes no space on disk, but reading it would take 20 GB of memory.
        File::create(&path).unwrap().set_len(20_000_000_000).unwrap();
        let began = std::time::Instant::now();
        let error = read(&path, 256 * MIB).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
        assert_eq!(error.to_string(), "it has 20.0 GB, a file of this kind at most 268.4 MB");
        assert!(began.elapsed().as_millis() < 100);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn whole_content_or_an_error() {
        let path = std::env::temp_dir().join(format!("cairn-files-small-{}", std::process::id()));
        std::fs::write(&path, b"abc\xff").unwrap();
        assert_eq!(read(&path, 4).unwrap(), b"abc\xff");
        assert_eq!(read(&path, 3).unwrap_err().kind(), ErrorKind::FileTooLarge);
        assert!(read_text(&path, 4).unwrap_err().to_string().contains("byte 3 is not UTF-8"));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(read(&path, 4).unwrap_err().kind(), ErrorKind::NotFound);
        assert!(read(&std::env::temp_dir(), 4).unwrap_err().to_string().contains("a folder"));
    }

    #[test]
    fn text_is_the_same_however_it_is_stored() {
        let path = std::env::temp_dir().join(format!("cairn-files-stored-{}", std::process::id()));
        let text = "a: 1\nb: \u{b5}\n";
        let units = || text.encode_utf16();
        let gzip = |bytes: &[u8]| {
            let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        };
        let bzip2 = |bytes: &[u8]| {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::default());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        };
        let xz = |bytes: &[u8]| {
            let mut encoder =
                lzma_rust2::XzWriter::new(Vec::new(), lzma_rust2::XzOptions::default()).unwrap();
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        };
        let zstd = |bytes: &[u8]| {
            ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
        };
        let marked = [b"\xef\xbb\xbf", text.as_bytes()].concat();
        for stored in [
            text.as_bytes().to_vec(),
            marked.clone(),
            [vec![0xff, 0xfe], units().flat_map(u16::to_le_bytes).collect()].concat(),
            [vec![0xfe, 0xff], units().flat_map(u16::to_be_bytes).collect()].concat(),
            gzip(text.as_bytes()),
            gzip(&marked),
            bzip2(&marked),
            xz(&marked),
            [xz(&text.as_bytes()[..4]), xz(&text.as_bytes()[4..])].concat(),
            zstd(&marked),
            [zstd(&text.as_bytes()[..4]), zstd(&text.as_bytes()[4..])].concat(),
            [gzip(&text.as_bytes()[..4]), gzip(&text.as_bytes()[4..])].concat(),
        ] {
            std::fs::write(&path, &stored).unwrap();
            assert_eq!(read_text(&path, MIB).unwrap(), text, "{stored:?}");
            assert_eq!(read_text_lossy(&path, MIB).unwrap(), text);
        }
        // A small file that would fill the memory is refused.
        let long = vec![b'a'; 4 << 20];
        for bomb in [gzip(&long), bzip2(&long), xz(&long), zstd(&long)] {
            std::fs::write(&path, &bomb).unwrap();
            assert_eq!(read_text(&path, MIB).unwrap_err().kind(), ErrorKind::FileTooLarge);
            std::fs::write(&path, &bomb[..bomb.len() / 2]).unwrap();
            assert!(read_text(&path, 8 * MIB).is_err(), "cut in the middle");
        }
        std::fs::write(&path, b"caf\xe9").unwrap();
        assert!(read_text(&path, MIB).is_err());
        assert_eq!(read_text_lossy(&path, MIB).unwrap(), "caf\u{fffd}");
        std::fs::remove_file(&path).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn devices_and_pipes_are_refused_at_once() {
        let zero = read(Path::new("/dev/zero"), MIB).unwrap_err();
        assert!(zero.to_string().contains("a device or a pipe"), "{zero}");
        let path = std::env::temp_dir().join(format!("cairn-files-pipe-{}", std::process::id()));
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        // No process writes into it: opening it would wait forever.
        assert_eq!(open(&path, MIB).unwrap_err().kind(), ErrorKind::InvalidInput);
        std::fs::remove_file(&path).unwrap();
    }
}
