//! Plays a recording: decodes the images of each instant and adds the IMU samples.

use crate::bag_reader::{BagImu, BagReader, MessageError};
use crate::imu::{ImuStream, SplitImuStream};
use crate::live::Film;
use crate::recording::{ImageAt, ImuAt, Instant, Recording};
use crate::{decode, exif, halves};
use cairn_sensor::{
    Camera, DepthImage, FramePacket, GrayImage, ImuSample, Merge, MergeConfig, Rig, SkipKind, Skipped, Skips,
    Source, SourceError, SourceInfo, Stream,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time;
use std::vec::IntoIter;

/// Lines kept on what was skipped; beyond that only the count in the last line grows.
const MAX_LINES: usize = 10_000;

/// Gaps in the IMU's stream that are reported individually.
const MAX_GAPS: usize = 10;

/// The samples of the IMU, one after the other.
enum Samples {
    Csv(ImuStream),
    Split(SplitImuStream),
    Bag(BagImu),
}

impl Samples {
    fn next(&mut self, bag: &mut Option<BagReader>, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        match (self, bag) {
            (Self::Csv(stream), _) => stream.next(skipped),
            (Self::Split(stream), _) => stream.next(skipped),
            (Self::Bag(imu), Some(bag)) => imu.next(bag, skipped),
            (Self::Bag(_), None) => None,
        }
    }

    /// What was read last, for messages.
    fn place(&self) -> String {
        match self {
            Self::Csv(stream) => stream.place(),
            Self::Split(stream) => stream.place(),
            Self::Bag(imu) => imu.place(),
        }
    }
}

/// A recording being read.
pub struct Player {
    info: SourceInfo,
    rig: Rig,
    instants: IntoIter<Instant>,
    imu: Option<Samples>,
    /// The bag that images and samples are in, if it is one.
    bag: Option<BagReader>,
    /// The film that images are taken from, if they are.
    film: Option<Film>,
    /// Bits in use of the pixels of each camera's files that have 16.
    bits: Vec<u32>,
    /// The file of which the left half was taken last.
    both: Option<(PathBuf, GrayImage)>,
    /// Merges the IMU with the instants, whose images are already grouped.
    merge: Merge<Decoded, ()>,
    no_depth: Option<u16>,
    ended: bool,
    skipped: Vec<String>,
    skips: Skips,
    left_out: usize,
}

impl Player {
    /// Checks the rig against the first image of each camera.
    ///
    /// # Errors
    ///
    /// [`SourceError`] when the rig is invalid or does not fit the images, or the IMU file cannot be read.
    pub fn new(recording: Recording) -> Result<Self, SourceError> {
        let rate_hz = recording.rate_hz();
        let Recording { name, mut rig, instants, imu, mut bag, truth, no_depth, skipped, assumed } =
            recording;
        if let Err(e) = rig.validate() {
            return Err(SourceError::new(name, format!("its rig is wrong: {e}"), "correct the calibration"));
        }
        let mut skipped = skipped;
        skipped.extend(depth_of_another_size(&mut rig, &instants, &mut bag));
        check_sizes(&name, &rig, &instants, &mut bag)?;
        let bits = (0..rig.cameras.len()).map(|k| bits_in_use(&instants, k)).collect::<Vec<_>>();
        skipped.extend(rig.cameras.iter().zip(&bits).filter(|(_, bits)| **bits < 16).map(
            |(camera, bits)| {
                let text = format!(
                    "{}: of the 16 bits of a pixel {bits} are in use, white is {}",
                    camera.name,
                    (1u32 << bits) - 1
                );
                Skipped::new(SkipKind::Other, "pixels of fewer bits", text)
            },
        ));
        // Stamps are delivered in the images' clock, so no offset is left.
        let imu_offset_s = rig.imu.as_mut().map_or(0.0, |imu| std::mem::take(&mut imu.offset_s));
        let imu = match imu {
            Some(ImuAt::Csv(path, columns)) => Some(Samples::Csv(ImuStream::open(&path, columns)?)),
            Some(ImuAt::Split { gyro, accel }) => Some(Samples::Split(SplitImuStream::open(&gyro, &accel)?)),
            Some(ImuAt::Messages(topics)) => Some(Samples::Bag(BagImu::new(topics))),
            None => None,
        };
        let imu_period_s = rig.imu.as_ref().filter(|_| imu.is_some()).map(|sensor| 1.0 / sensor.rate_hz);
        let wait_s = f64::INFINITY;
        let config = MergeConfig { imu_period_s, imu_offset_s, wait_s, ..Default::default() };
        let mut player = Self {
            info: SourceInfo { name, frames: Some(instants.len()), rate_hz, truth, assumed },
            rig,
            instants: instants.into_iter(),
            imu,
            bag,
            film: None,
            bits,
            both: None,
            merge: Merge::new(config),
            no_depth,
            ended: false,
            skipped: Vec::new(),
            skips: Skips::default(),
            left_out: 0,
        };
        player.note(skipped);
        Ok(player)
    }

    fn note(&mut self, skipped: Vec<Skipped>) {
        for one in skipped {
            self.skips.add(&one);
            let line = one.text;
            if self.skipped.len() < MAX_LINES {
                self.skipped.push(line);
            } else if let Some(last) = self.skipped.last_mut() {
                self.left_out += 1;
                *last = format!("and {} more", self.left_out + 1);
            }
        }
    }

    /// The packet of an instant; `None` when it is skipped.
    fn read(&mut self, instant: &Instant) -> Option<FramePacket> {
        let start = time::Instant::now();
        let decoded = self.decode(instant);
        let decode_ms = start.elapsed().as_secs_f64() * 1e3;
        let decoded = match decoded {
            Ok(decoded) => decoded,
            Err(why) => {
                let text = format!("{}: {why}", instant.stamp);
                let one = Skipped::new(SkipKind::Frame, "an image cannot be read", text);
                self.note(vec![one.at(instant.stamp)]);
                return None;
            }
        };
        if let Err(dropped) = self.merge.push_image(0, instant.stamp, decoded) {
            let one =
                Skipped::new(SkipKind::Frame, dropped.why.to_string(), format!("{dropped}, image dropped"));
            self.note(vec![one.at(instant.stamp)]);
        }
        self.merged(decode_ms)
    }

    /// The next packet that is whole. After a jump of the time an image waits for the one after it, so it may be an earlier one.
    fn merged(&mut self, decode_ms: f64) -> Option<FramePacket> {
        self.read_imu();
        let merged = self.merge.pop()?;
        let (images, depth) = merged.images.into_iter().next()?;
        Some(FramePacket { stamp: merged.stamp, images, depth, imu: merged.imu, decode_ms })
    }

    /// Feeds the IMU samples that the next instant needs to the merge.
    fn read_imu(&mut self) {
        let mut skipped = Vec::new();
        while self.merge.lacks() == Some(Stream::Imu) {
            let bag = &mut self.bag;
            let Some((imu, sample)) = self.imu.as_mut().and_then(|imu| {
                let sample = imu.next(bag, &mut skipped)?;
                Some((imu, sample))
            }) else {
                self.merge.end(Stream::Imu);
                break;
            };
            match self.merge.push_imu(sample) {
                Ok(Some(gap)) if self.merge.counts().imu_gaps <= MAX_GAPS => {
                    let text = format!("{}: no IMU sample for {:.3} s", gap.from, gap.to - gap.from);
                    skipped.push(Skipped::new(SkipKind::Imu, "a gap in the readings", text).at(gap.from));
                }
                Ok(_) => {}
                Err(dropped) => {
                    let text = format!("{}: {dropped}, sample dropped", imu.place());
                    skipped.push(Skipped::new(SkipKind::Imu, dropped.why.to_string(), text));
                }
            }
        }
        self.note(skipped);
    }

    /// An image of the `k`-th camera.
    fn image(&mut self, k: usize, at: &ImageAt) -> Result<GrayImage, FrameError> {
        let bits = self.bits.get(k).copied().unwrap_or(16);
        match (at, &mut self.bag) {
            (ImageAt::File(path), _) => Ok(self.as_calibrated(k, path, decode::gray_of_bits(path, bits)?)),
            (ImageAt::Message(topic, entry), Some(bag)) => Ok(bag.gray(*topic, entry)?),
            (ImageAt::Message(..), None) => Err(FrameError::NoBag),
            (ImageAt::Film(path, number), _) => {
                let film = match &mut self.film {
                    Some(film) => film,
                    None => self.film.insert(Film::open(path).map_err(|e| FrameError::Film(e.to_string()))?),
                };
                film.image(*number).ok_or(FrameError::FilmEnded(*number))
            }
            (ImageAt::Half(path, side), _) => self.half(path, *side, k, bits),
        }
    }

    /// A picture that is marked as turned is turned where only then it has the size of its camera.
    fn as_calibrated(&self, k: usize, path: &Path, image: GrayImage) -> GrayImage {
        let camera = self.rig.cameras.get(k).map(|c| &c.camera);
        let orientation = camera.and_then(|camera| to_turn(camera, path, [image.width(), image.height()]));
        orientation.and_then(|orientation| exif::upright(&image, orientation)).unwrap_or(image)
    }

    /// One half of a file, as the `k`-th camera has it; both are of one reading.
    fn half(&mut self, path: &Path, side: usize, k: usize, bits: u32) -> Result<GrayImage, FrameError> {
        let both = match self.both.take().filter(|(of, _)| of == path) {
            Some((_, image)) => image,
            None => decode::gray_of_bits(path, bits)?,
        };
        let half = halves::half(&both, side, &self.rig.cameras[k].camera);
        self.both = Some((path.to_owned(), both));
        Ok(half)
    }

    fn decode(&mut self, instant: &Instant) -> Result<Decoded, FrameError> {
        let mut images = Vec::with_capacity(instant.images.len());
        for (k, at) in instant.images.iter().enumerate() {
            let image = self.image(k, at)?;
            let Some(c) = self.rig.cameras.get(k) else { break };
            fits(&c.name, &c.camera, image.width(), image.height())?;
            images.push(Arc::new(image));
        }
        let depth = match (&instant.depth, &self.rig.depth) {
            (Some(at), Some(sensor)) => {
                let mut image = match (at, &mut self.bag) {
                    (ImageAt::File(path), _) => decode::depth(path)?,
                    (ImageAt::Message(topic, entry), Some(bag)) => bag.depth(*topic, entry)?,
                    (ImageAt::Message(..), None) => return Err(FrameError::NoBag),
                    (ImageAt::Film(..) | ImageAt::Half(..), _) => return Err(FrameError::NoDepth),
                };
                fits("depth", &sensor.camera, image.width(), image.height())?;
                if let Some(none) = self.no_depth {
                    image.data_mut().iter_mut().filter(|d| **d == none).for_each(|d| *d = 0);
                }
                Some(Arc::new(image))
            }
            _ => None,
        };
        Ok((images, depth))
    }
}

impl Source for Player {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        while let Some(instant) = self.instants.next() {
            if let Some(packet) = self.read(&instant) {
                return Ok(Some(packet));
            }
        }
        // What waited for an image after it.
        self.merge.end(Stream::Camera(0));
        if let Some(packet) = self.merged(0.0) {
            return Ok(Some(packet));
        }
        let without = self.merge.counts().without_imu;
        if without > 0 && !std::mem::replace(&mut self.ended, true) {
            let why = "no IMU sample at or after the image";
            self.note(vec![Skipped::new(SkipKind::Imu, why, format!("{without} instants have {why}"))]);
            self.skips.add_many(SkipKind::Imu, why, without - 1, "");
        }
        Ok(None)
    }

    fn skipped(&self) -> &[String] {
        &self.skipped
    }

    fn skips(&self) -> Skips {
        self.skips.clone()
    }
}

