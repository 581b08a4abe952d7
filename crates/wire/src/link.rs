//! Messages on a TCP stream: a length (4 bytes, little-endian), then as many bytes.

use cairn_team::peer::MAX_PEER_MESSAGE_BYTES;
use std::io::{self, Read, Write};

pub(crate) fn write(out: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
    let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(bytes)
}

/// The next message; `None` at the end of the stream.
pub(crate) fn read(from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    match from.read_exact(&mut length) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        read => read?,
    }
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_PEER_MESSAGE_BYTES {
        return Err(io::Error::other(format!("it announces a message of {length} bytes")));
    }
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes)?;
    Ok(Some(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_what_is_too_long_or_cut_off_is_an_error() {
        let mut bytes = Vec::new();
        write(&mut bytes, b"abc").unwrap();
        write(&mut bytes, b"").unwrap();
        let mut from = &bytes[..];
        assert_eq!(read(&mut from).unwrap().unwrap(), b"abc");
        assert_eq!(read(&mut from).unwrap().unwrap(), b"");
        assert!(read(&mut from).unwrap().is_none());
        assert!(read(&mut &bytes[..5]).is_err());
        assert!(read(&mut &[255; 8][..]).unwrap_err().to_string().contains("announces a message"));
    }
}
