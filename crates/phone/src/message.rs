//! What a page sends, as bytes: the same bytes replay a walk here and in a browser.
//!
//! A message is a kind (one letter), the length of its content (u32), and the content; numbers are little-endian. `S`: a setup, JSON.
//! `M`: readings of the motion sensors, seven f64 each (seconds, rad/s, m/s^2). `I`: an image, f64 seconds and its gray bytes. `T`: f64
//! seconds, time without an image. `C`: a command, UTF-8. `W`: a slice of mapping, to be asked for
//! again while the answer says `busy` and nothing else waits. `L`: one byte, whether words reach the walker late. `Q`: what is to be shown.
//! `V`: the map, in full where its one byte is 1, else what has changed. `R`: the routes of a library, JSON, before a setup. `E`: the end.

use crate::phone::{Phone, PhoneError};
use crate::report::Report;
use crate::setup::{Library, Setup};
use crate::shown::Shown;
use cairn_phrases::UnknownLanguage;
use cairn_session::RouteListed;
use serde::Serialize;
use std::io::{self, Read, Write};

/// Longest content that is taken, bytes: an image of 16 megapixels.
const LONGEST: u32 = 1 << 24;
/// Bytes of a reading of the motion sensors.
const READING: usize = 7 * 8;

/// A message: its kind and its content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Which it is.
    pub kind: u8,
    /// What it holds.
    pub content: Vec<u8>,
}

impl Message {
    /// A setup.
    ///
    /// # Errors
    /// None for a setup that came from JSON.
    pub fn setup(setup: &Setup) -> Result<Self, serde_json::Error> {
        Ok(Self { kind: b'S', content: serde_json::to_vec(setup)? })
    }

    /// An image.
    pub fn image(t_s: f64, gray: &[u8]) -> Self {
        Self { kind: b'I', content: [&t_s.to_le_bytes()[..], gray].concat() }
    }

    /// A slice of mapping.
    pub fn work() -> Self {
        Self { kind: b'W', content: Vec::new() }
    }

    /// Readings of the motion sensors.
    pub fn motion(readings: &[[f64; 7]]) -> Self {
        Self { kind: b'M', content: readings.iter().flatten().flat_map(|v| v.to_le_bytes()).collect() }
    }

    /// A command.
    pub fn command(line: &str) -> Self {
        Self { kind: b'C', content: line.into() }
    }
}

