#![doc = include_str!("../README.md")]

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

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

/// The text of a regular file of at most `most` bytes.
///
/// # Errors
/// As [`open`]; [`ErrorKind::InvalidData`] where it is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(read(path, most)?).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        io::Error::new(ErrorKind::InvalidData, format!("it is not text (byte {at} is not UTF-8)"))
    })
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
