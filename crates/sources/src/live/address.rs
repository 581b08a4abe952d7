//! Video addresses, and the `ffmpeg` arguments for them.

use cairn_sensor::SourceError;
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::Path;

/// File name extensions taken for video.
const VIDEO: [&str; 10] = ["mp4", "mkv", "mov", "webm", "avi", "mjpeg", "mjpg", "y4m", "ts", "flv"];

/// A parsed address.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Address {
    /// As the user wrote it.
    pub shown: String,
    /// Arguments before `-i`.
    pub before: Vec<OsString>,
    /// The argument after `-i`.
    pub input: OsString,
    /// Whether the source is live.
    pub live: bool,
    /// The `HOST:PORT` where we listen for a sender, for as long as it takes.
    pub listens: Option<String>,
    /// The stream name that must be published, where we listen.
    pub name: Option<String>,
}

impl Address {
    /// Parses an address; `None` when it is not video, an error when it is invalid.
    pub fn of(text: &str) -> Option<Result<Self, SourceError>> {
        let make = |before: &[&str], input: String, live| Self {
            shown: text.to_owned(),
            before: before.iter().map(OsString::from).collect(),
            input: input.into(),
            live,
            listens: None,
            name: None,
        };
        if let Some(rest) = text.strip_prefix("rtmp-listen://") {
            return Some(listener(rest, text).map(|(place, name)| Self {
                listens: Some(place.to_owned()),
                name: Some(name.to_owned()),
                // Who connects and sends nothing for so long is let go; waiting for a sender has no end.
                ..make(&["-rw_timeout", "3000000", "-listen", "1"], format!("rtmp://{rest}"), true)
            }));
        }
        if text.starts_with("rtmp://") || text.starts_with("rtmps://") {
            return Some(Ok(make(&["-rw_timeout", "5000000"], text.to_owned(), true)));
        }
        if text.starts_with("rtsp://") {
            return Some(Ok(make(&["-rtsp_transport", "tcp"], text.to_owned(), true)));
        }
        if let Some(number) = text.strip_prefix("camera:") {
            return Some(match number.parse::<u32>() {
                Ok(n) => Ok(make(&["-f", "v4l2"], format!("/dev/video{n}"), true)),
                Err(_) => {
                    Err(SourceError::new(text, "is not a camera number", "write camera:0 for the first"))
                }
            });
        }
        if text.starts_with("/dev/video") {
            return Some(Ok(make(&["-f", "v4l2"], text.to_owned(), true)));
        }
        let path = Path::new(text);
        let end = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase())?;
        // "file:" keeps a name with a colon, or one that starts with a dash, from being misinterpreted.
        (path.is_file() && VIDEO.contains(&end.as_str()))
            .then(|| Ok(make(&[], format!("file:{text}"), false)))
    }

    /// The same for `ffmpeg` on a port of this machine alone, to which senders are handed on.
    pub fn listening_at(&self, inner: SocketAddr) -> Self {
        let name = self.name.as_deref().unwrap_or_default();
        Self { input: format!("rtmp://{inner}/{name}").into(), ..self.clone() }
    }
}

/// Checks the `HOST:PORT/NAME` of an address; returns `HOST:PORT` and the name.
fn listener<'a>(rest: &'a str, address: &str) -> Result<(&'a str, &'a str), SourceError> {
    let wrong = |why: String| SourceError::new(address, why, "write rtmp-listen://HOST:PORT/NAME");
    let (place, name) = rest.split_once('/').ok_or_else(|| wrong("has no name after the port".into()))?;
    let (host, port) = place.rsplit_once(':').ok_or_else(|| wrong("has no port".into()))?;
    if host.is_empty() || name.is_empty() {
        return Err(wrong("host or name is empty".into()));
    }
    match port.parse::<u16>() {
        Ok(p) if p > 0 => Ok((place, name)),
        _ => Err(wrong(format!("\"{port}\" is not a port"))),
    }
}

/// A message for the user before such a source is opened, which may take until someone sends.
pub fn waiting_for(source: &str) -> Option<String> {
    match Address::of(source)? {
        Ok(a) if a.listens.is_some() => Some(format!("waiting for video at {}", a.input.to_string_lossy())),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_detected() {
        let of = |text: &str| Address::of(text).unwrap().unwrap();
        let listen = of("rtmp-listen://0.0.0.0:1935/cairn");
        assert!(listen.live && listen.listens.as_deref() == Some("0.0.0.0:1935"));
        let inner = listen.listening_at(SocketAddr::from(([127, 0, 0, 1], 4000)));
        assert_eq!(inner.input, "rtmp://127.0.0.1:4000/cairn");
        assert_eq!(listen.input, "rtmp://0.0.0.0:1935/cairn");
        assert_eq!(listen.name.as_deref(), Some("cairn"));
        assert!(of("rtmp://example.org/app/key").live && of("rtmp://example.org/app/key").listens.is_none());
        assert_eq!(of("camera:2").input, "/dev/video2");
        assert!(of("rtsp://example.org/1").live);
        assert!(Address::of("sim:demo").is_none() && Address::of("/nowhere/x.mp4").is_none());
        assert!(waiting_for("rtmp-listen://h:1/n").unwrap().contains("rtmp://h:1/n"));
        assert!(waiting_for("rtmp://h:1/n").is_none());
    }

    #[test]
    fn invalid_addresses_are_refused() {
        for (wrong, why) in [
            ("rtmp-listen://host/name", "no port"),
            ("rtmp-listen://host:1935", "no name"),
            ("rtmp-listen://host:70000/name", "is not a port"),
            ("rtmp-listen://:1935/name", "is empty"),
            ("camera:front", "is not a camera number"),
        ] {
            let error = Address::of(wrong).unwrap().unwrap_err().to_string();
            assert!(error.contains(why), "{wrong}: {error}");
        }
    }
}