/// Why an image of an instant cannot be used.
#[derive(Debug, thiserror::Error)]
enum FrameError {
    #[error(transparent)]
    Image(#[from] decode::ImageError),
    #[error(transparent)]
    Message(#[from] MessageError),
    #[error("the bag of this message is not open")]
    NoBag,
    #[error("{0}")]
    Film(String),
    #[error("the film ends before its picture {0}")]
    FilmEnded(usize),
    #[error("there is no depth in a film or in half a picture")]
    NoDepth,
    #[error("{name} has {width}x{height} pixels, the rig says {}x{}", rig[0], rig[1])]
    Size { name: String, width: usize, height: usize, rig: [usize; 2] },
}

/// How many bits of 16 the pixels of a camera's files use, in a few of them: by the high byte alone pictures of 10 bits would be
/// black.
fn bits_in_use(instants: &[Instant], camera: usize) -> u32 {
    const LOOKED_AT: usize = 8;
    let some = instants.iter().step_by(instants.len().div_ceil(LOOKED_AT).max(1));
    let bits = some.filter_map(|instant| match instant.images.get(camera)? {
        ImageAt::File(path) | ImageAt::Half(path, _) => decode::bits(path),
        ImageAt::Message(..) | ImageAt::Film(..) => None,
    });
    bits.max().unwrap_or(16)
}

/// Width and height of an image.
fn size(at: &ImageAt, bag: &mut Option<BagReader>) -> Result<[usize; 2], FrameError> {
    match (at, bag) {
        (ImageAt::File(path), _) => Ok(decode::size(path)?),
        (ImageAt::Message(topic, entry), Some(bag)) => Ok(bag.size(*topic, entry)?),
        (ImageAt::Message(..), None) => Err(FrameError::NoBag),
        (ImageAt::Film(path, _), _) => {
            Film::open(path).map(|film| film.size()).map_err(|e| FrameError::Film(e.to_string()))
        }
        (ImageAt::Half(path, _), _) => Ok(decode::size(path)?),
    }
}

type Decoded = (Vec<Arc<GrayImage>>, Option<Arc<DepthImage>>);

/// The orientation of a file whose picture has the size of a camera only when it is turned by a quarter.
fn to_turn(camera: &Camera, path: &Path, [width, height]: [usize; 2]) -> Option<u16> {
    let is_turned = width != height && (camera.height, camera.width) == (width, height);
    if is_turned {
        decode::orientation(path).filter(|orientation| matches!(orientation, 6 | 8))
    } else {
        None
    }
}

fn fits(name: &str, camera: &Camera, width: usize, height: usize) -> Result<(), FrameError> {
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    Err(FrameError::Size { name: name.to_owned(), width, height, rig: [camera.width, camera.height] })
}

/// Depth registered to the first camera, but in images of another size: its camera becomes the same with smaller or larger
/// pixels. Where the sides have another ratio nothing is changed.
fn depth_of_another_size(
    rig: &mut Rig,
    instants: &[Instant],
    bag: &mut Option<BagReader>,
) -> Option<Skipped> {
    let depth = rig.depth.as_mut().filter(|d| d.registered)?;
    let first = instants.iter().filter_map(|i| i.depth.as_ref()).find_map(|at| size(at, bag).ok());
    let ([w, h], like) = (first?, depth.camera);
    if (w, h) == (like.width, like.height) || w * like.height != h * like.width {
        return None;
    }
    let by = w as f64 / like.width as f64;
    let centre = |c: f64| (c + 0.5) * by - 0.5;
    let (cx, cy) = (centre(like.cx), centre(like.cy));
    depth.camera = Camera { width: w, height: h, fx: like.fx * by, fy: like.fy * by, cx, cy, ..like };
    depth.registered = false;
    let text = format!(
        "depth has {w}x{h} pixels, colour {}x{}: taken as of the same camera",
        like.width, like.height
    );
    Some(Skipped::new(SkipKind::Other, "depth has another size than colour", text))
}

/// The first readable image of each camera must be of the rig's size; a recording without any is an error.
fn check_sizes(
    name: &str,
    rig: &Rig,
    instants: &[Instant],
    bag: &mut Option<BagReader>,
) -> Result<(), SourceError> {
    let cameras = rig.cameras.iter().enumerate().map(|(i, c)| (c.name.as_str(), &c.camera, Some(i)));
    let depth = rig.depth.iter().map(|d| ("depth", &d.camera, None));
    for (camera_name, camera, index) in cameras.chain(depth) {
        let mut first_problem = None;
        let mut files = instants.iter().filter_map(|i| match index {
            Some(index) => i.images.get(index),
            None => i.depth.as_ref(),
        });
        let found = files.find_map(|at| match size(at, bag) {
            Ok(size) => Some((at, size)),
            Err(e) => {
                first_problem.get_or_insert(e);
                None
            }
        });
        match found {
            // They are two of these cameras by their size.
            Some((ImageAt::Half(..), _)) => {}
            Some((ImageAt::File(path), size)) if to_turn(camera, path, size).is_some() => {}
            Some((at, [w, h])) => fits(camera_name, camera, w, h).map_err(|why| {
                let what = match at {
                    ImageAt::File(path) | ImageAt::Film(path, _) | ImageAt::Half(path, _) => {
                        path.display().to_string()
                    }
                    ImageAt::Message(..) => name.to_owned(),
                };
                SourceError::new(what, why.to_string(), "give the rig of these images with --rig")
            })?,
            None if index.is_none() && first_problem.is_none() => {} // a rig with depth, a recording without
            None => {
                return Err(SourceError::new(
                    name,
                    format!(
                        "not a single image of {camera_name} can be read (the first: {})",
                        first_problem.map_or_else(|| "none is listed".into(), |why| why.to_string())
                    ),
                    "check that the image files exist and are complete",
                ));
            }
        }
    }
    Ok(())
}
