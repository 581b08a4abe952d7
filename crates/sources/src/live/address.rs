//! What an address of video means, and how `ffmpeg` is asked for it.

use cairn_sensor::SourceError;
use std::ffi::OsString;
use std::path::Path;

/// Ends of file names that are taken for video.
const VIDEO: [&str; 10] = ["mp4", "mkv", "mov", "webm", "avi", "mjpeg", "mjpg", "y4m", "ts", "flv"];

/// An address, understood.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Address {
    /// As the user wrote it.
    pub shown: String,
    /// The program and what it is told before `-i`.
    pub before: Vec<OsString>,
    /// What stands after `-i`.
    pub input: OsString,
    /// Comes as it happens.
    pub live: bool,
    /// We wait for someone to send, as long as it takes.
    pub listens: bool,
    /// The name that must be published, where we listen.
    pub name: Option<String>,
}

impl Address {
    /// What the text means; `None` when it is no video, an error when it is one that can not be.
    pub fn of(text: &str) -> Option<Result<Self, SourceError>> {
        let make = |before: &[&str], input: String, live, listens| Self {
            shown: text.to_owned(),
            before: before.iter().map(OsString::from).collect(),
            input: input.into(),
            live,
            listens,
            name: None,
        };
        if let Some(rest) = text.strip_prefix("rtmp-listen://") {
            return Some(match listener(rest) {
                Ok(name) => Ok(Self {
                    name: Some(name.to_owned()),
                    ..make(&["-listen", "1"], format!("rtmp://{rest}"), true, true)
                }),
                Err(why) => Err(SourceError::new(text, why, "write rtmp-listen://HOST:PORT/NAME")),
            });
        }
        if text.starts_with("rtmp://") || text.starts_with("rtmps://") {
            return Some(Ok(make(&["-rw_timeout", "5000000"], text.to_owned(), true, false)));
        }
        if text.starts_with("rtsp://") {
            return Some(Ok(make(&["-rtsp_transport", "tcp"], text.to_owned(), true, false)));
        }
        if let Some(number) = text.strip_prefix("camera:") {
            return Some(match number.parse::<u32>() {
                Ok(n) => Ok(make(&["-f", "v4l2"], format!("/dev/video{n}"), true, false)),
                Err(_) => Err(SourceError::new(text, "names no camera", "write camera:0 for the first")),
            });
        }
        if text.starts_with("/dev/video") {
            return Some(Ok(make(&["-f", "v4l2"], text.to_owned(), true, false)));
        }
        let path = Path::new(text);
        let end = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase())?;
        // "file:" keeps a name with a colon, or one that begins with a dash, from meaning something else.
        (path.is_file() && VIDEO.contains(&end.as_str()))
            .then(|| Ok(make(&[], format!("file:{text}"), false, false)))
    }
}

/// Checks `HOST:PORT/NAME`; gives the name.
fn listener(rest: &str) -> Result<&str, String> {
    let (place, name) = rest.split_once('/').ok_or("has no name after the port")?;
    let (host, port) = place.rsplit_once(':').ok_or("has no port")?;
    if host.is_empty() || name.is_empty() {
        return Err("host or name is empty".into());
    }
    match port.parse::<u16>() {
        Ok(p) if p > 0 => Ok(name),
        _ => Err(format!("\"{port}\" is no port")),
    }
}

/// What the user should be told before such a source is opened, which may take as long as nobody sends.
pub fn waiting_for(source: &str) -> Option<String> {
    match Address::of(source)? {
        Ok(a) if a.listens => Some(format!("waiting for video at {}", a.input.to_string_lossy())),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_found_by_looking() {
        let of = |text: &str| Address::of(text).unwrap().unwrap();
        let listen = of("rtmp-listen://0.0.0.0:1935/cairn");
        assert!(listen.live && listen.listens);
        assert_eq!(listen.input, "rtmp://0.0.0.0:1935/cairn");
        assert_eq!(listen.name.as_deref(), Some("cairn"));
        assert!(of("rtmp://example.org/app/key").live && !of("rtmp://example.org/app/key").listens);
        assert_eq!(of("camera:2").input, "/dev/video2");
        assert!(of("rtsp://example.org/1").live);
        assert!(Address::of("sim:demo").is_none() && Address::of("/nowhere/x.mp4").is_none());
        assert!(waiting_for("rtmp-listen://h:1/n").unwrap().contains("rtmp://h:1/n"));
        assert!(waiting_for("rtmp://h:1/n").is_none());
    }

    #[test]
    fn listeners_that_can_not_be_are_told() {
        for (wrong, why) in [
            ("rtmp-listen://host/name", "no port"),
            ("rtmp-listen://host:1935", "no name"),
            ("rtmp-listen://host:70000/name", "is no port"),
            ("rtmp-listen://:1935/name", "is empty"),
            ("camera:front", "names no camera"),
        ] {
            let error = Address::of(wrong).unwrap().unwrap_err().to_string();
            assert!(error.contains(why), "{wrong}: {error}");
        }
    }
}