/// Why a message is none, or what it asks for cannot be done.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// A kind that does not exist.
    #[error("a message of kind {0}; there are S, M, I, W, T, C, L, Q, V, R and E")]
    Kind(u8),
    /// Content that is too short or too long for its kind.
    #[error("{0} bytes are no content of a message of kind {1}")]
    Length(usize, char),
    /// A setup that cannot be read.
    #[error("the setup cannot be read: {0}")]
    Setup(#[from] serde_json::Error),
    /// A language that is not there.
    #[error(transparent)]
    Language(#[from] UnknownLanguage),
    /// Anything before the setup.
    #[error("the first message is the setup")]
    NoSetup,
    /// What the phone answers.
    #[error(transparent)]
    Phone(#[from] PhoneError),
}

/// What came of a message.
#[derive(Debug, Default, Serialize)]
pub struct Answer {
    /// Of images and words.
    pub reports: Vec<Report>,
    /// What a command did.
    pub done: Option<String>,
    /// Whether mapping has more to do.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub busy: bool,
    /// Why the message was left out.
    pub error: Option<String>,
    /// What is to be shown, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shown: Option<Shown>,
    /// The routes of a library, where these were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub routes: Option<Vec<RouteListed>>,
    /// The map, where that was asked for.
    #[serde(skip)]
    pub map: Vec<u8>,
}

/// Carries out a message; a setup begins a walk anew.
pub fn apply(phone: &mut Option<Phone>, kind: u8, content: &[u8]) -> Answer {
    match try_apply(phone, kind, content) {
        Ok(answer) => answer,
        Err(why) => Answer { error: Some(why.to_string()), ..Answer::default() },
    }
}

fn try_apply(phone: &mut Option<Phone>, kind: u8, content: &[u8]) -> Result<Answer, MessageError> {
    let mut answer = Answer::default();
    if kind == b'R' {
        answer.routes = Some(serde_json::from_slice::<Library>(content)?.routes()?);
        return Ok(answer);
    }
    if kind == b'S' {
        // The walk before ends first: a folder has one writer.
        *phone = None;
        *phone = Some(Phone::new(&serde_json::from_slice::<Setup>(content)?)?);
        return Ok(answer);
    }
    let phone = phone.as_mut().ok_or(MessageError::NoSetup)?;
    match kind {
        b'M' => {
            let mut refused = None;
            for reading in readings(content)? {
                let [t, gx, gy, gz, ax, ay, az] = reading;
                refused = phone.motion(t, [gx, gy, gz], [ax, ay, az]).err().or(refused);
            }
            answer.reports = phone.step();
            answer.error = refused.map(|why| why.to_string());
        }
        b'I' => {
            let (t_s, gray) = time(kind, content)?;
            phone.image(t_s, gray)?;
            answer.reports = phone.step();
        }
        b'W' => answer.busy = phone.work(),
        b'T' => answer.reports = phone.tick(time(kind, content)?.0)?,
        b'C' => answer.done = Some(phone.command(&String::from_utf8_lossy(content))?),
        b'L' => phone.late(flag(kind, content)?),
        b'Q' => answer.shown = Some(phone.shown()),
        b'V' => answer.map = phone.map(flag(kind, content)?),
        b'E' => phone.close()?,
        other => return Err(MessageError::Kind(other)),
    }
    Ok(answer)
}

fn readings(content: &[u8]) -> Result<impl Iterator<Item = [f64; 7]> + '_, MessageError> {
    let (readings, rest) = content.as_chunks::<READING>();
    if !rest.is_empty() {
        return Err(MessageError::Length(content.len(), 'M'));
    }
    Ok(readings.iter().map(|reading| {
        let (numbers, _) = reading.as_chunks::<8>();
        std::array::from_fn(|i| f64::from_le_bytes(numbers[i]))
    }))
}

fn flag(kind: u8, content: &[u8]) -> Result<bool, MessageError> {
    match content {
        [byte] => Ok(*byte == 1),
        _ => Err(MessageError::Length(content.len(), kind.into())),
    }
}

fn time(kind: u8, content: &[u8]) -> Result<(f64, &[u8]), MessageError> {
    let (t_s, rest) = content.split_first_chunk().ok_or(MessageError::Length(content.len(), kind.into()))?;
    Ok((f64::from_le_bytes(*t_s), rest))
}

/// Writes a message.
///
/// # Errors
/// As `to`.
pub fn write(to: &mut impl Write, message: &Message) -> io::Result<()> {
    to.write_all(&[message.kind])?;
    to.write_all(&(message.content.len() as u32).to_le_bytes())?;
    to.write_all(&message.content)
}

/// The next message; `None` at the end.
///
/// # Errors
/// As `from`; a message that was cut off or is too long.
pub fn read(from: &mut impl Read) -> io::Result<Option<Message>> {
    let mut head = [0; 5];
    if from.read(&mut head[..1])? == 0 {
        return Ok(None);
    }
    from.read_exact(&mut head[1..])?;
    let [kind, length @ ..] = head;
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Err(io::Error::new(io::ErrorKind::InvalidData, format!("a message of {length} bytes")));
    }
    let mut content = vec![0; length as usize];
    from.read_exact(&mut content)?;
    Ok(Some(Message { kind, content }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In a folder of its own.
    fn setup(name: &str) -> Setup {
        let folder = std::env::temp_dir().join(format!("cairn-phone-{}-{name}", std::process::id()));
        Setup {
            width: 64,
            height: 48,
            rate_hz: 15.0,
            pinhole: None,
            distortion: None,
            motion: true,
            phone: None,
            library: Library { folder, ..Library::default() },
        }
    }

    #[test]
    fn messages_are_read_as_they_were_written() {
        let all = [
            Message::setup(&setup("messages")).expect("JSON"),
            Message::motion(&[[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [7.0; 7]]),
            Message::image(0.5, &[7; 12]),
            Message::command("record"),
        ];
        let mut bytes = Vec::new();
        all.iter().for_each(|message| write(&mut bytes, message).expect("to memory"));
        let mut from = &bytes[..];
        let back = || read(&mut from).expect("whole");
        assert_eq!(std::iter::from_fn(back).collect::<Vec<_>>(), all);
        assert!(read(&mut &bytes[..bytes.len() - 1][bytes.len() - 11..]).is_err(), "cut off");
    }

    #[test]
    fn bad_messages_are_answered_and_the_walk_goes_on() {
        let mut phone = None;
        let mut answer = |kind, content: &[u8]| apply(&mut phone, kind, content).error.unwrap_or_default();
        assert!(answer(b'I', &[0; 20]).contains("first message"));
        assert!(answer(b'S', b"{}").contains("width"));
        assert!(
            answer(b'S', br#"{"width": 0, "height": 48, "rate_hz": 15.0, "library": {"folder": ""}}"#)
                .contains("cannot be used")
        );
        let setup = setup("bad");
        assert_eq!(answer(b'S', &Message::setup(&setup).expect("JSON").content), "");
        assert!(answer(b'I', &[0; 20]).contains("64x48 has 3072 bytes, not 12"));
        assert!(answer(b'I', &[0; 7]).contains("7 bytes"));
        assert!(answer(b'M', &[0; 57]).contains("57 bytes"));
        assert!(answer(b'M', &Message::motion(&[[f64::NAN; 7]]).content).contains("no time"));
        assert!(answer(b'T', &f64::INFINITY.to_le_bytes()).contains("no time"));
        assert!(answer(b'C', b"fly").contains("fly"));
        assert!(answer(b'Z', b"").contains("kind 90"));
        let image = Message::image(1.0, &[90; 64 * 48]).content;
        assert_eq!((answer(b'I', &image), answer(b'E', b"")), (String::new(), String::new()));
        assert!(!answer(b'I', &image).is_empty(), "the same time again");
        let _ = std::fs::remove_dir_all(&setup.library.folder);
    }

    #[test]
    fn an_image_waits_for_the_motion_up_to_it() {
        let mut phone = None;
        let setup = setup("waits");
        apply(&mut phone, b'S', &Message::setup(&setup).expect("JSON").content);
        let mut reports = |message: Message| apply(&mut phone, message.kind, &message.content).reports.len();
        assert_eq!(reports(Message::image(0.1, &[90; 64 * 48])), 0, "no motion yet");
        assert_eq!(reports(Message::motion(&[[0.09, 0.0, 0.0, 0.0, 0.0, -9.8, 0.0]])), 0, "none after it");
        assert_eq!(reports(Message::motion(&[[0.11, 0.0, 0.0, 0.0, 0.0, -9.8, 0.0]])), 1);
        assert_eq!(reports(Message::image(0.2, &[90; 64 * 48])), 0);
        let later = Message { kind: b'T', content: 0.3f64.to_le_bytes().to_vec() };
        assert_eq!(reports(later), 1, "it has waited long enough");
        let _ = std::fs::remove_dir_all(&setup.library.folder);
    }
}
