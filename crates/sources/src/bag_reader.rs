//! Reads the images and samples of a bag.

use crate::decode::{self, ImageError};
use cairn_bag::{
    Bag, BagError, CameraInfo, CompressedImage, DecodeError, Entry, ImageMessage, ImuMessage, MessageKind,
    Topic, string,
};
use cairn_geometry::Vec3;
use cairn_sensor::{DepthImage, GrayImage, ImuSample, SkipKind, Skipped, Stamp};
use std::collections::BTreeMap;

/// Why a message of a bag cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MessageError {
    /// The bag has no topic of that number.
    #[error("there is no such topic")]
    NoTopic,
    /// The topic has no message of that number.
    #[error("there is no such message")]
    NoMessage,
    /// The topic has no message at all.
    #[error("it has no message")]
    Empty,
    /// It cannot be read from the file.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// Its bytes are not a message of its type.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// Its image is damaged, or none that can be used.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Its image is damaged or of another kind than is read, and this is what the message calls it.
    #[error("compressed as \"{format}\": {why}")]
    Format {
        /// The format by its message.
        format: String,
        /// What is wrong.
        why: ImageError,
    },
    /// The same of a message of this topic.
    #[error("{topic}: {why}")]
    OfTopic {
        /// The topic's name.
        topic: String,
        /// What is wrong with the message.
        why: Box<Self>,
    },
}

/// A reading whose message cannot be read.
fn unreadable(text: String) -> Skipped {
    Skipped::new(SkipKind::Imu, "the message cannot be read", text)
}

/// A bag whose messages are images and samples.
pub struct BagReader {
    bag: Bag,
    /// Bits in use of the pixels of topics that have 16.
    bits: BTreeMap<usize, u32>,
}

/// The topics of the IMU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImuTopics {
    /// There is none.
    None,
    /// Both sensors in one message.
    One(usize),
    /// Two topics of different rates.
    Split {
        /// The gyroscope's.
        gyro: usize,
        /// The accelerometer's.
        accel: usize,
    },
}

