//! Messages in a pipe: each with its length (32 bits, little-endian) in front. Beside those of the page there are two, which the
//! page gets as text: what is shown, and where the walker is.

use crate::vector::V3;
use std::io::{self, Read, Write};

/// Kinds of the messages that are not those of the page.
pub(crate) const BEGIN: u8 = 100;
pub(crate) const WALKER: u8 = 101;
/// A message is no longer than this: a map that has more to show does not fit a window.
const LONGEST: u32 = 1 << 30;

/// The first message: what is shown, and whether its lengths are metres.
pub fn begin(title: &str, is_metric: bool) -> Vec<u8> {
    [&[BEGIN, u8::from(is_metric)], title.as_bytes()].concat()
}

/// Where the walker is: position, then the axes right, down and forward of the camera; `None` where that is not known.
pub fn walker(camera: Option<[V3; 4]>) -> Vec<u8> {
    let mut out = vec![WALKER];
    out.extend(camera.iter().flatten().flatten().flat_map(|v| v.to_le_bytes()));
    out
}

/// Writes a message.
///
/// # Errors
/// What the pipe says; a message that is too long.
pub fn write_message(to: &mut impl Write, message: &[u8]) -> io::Result<()> {
    let length = u32::try_from(message.len()).ok().filter(|n| *n <= LONGEST);
    let length =
        length.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "there is too much to show"))?;
    to.write_all(&length.to_le_bytes())?;
    to.write_all(message)
}

/// Reads the next message; `None` at the end.
///
/// # Errors
/// What the pipe says, one that ends within a message, a length that none has.
pub fn read_message(from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    let mut first = from.take(1);
    if first.read(&mut length[..1])? == 0 {
        return Ok(None);
    }
    from.read_exact(&mut length[1..])?;
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "this is no map to be shown"));
    }
    let mut message = Vec::new();
    // As much as there is, not as much as it says.
    if from.take(length.into()).read_to_end(&mut message)? < length as usize {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(Some(message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_out_as_they_went_in_and_a_cut_pipe_is_an_error() {
        let mut pipe = Vec::new();
        write_message(&mut pipe, &begin("a walk", true)).unwrap();
        write_message(&mut pipe, &[]).unwrap();
        let mut from = &pipe[..];
        assert_eq!(read_message(&mut from).unwrap().unwrap(), b"\x64\x01a walk");
        assert_eq!(
            (read_message(&mut from).unwrap(), read_message(&mut from).unwrap()),
            (Some(vec![]), None)
        );
        assert!(read_message(&mut &pipe[..3]).is_err() && read_message(&mut &pipe[..8]).is_err());
        assert!(read_message(&mut &[255; 9][..]).is_err(), "a length that none has");
    }
}
