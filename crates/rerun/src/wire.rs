//! Messages as bytes in a pipe: the version once, then the length of each message and its form in postcard.

use crate::Message;
use std::io::{self, Read, Write};

/// The version of the messages; both ends of a pipe must have the same.
pub const VERSION: u32 = 1;

/// No message is longer: a gray image of 64 megapixels.
const LONGEST: usize = 64 << 20;

/// Why a message was not read or written.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The pipe failed, or ended within a message.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The other end has another version.
    #[error("messages of version {0} instead of {VERSION}: cairn and cairn-rerun must be of one release")]
    Version(u32),
    /// A message is longer than any can be.
    #[error("a message of {0} bytes is longer than {LONGEST}")]
    Long(usize),
    /// The bytes are no message.
    #[error("no message: {0}")]
    Malformed(#[from] postcard::Error),
}

/// Writes a message; before [`Message::Begin`] also the version.
///
/// # Errors
/// [`WireError`] when the pipe fails or the message is too long.
pub fn write(to: &mut impl Write, message: &Message) -> Result<(), WireError> {
    if matches!(message, Message::Begin { .. }) {
        to.write_all(&VERSION.to_le_bytes())?;
    }
    let bytes = postcard::to_stdvec(message)?;
    let length = u32::try_from(bytes.len()).ok().filter(|_| bytes.len() <= LONGEST);
    let length = length.ok_or(WireError::Long(bytes.len()))?;
    to.write_all(&length.to_le_bytes())?;
    Ok(to.write_all(&bytes)?)
}

/// The messages in a pipe.
///
/// Reads the version first; `None` of the iterator is the end of the pipe between two messages.
///
/// # Errors
/// [`WireError`] when the pipe fails at once or has another version.
pub fn read<R: Read>(mut from: R) -> Result<impl Iterator<Item = Result<Message, WireError>>, WireError> {
    let mut four = [0; 4];
    from.read_exact(&mut four)?;
    match u32::from_le_bytes(four) {
        VERSION => Ok(std::iter::from_fn(move || next(&mut from).transpose())),
        other => Err(WireError::Version(other)),
    }
}

fn next(from: &mut impl Read) -> Result<Option<Message>, WireError> {
    let mut four = [0; 4];
    let mut filled = 0;
    while filled < four.len() {
        match from.read(&mut four[filled..]) {
            Ok(0) if filled == 0 => return Ok(None),
            Ok(0) => return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e.into()),
        }
    }
    let length = u32::from_le_bytes(four) as usize;
    if length > LONGEST {
        return Err(WireError::Long(length));
    }
    let mut bytes = vec![0; length];
    from.read_exact(&mut bytes)?;
    Ok(Some(postcard::from_bytes(&bytes)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Colour, Pose, Show};

    fn messages() -> Vec<Message> {
        let show = |what| Message::Show { entity: "map0/x".into(), what };
        let pose = Pose { translation: [1.0, 2.0, 3.0], xyzw: [0.0, 0.0, 0.0, 1.0], scale: 2.0 };
        vec![
            Message::Begin { name: "a walk".into() },
            Message::At { stamp_ns: -5, frame: 7 },
            show(Show::Pose(pose)),
            show(Show::Image { size: [2, 1], gray: vec![0, 255] }),
            show(Show::Lines(vec![vec![[0.5; 3]; 2], vec![]], Colour::RED)),
            Message::End,
        ]
    }

    fn bytes() -> Vec<u8> {
        let mut bytes = Vec::new();
        messages().iter().for_each(|m| write(&mut bytes, m).unwrap());
        bytes
    }

    #[test]
    fn messages_pass_unchanged() {
        let read: Vec<Message> = read(&bytes()[..]).unwrap().map(Result::unwrap).collect();
        assert_eq!(read, messages());
    }

    #[test]
    fn a_pipe_that_ends_anywhere_gives_whole_messages_then_an_error() {
        let bytes = bytes();
        let mut ends = 0;
        for length in 4..bytes.len() {
            let read: Vec<_> = read(&bytes[..length]).unwrap().take(10).collect();
            let whole = read.iter().take_while(|m| m.is_ok()).count();
            assert!(whole < messages().len());
            assert!(read.iter().flatten().eq(&messages()[..whole]));
            ends += usize::from(read.iter().all(Result::is_ok));
            assert!(read.len() <= whole + 10, "{length}");
        }
        // Only the ends between two messages look like ends.
        assert_eq!(ends, messages().len());
        assert!(matches!(super::read(&bytes[..3]).err(), Some(WireError::Io(_))));
    }

    #[test]
    fn another_version_and_lengths_that_cannot_be_are_refused() {
        let mut other = bytes();
        other[0] += 1;
        assert!(matches!(super::read(&other[..]).err(), Some(WireError::Version(2))));
        let mut long = bytes();
        long[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        let first = super::read(&long[..]).unwrap().next().unwrap();
        assert!(matches!(first, Err(WireError::Long(_))), "{first:?}");
    }
}