/// An image of either kind.
enum Picture<'a> {
    Raw(ImageMessage<'a>),
    File(CompressedImage<'a>),
}

/// What the first message of an image topic tells.
pub struct FirstImage {
    /// Frame of its header, without a leading slash.
    pub frame: String,
    /// Encoding of raw images, format of compressed ones.
    pub encoding: String,
}

impl BagReader {
    /// Reads an opened bag.
    pub fn new(bag: Bag) -> Self {
        Self { bag, bits: BTreeMap::new() }
    }

    /// Its topics.
    pub fn topics(&self) -> &[Topic] {
        self.bag.topics()
    }

    /// The bytes of a message of a topic, by its number.
    pub fn message(&mut self, topic: usize, number: usize) -> Result<Vec<u8>, MessageError> {
        let entry = self.topics().get(topic).and_then(|t| t.entries.get(number)).copied();
        let entry = entry.ok_or(MessageError::NoMessage)?;
        Ok(self.bag.read(&entry)?)
    }

    /// The text of a message of `std_msgs/String`.
    pub fn text(&mut self, topic: usize, number: usize) -> Result<String, MessageError> {
        let format = self.topics().get(topic).ok_or(MessageError::NoTopic)?.format;
        Ok(string(format, &self.message(topic, number)?)?)
    }

    /// Gives the messages of a topic other stamps; those without one are left out.
    pub fn restamp(&mut self, topic: usize, stamp_of: impl FnMut(&Entry) -> Option<i64>) {
        self.bag.restamp(topic, stamp_of);
    }

    fn picture<T>(
        &mut self,
        topic: usize,
        entry: &Entry,
        of: impl FnOnce(&Picture) -> Result<T, MessageError>,
    ) -> Result<T, MessageError> {
        let about = self.topics().get(topic).ok_or(MessageError::NoTopic)?;
        let (name, kind, format) = (about.name.clone(), about.kind.clone(), about.format);
        let bytes = self.bag.read(entry)?;
        let picture = match MessageKind::of(&kind) {
            MessageKind::Image => ImageMessage::of(&kind, format, &bytes).map(Picture::Raw),
            _ => CompressedImage::of(&kind, format, &bytes).map(Picture::File),
        };
        (picture.map_err(MessageError::from).and_then(|p| of(&p)))
            .map_err(|why| MessageError::OfTopic { topic: name, why: Box::new(why) })
    }

    /// Finds how many of 16 bits the pixels of a topic use, in a few of its images: by the high byte alone pictures of 10 bits
    /// would be black. Where that is fewer, a word on it.
    pub fn find_bits(&mut self, topic: usize) -> Option<String> {
        const LOOKED_AT: usize = 8;
        let entries = self.topics().get(topic)?.entries.clone();
        let bits = |picture: &Picture| match picture {
            Picture::Raw(image) => Ok(image.bits()),
            Picture::File(_) => Ok(None),
        };
        let some = entries.iter().step_by(entries.len().div_ceil(LOOKED_AT).max(1));
        let most = some.filter_map(|entry| self.picture(topic, entry, bits).ok().flatten()).max()?;
        self.bits.insert(topic, most);
        let name = self.topics().get(topic).map_or("", |t| t.name.as_str());
        (most < 16).then(|| {
            format!("{name}: of the 16 bits of a pixel {most} are in use, white is {}", (1u32 << most) - 1)
        })
    }

    /// Luminance of an image.
    pub fn gray(&mut self, topic: usize, entry: &Entry) -> Result<GrayImage, MessageError> {
        let bits = self.bits.get(&topic).copied().unwrap_or(16);
        self.picture(topic, entry, |picture| match picture {
            Picture::Raw(image) => Ok(image.gray_of_bits(bits)?),
            Picture::File(image) => decode::gray_in(image.data)
                .map_err(|why| MessageError::Format { format: image.format.clone(), why }),
        })
    }

    /// A depth image, in units of its topic.
    pub fn depth(&mut self, topic: usize, entry: &Entry) -> Result<DepthImage, MessageError> {
        self.picture(topic, entry, |picture| match picture {
            Picture::Raw(image) => Ok(image.depth()?),
            Picture::File(image) => {
                let mut depth = match image.rvl() {
                    Some(depth) => depth?,
                    None => decode::depth_in(image.file()?)?,
                };
                image.dequantise(&mut depth);
                Ok(depth)
            }
        })
    }

    /// Width and height.
    pub fn size(&mut self, topic: usize, entry: &Entry) -> Result<[usize; 2], MessageError> {
        self.picture(topic, entry, |picture| match picture {
            Picture::Raw(image) => Ok([image.width as usize, image.height as usize]),
            Picture::File(image) => match image.rvl() {
                Some(depth) => depth.map(|d| [d.width(), d.height()]).map_err(MessageError::from),
                None => decode::size_in(image.file()?)
                    .map_err(|why| MessageError::Format { format: image.format.clone(), why }),
            },
        })
    }

    /// What the first readable image of a topic tells; a topic without any is an error.
    pub fn first_image(&mut self, topic: usize) -> Result<FirstImage, MessageError> {
        let entries =
            self.topics().get(topic).map_or(Vec::new(), |t| t.entries.iter().take(20).copied().collect());
        let mut first = None;
        for entry in entries {
            let look = self.picture(topic, &entry, |picture| {
                let (header, encoding) = match picture {
                    Picture::Raw(image) => (&image.header, &image.encoding),
                    Picture::File(image) => (&image.header, &image.format),
                };
                let frame = header.frame_id.trim_start_matches('/').to_owned();
                Ok(FirstImage { frame, encoding: encoding.clone() })
            });
            match look {
                Ok(look) => return Ok(look),
                Err(why) => first = first.or(Some(why)),
            }
        }
        Err(first.unwrap_or(MessageError::Empty))
    }

    /// The first calibration on a topic.
    pub fn camera_info(&mut self, topic: usize) -> Result<CameraInfo, MessageError> {
        let about = self.topics().get(topic).ok_or(MessageError::NoTopic)?;
        let (kind, format) = (about.kind.clone(), about.format);
        Ok(CameraInfo::of(&kind, format, &self.message(topic, 0)?)?)
    }

    /// A message of an IMU.
    fn imu(&mut self, topic: usize, number: usize) -> Result<ImuMessage, MessageError> {
        let format = self.topics().get(topic).map_or(cairn_bag::WireFormat::Other, |t| t.format);
        let bytes = self.message(topic, number)?;
        Ok(ImuMessage::decode(format, &bytes)?)
    }

    /// The frame of an IMU.
    pub fn imu_frame(&mut self, topic: usize) -> Option<String> {
        self.imu(topic, 0).ok().map(|m| m.header.frame_id.trim_start_matches('/').to_owned())
    }
}

/// The median step between stamps, nanoseconds; of the first 500.
pub fn median_step_ns(stamps: impl Iterator<Item = i64>) -> u64 {
    let stamps: Vec<i64> = stamps.take(501).collect();
    let steps = stamps.windows(2).map(|w| w[1].saturating_sub(w[0])).filter(|s| *s > 0);
    let mut steps: Vec<u64> = steps.map(i64::unsigned_abs).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).copied().unwrap_or(0)
}

