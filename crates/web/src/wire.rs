//! The messages of the web socket. Text is JSON with one key that names the kind; images are binary.

use crate::phones::KnownPhone;
use cairn_geometry::Vec3;
use cairn_session::{Event, RouteListed, SessionStatus, earcon_name};
use cairn_sources::MotionReading;
use serde::{Deserialize, Serialize};

/// Text messages from a page.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum FromPage {
    /// The first message: the token, and whether the page may hold the walk, identified by the secret it keeps;
    /// `origin` distinguishes the page's clock, in milliseconds, from that of an earlier load of it.
    Hello {
        token: String,
        walk: bool,
        #[serde(default)]
        secret: String,
        #[serde(default)]
        origin: f64,
        /// Minutes that the page's local time is ahead of UTC.
        #[serde(default)]
        zone_min: i16,
        /// The code of the page's language.
        #[serde(default)]
        language: String,
        /// Identifies the phone, the same in every session: its lens is kept by it.
        #[serde(default)]
        phone: String,
    },
    /// The first message of a further connection of a page: the token, and the id and secret of the page.
    Beside { token: String, id: u64, secret: String },
    /// A message that goes on several connections, with its number: it is taken once, and in order.
    Copy(u64, Box<FromPage>),
    /// The answer to a ping: its number, and the page's time in milliseconds.
    Pong { n: u64, ms: f64 },
    /// Whether what the page receives is based on images that are too old by its own clock.
    Late(bool),
    /// A command of the session, as a line.
    Command(String),
    /// The code of the page's language, and how the walker wants to be spoken to, as lines of the session; these count
    /// from the page that holds the walk.
    Settings { language: String, lines: Vec<String> },
    /// Motion: milliseconds, angular rate, specific force, each in the image axes.
    Motion(Vec<[f64; 7]>),
    /// What the page wants to receive: images, the map, the surface of the depth, columns.
    Want {
        picture: bool,
        map: bool,
        #[serde(default)]
        surface: bool,
        #[serde(default)]
        columns: bool,
    },
    /// What the page keeps in its browser, for when it comes from another address.
    Kept(serde_json::Value),
    /// Takes the walk when no page holds it.
    Take(bool),
    /// Takes the walk, even from a page that holds it.
    TakeOver(bool),
}

