//! Addresses of cameras: `v4l2:/dev/video0`, `realsense:`, with what is asked of them.

use cairn_sensor::SourceError;
use std::path::PathBuf;

/// Where to look for a camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// One node.
    Node(PathBuf),
    /// A RealSense, by its serial number or the only one.
    RealSense {
        /// As `cairn doctor` lists it.
        serial: Option<String>,
    },
}

/// A parsed address.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraAddress {
    /// As the user wrote it.
    pub shown: String,
    /// Which camera.
    pub place: Place,
    /// Width and height of the first camera's images; else those of the rig.
    pub size: Option<[usize; 2]>,
    /// Frames per second.
    pub rate_hz: f64,
}

/// Frames per second where none are asked for.
const USUAL_RATE_HZ: f64 = 30.0;

impl CameraAddress {
    /// Parses `v4l2:NODE` and `realsense:SERIAL`, each with `?size=WxH&rate=HZ` if wanted; `None` for other kinds.
    pub fn of(text: &str) -> Option<Result<Self, SourceError>> {
        let (kind, rest) = text.split_once(':')?;
        if kind != "v4l2" && kind != "realsense" {
            return None;
        }
        let (name, query) = rest.split_once('?').unwrap_or((rest, ""));
        let fail = |why: String| {
            SourceError::new(
                text,
                why,
                "write v4l2:/dev/video0 or realsense:, with ?size=640x480&rate=30 if wanted",
            )
        };
        let place = match kind {
            "v4l2" if name.is_empty() => return Some(Err(fail("names no device".into()))),
            "v4l2" if name.bytes().all(|b| b.is_ascii_digit()) => {
                Place::Node(format!("/dev/video{name}").into())
            }
            "v4l2" => Place::Node(name.into()),
            _ => Place::RealSense { serial: (!name.is_empty()).then(|| name.to_owned()) },
        };
        let mut address = Self { shown: text.to_owned(), place, size: None, rate_hz: USUAL_RATE_HZ };
        for entry in query.split('&').filter(|e| !e.is_empty()) {
            let taken = match entry.split_once('=') {
                Some(("size", value)) => size(value).map(|size| address.size = Some(size)),
                Some(("rate", value)) => rate(value).map(|rate_hz| address.rate_hz = rate_hz),
                _ => None,
            };
            if taken.is_none() {
                return Some(Err(fail(format!("\"{entry}\" is not understood"))));
            }
        }
        Some(Ok(address))
    }
}

fn size(text: &str) -> Option<[usize; 2]> {
    let (w, h) = text.split_once('x')?;
    let side = |t: &str| t.parse().ok().filter(|n| (1..=16_384).contains(n));
    Some([side(w)?, side(h)?])
}

fn rate(text: &str) -> Option<f64> {
    text.parse().ok().filter(|r: &f64| (1.0..=1000.0).contains(r))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_parsed_or_refused_in_words() {
        let of = |text: &str| CameraAddress::of(text).unwrap().unwrap();
        let plain = of("v4l2:/dev/video2");
        assert_eq!((plain.place, plain.size, plain.rate_hz), (Place::Node("/dev/video2".into()), None, 30.0));
        assert_eq!(of("v4l2:3").place, Place::Node("/dev/video3".into()));
        let all = of("v4l2:/dev/v4l/by-id/usb-cam:1?size=1280x720&rate=60");
        assert_eq!(all.place, Place::Node("/dev/v4l/by-id/usb-cam:1".into()));
        assert_eq!((all.size, all.rate_hz), (Some([1280, 720]), 60.0));
        assert_eq!(of("realsense:").place, Place::RealSense { serial: None });
        assert_eq!(of("realsense:8416?rate=15").place, Place::RealSense { serial: Some("8416".into()) });
        assert!(CameraAddress::of("rtsp://x").is_none() && CameraAddress::of("/dev/video0").is_none());
        for wrong in ["v4l2:", "v4l2:0?size=640", "v4l2:0?rate=nan", "realsense:?depth", "v4l2:0?size=0x9"] {
            let error = CameraAddress::of(wrong).unwrap().unwrap_err().to_string();
            assert!(error.contains("v4l2:/dev/video0"), "{wrong}: {error}");
        }
    }
}