/// The samples of a bag, one after the other.
pub struct BagImu {
    topics: ImuTopics,
    /// The next message (of the gyroscope).
    next: usize,
    /// The next message of an accelerometer with a topic of its own, and its last two readings.
    next_accel: usize,
    accel: [Option<(i64, Vec3)>; 2],
}

impl BagImu {
    /// From the first sample.
    pub fn new(topics: ImuTopics) -> Self {
        Self { topics, next: 0, next_accel: 0, accel: [None, None] }
    }

    /// The number of the last message read, for messages.
    pub fn place(&self) -> String {
        format!("IMU message {}", self.next)
    }

    /// The next sample; messages that cannot be read are listed in `skipped`. `None` at the end.
    pub fn next(&mut self, bag: &mut BagReader, skipped: &mut Vec<Skipped>) -> Option<ImuSample> {
        let (gyro, accel) = match self.topics {
            ImuTopics::None => return None,
            ImuTopics::One(topic) => (topic, None),
            ImuTopics::Split { gyro, accel } => (gyro, Some(accel)),
        };
        loop {
            let entry = bag.topics().get(gyro)?.entries.get(self.next).copied()?;
            let message = bag.imu(gyro, self.next);
            self.next += 1;
            let message = match message {
                Ok(message) => message,
                Err(why) => {
                    skipped.push(unreadable(format!("{}: {why}, sample dropped", self.place())));
                    continue;
                }
            };
            let Some(accel) = accel else { return Some(message.sample(entry.stamp_ns)) };
            match self.accel_at(entry.stamp_ns, accel, bag, skipped) {
                Accel::At(value) => return Some(ImuSample::new(Stamp(entry.stamp_ns), message.gyro, value)),
                Accel::NotYet => {}
                Accel::Ended => return None,
            }
        }
    }

    /// The accelerometer's reading at the time of one of the gyroscope, between its two nearest.
    fn accel_at(&mut self, at: i64, topic: usize, bag: &mut BagReader, skipped: &mut Vec<Skipped>) -> Accel {
        loop {
            if let [Some((t0, a0)), Some((t1, a1))] = self.accel
                && at <= t1
            {
                if at < t0 {
                    return Accel::NotYet;
                }
                let part = (at - t0) as f64 / (t1 - t0) as f64;
                return Accel::At(a0 + (a1 - a0) * part);
            }
            let Some(entry) = bag.topics().get(topic).and_then(|t| t.entries.get(self.next_accel).copied())
            else {
                return Accel::Ended;
            };
            let message = bag.imu(topic, self.next_accel);
            self.next_accel += 1;
            match message {
                Ok(m) if self.accel[1].is_none_or(|(last, _)| entry.stamp_ns > last) => {
                    self.accel = [self.accel[1], Some((entry.stamp_ns, m.accel))];
                }
                Ok(_) => {
                    let why = "the time does not increase";
                    let text = format!("accelerometer message {}: {why}, sample dropped", self.next_accel);
                    skipped.push(Skipped::new(SkipKind::Imu, why, text));
                }
                Err(why) => {
                    let at = self.next_accel;
                    skipped.push(unreadable(format!("accelerometer message {at}: {why}, sample dropped")));
                }
            }
        }
    }
}

enum Accel {
    At(Vec3),
    /// The gyroscope began before the accelerometer.
    NotYet,
    Ended,
}
