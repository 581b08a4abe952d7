//! A video file as a [`Source`]: every image in order, at the times in the file; of a rig with two cameras of half the width,
//! left and right side by side in each, or of half the height one above the other.

use super::address::Address;
use super::child::{ChildCommand, Feed, Handle, Said};
use super::rig_for;
use crate::halves::{DOUBT, alike, half, two_in_one};
use crate::options::OpenOptions;
use crate::prefetch::Prefetch;
use cairn_sensor::{FramePacket, Rig, SkipKind, Skipped, Skips, Source, SourceError, SourceInfo, Stamp};
use std::ffi::OsString;
use std::sync::Arc;
use std::time::Instant;

struct VideoFile {
    info: SourceInfo,
    rig: Rig,
    handle: Handle,
    feed: Option<Feed>,
    size: [usize; 2],
    delivered: usize,
    last: Option<Stamp>,
    /// The calibration is not a guess.
    is_calibrated: bool,
    skipped: Vec<String>,
    skips: Skips,
}

/// Width and height of the images.
pub(super) fn size(address: &Address) -> Option<[usize; 2]> {
    let more: Vec<OsString> = ["-frames:v", "1"].map(OsString::from).into();
    let mut feed = Feed::start(&ChildCommand::ffmpeg(address, &more), &Handle::default()).ok()?;
    let size = feed.header().map(|(size, _)| size);
    let _ = feed.end();
    size
}

/// Opens a file; it is read ahead on a thread.
pub(super) fn open(address: &Address, options: &OpenOptions) -> Result<Box<dyn Source>, SourceError> {
    let mut more: Vec<OsString> = Vec::new();
    if options.start_s > 0.0 {
        more.extend(["-ss".into(), format!("{:.6}", options.start_s).into()]);
    }
    if let Some(frames) = options.frames {
        more.extend(["-frames:v".into(), frames.to_string().into()]);
    }
    let handle = Handle::default();
    let mut feed = Feed::start(&ChildCommand::ffmpeg(address, &more), &handle)?;
    let Some((size, rate_hz)) = feed.header() else {
        return Err(SourceError::new(&address.shown, feed.end(), "give a file with a video track"));
    };
    let both = options.rig.as_ref().filter(|rig| two_in_one(rig, size).is_some());
    let (rig, assumed) = match both {
        Some(rig) => (Rig { cameras: rig.cameras[..2].to_vec(), ..rig.clone() }, None),
        None => {
            let first = options.rig.clone().map(|mut rig| {
                rig.cameras.truncate(1);
                rig
            });
            rig_for(&address.shown, size, first)?
        }
    };
    let info = SourceInfo {
        name: format!("video {}", address.shown),
        frames: None,
        rate_hz,
        truth: Vec::new(),
        assumed,
    };
    let feed = Some(feed);
    let (skipped, skips) = (Vec::new(), Skips::default());
    let is_calibrated = info.assumed.is_none();
    let file =
        VideoFile { info, rig, handle, feed, size, delivered: 0, last: None, is_calibrated, skipped, skips };
    Ok(Box::new(Prefetch::start(file)?.cancelled_by(options.cancel.clone())))
}

impl VideoFile {
    /// What is doubtful of a film that was read to its end: that the file breaks off or is damaged, and that a calibration may be of
    /// pictures that stand the other way up.
    fn doubt(&mut self, said: &Said) {
        let (shown, images) = (&self.info.name, self.delivered);
        let damage = said.error().map(|error| {
            format!("{shown}: the file is damaged or breaks off, {images} images were read; ffmpeg says {} times: {error}", said.count)
        });
        let turned = said.turned_deg.filter(|by| self.is_calibrated && by.abs() > 1.0).map(|by| {
            format!("{shown}: its pictures are turned by {by:.0} degrees as the file asks; the calibration has to be of pictures that are turned so")
        });
        for text in damage.into_iter().chain(turned) {
            self.skips.add(&Skipped::new(SkipKind::Other, "the video is doubtful", &text));
            self.skipped.push(text);
        }
    }
}

impl Source for VideoFile {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        loop {
            let start = Instant::now();
            let Some(feed) = &mut self.feed else { return Ok(None) };
            let Some((image, time)) = feed.next_image(self.size) else {
                let said = self.feed.take().map(Feed::said).unwrap_or_default();
                if self.delivered == 0 {
                    let why = said.error().unwrap_or("the stream ended");
                    return Err(SourceError::new(&self.info.name, why, "give a file with a video track"));
                }
                self.doubt(&said);
                return Ok(None);
            };
            let number = self.delivered;
            self.delivered += 1;
            let stamp = Stamp::from_seconds(time.unwrap_or(number as f64 / self.info.rate_hz));
            if self.last.is_some_and(|last| stamp <= last) {
                let text = format!("image {number}: its time {stamp} does not increase");
                self.skips.add(&Skipped::new(SkipKind::Frame, "the time does not increase", &text).at(stamp));
                self.skipped.push(text);
                continue;
            }
            self.last = Some(stamp);
            if number == 0 && !self.is_calibrated && alike(&image) {
                self.skips.add(&Skipped::new(SkipKind::Other, "two pictures side by side", DOUBT));
                self.skipped.push(DOUBT.to_owned());
            }
            let decode_ms = start.elapsed().as_secs_f64() * 1e3;
            let images = match self.rig.cameras.len() {
                2 => [0, 1].map(|side| Arc::new(half(&image, side, &self.rig.cameras[side].camera))).into(),
                _ => vec![Arc::new(image)],
            };
            return Ok(Some(FramePacket { stamp, images, depth: None, imu: Vec::new(), decode_ms }));
        }
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn skips(&self) -> Skips {
        self.skips.clone()
    }
}

impl Drop for VideoFile {
    fn drop(&mut self) {
        self.handle.end();
    }
}