/// Text messages to pages.
#[derive(Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ToPage<'a> {
    /// The answer to a hello.
    Hello { id: u64, version: &'static str, camera: &'a str },
    /// The answer to a hello without the access token.
    Stranger(bool),
    /// The phones that the page's may be, which it does not know any more.
    Phones(Vec<KnownPhone>),
    /// The answer on a further connection.
    Beside(bool),
    /// The page that holds the walk; with `held` but without an id, that page is away and the walk waits for it.
    Control { id: Option<u64>, held: bool },
    /// A ping, to be answered at once: it relates the clocks and shows that the page is present. It carries the
    /// shortest of the last round trips, milliseconds, from which the page computes the time that an image takes.
    Ping { n: u64, trip_ms: Option<f64> },
    /// The image with this time has arrived: the next may be sent. It is not used where a newer one came before it.
    Got { ms: f64, overtaken: bool },
    /// The newest image that was tracked, as its time in the clock of the page that captured it, if it is from one. Every image,
    /// not only every status: by this the page knows how old what it hears is.
    Frame { ms: Option<f64> },
    /// An utterance that starts now.
    Said {
        #[serde(flatten)]
        said: &'a cairn_session::Said,
        /// The page's time of the image that a direction is based on, milliseconds; the page does not give old
        /// directions.
        pose_ms: Option<f64>,
    },
    /// An earcon that starts now.
    Sound { name: &'static str, bearing_rad: f64 },
    /// The result of a command, which the session also says.
    Did { ok: bool, text: &'a str },
    /// A command that did not reach the session, and why.
    Refused(&'a str),
    /// The session's status.
    Status {
        /// The status itself.
        #[serde(flatten)]
        status: &'a SessionStatus,
        /// Packets dropped.
        dropped: usize,
    },
    /// Where the camera is in the map: position, then the axes right, down and forward; the map itself is binary.
    View { camera: Option<[[f32; 3]; 4]> },
    /// The kept routes, newest first.
    Routes(&'a [RouteListed]),
    /// The walk has failed; the computer shows why.
    Failed(bool),
    /// The walk has ended.
    Ended(bool),
    /// An implausible calibration or sensor: shown on the screen, not spoken.
    Doubt(&'a str),
    /// The lens of the phone is known now, and is used from the next session on: focal length as a share of the longer
    /// side, distortion, and their standard deviations.
    Lens { focal: f64, radial: f64, sigma: [f64; 2] },
}

impl ToPage<'_> {
    /// The JSON text.
    pub fn text(&self) -> String {
        // These types have no map keys, and the only numbers that JSON cannot represent are NaN, which become null.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// The JSON text of an event; `pose_ms` as in [`ToPage::Said`].
pub(crate) fn event(event: &Event, pose_ms: Option<f64>) -> String {
    match event {
        Event::Said(said) => ToPage::Said { said, pose_ms }.text(),
        Event::Sound(sound) => {
            ToPage::Sound { name: earcon_name(sound.earcon), bearing_rad: sound.bearing_rad }.text()
        }
    }
}

/// Motion in the form that the port accepts.
pub(crate) fn motion([ms, gx, gy, gz, ax, ay, az]: [f64; 7]) -> MotionReading {
    MotionReading { ms, gyro: Vec3::new(gx, gy, gz), accel: Vec3::new(ax, ay, az) }
}

/// An image from a page: the page's milliseconds as eight bytes (little-endian float), then a JPEG.
pub(crate) fn picture(bytes: &[u8]) -> Option<(f64, &[u8])> {
    let (head, jpeg) = bytes.split_at_checked(8)?;
    Some((f64::from_le_bytes(head.try_into().ok()?), jpeg))
}

/// An image to a page: kind 1, width, height, count (16 bits each, little-endian), features as pairs of 16 bits, then
/// gray rows. Large images are halved; feature coordinates are pixels of the image as sent.
pub(crate) fn preview(image: &cairn_sensor::GrayImage, features: &[[f32; 2]]) -> Vec<u8> {
    let step = image.width().div_ceil(480).max(1);
    let (w, h) = (image.width() / step, image.height() / step);
    let count = features.len().min(4000);
    let mut out = Vec::with_capacity(8 + 4 * count + w * h);
    out.push(1);
    for n in [w, h, count] {
        out.extend((n as u16).to_le_bytes());
    }
    out.push(0);
    for f in &features[..count] {
        for v in f {
            out.extend((v.max(0.0) as u16 / step as u16).to_le_bytes());
        }
    }
    for y in 0..h {
        out.extend(image.row(y * step).iter().step_by(step).take(w));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::GrayImage;

    #[test]
    fn messages_parse_and_malformed_ones_are_rejected() {
        let read = |text: &str| serde_json::from_str::<FromPage>(text);
        assert!(matches!(
            read(r#"{"hello":{"token":"x","walk":true}}"#),
            Ok(FromPage::Hello { walk: true, .. })
        ));
        assert!(matches!(read(r#"{"takeover":true}"#), Ok(FromPage::TakeOver(true))));
        assert!(matches!(read(r#"{"pong":{"n":3,"ms":1.5}}"#), Ok(FromPage::Pong { n: 3, .. })));
        assert!(matches!(read(r#"{"command":"guide back"}"#), Ok(FromPage::Command(c)) if c == "guide back"));
        assert!(matches!(read(r#"{"motion":[[1,0,0,0,0,0,9.8]]}"#), Ok(FromPage::Motion(m)) if m.len() == 1));
        for wrong in [
            "",
            "{}",
            r#"{"fly":1}"#,
            r#"{"motion":[[1,2]]}"#,
            r#"{"hello":{"token":"x"}}"#,
            r#"{"pong":{"n":3,"ms":null}}"#,
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        assert_eq!(picture(&[0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 7]), Some((1.0, &[7][..])));
        assert_eq!(picture(&[1, 2]), None);
    }

    #[test]
    fn pictures_are_halved_with_their_features() {
        let mut image = GrayImage::new(640, 480);
        image.row_mut(2)[4] = 9;
        let bytes = preview(&image, &[[4.0, 2.0]]);
        assert_eq!(bytes.len(), 8 + 4 + 320 * 240);
        assert_eq!(bytes[..12], [1, 64, 1, 240, 0, 1, 0, 0, 2, 0, 1, 0]);
        assert_eq!(bytes[12 + 320 + 2], 9);
    }
}
