//! Recordings of the RealSense SDK: topics `/device_0/sensor_N/STREAM_N/...`.
//!
//! Three forms: rosbag1 until 2.57 (`image/data`, `info/camera_info`, `tf/0`, values of options as numbers); SQLite of 2.58,
//! each message a zstd frame, what describes the camera as text; SQLite since 2.59, images as PNG in `image/data/compressed`
//! and `image/data/compressedDepth`. Its `image/camera_info` calls every lens but one `plumb_bob`, so the text
//! `camera_info` of the stream is what counts. Extrinsics are from the reference of the device to the stream
//! (`p_stream = R p_reference + t`); the depth unit is `option/Depth_Units/value`, metres per unit. After the SDK's own page on
//! recording (librealsense, `src/media/readme.md`) and files that 2.57, 2.58 and 2.59 recorded of a software device.

mod clock;
mod text;

pub use clock::restamp;

use super::frames::Frames;
use super::topics::Chosen;
use crate::bag_reader::{BagReader, ImuTopics, MessageError};
use cairn_bag::{CameraInfo, WireFormat, float32, transform};
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SourceError};
use std::collections::BTreeMap;

/// Ends of topics with frames.
const DATA: [&str; 4] = ["/image/data", "/image/data/compressed", "/image/data/compressedDepth", "/imu/data"];

/// Units of depth that differ by this part are different ones: 0.0001 m or 0.001 m. A scale that somebody corrected is not.
const SAME_UNIT: f64 = 0.1;

/// What the SDK recorded beside the streams.
pub struct Recorder {
    /// Where the streams are, by [`stream`].
    pub frames: Frames,
    /// The intrinsics that are text, by stream.
    intrinsics: BTreeMap<String, CameraInfo>,
    /// Metres per unit of depth images, by sensor or stream, in order of recording.
    units: Vec<(String, f64)>,
    /// Whether the projector of the infrared pattern was on.
    emitter: bool,
}

/// The name of a stream: its topics without `image/data` and the like.
pub fn stream(topic: &str) -> &str {
    DATA.iter().find_map(|end| topic.strip_suffix(end)).unwrap_or(topic)
}

fn is_stream(topic: &str) -> bool {
    topic.starts_with("/device_") && DATA.iter().any(|end| topic.ends_with(end))
}

impl Recorder {
    /// What is recorded beside the streams; `None` if the SDK did not write the bag. Messages that cannot be read are listed
    /// in `skipped`.
    pub fn of(bag: &mut BagReader, skipped: &mut Vec<String>) -> Option<Self> {
        if !bag.topics().iter().any(|t| is_stream(&t.name)) {
            return None;
        }
        let (frames, intrinsics) = (Frames::default(), BTreeMap::new());
        let mut out = Self { frames, intrinsics, units: Vec::new(), emitter: false };
        for topic in 0..bag.topics().len() {
            let Some((name, count)) = bag.topics().get(topic).map(|t| (t.name.clone(), t.entries.len()))
            else {
                continue;
            };
            if count > 0
                && name.starts_with("/device_")
                && let Err(why) = out.read(bag, topic, &name, count)
            {
                skipped.push(format!("{name}: {why}"));
            }
        }
        Some(out)
    }

    fn read(
        &mut self,
        bag: &mut BagReader,
        topic: usize,
        name: &str,
        count: usize,
    ) -> Result<(), MessageError> {
        if let Some((stream, group)) = name.split_once("/tf/") {
            let stream_from_reference = extrinsics(bag, topic)?;
            self.frames.add(stream, &format!("reference {group}"), stream_from_reference);
        } else if let Some(stream) = name.strip_suffix("/image/metadata") {
            if is_text(bag, topic)
                && let Some(unit) = text::value(&bag.text(topic, 0)?, "depth_units")
            {
                self.add_unit(stream, unit.parse().unwrap_or(0.0));
            }
        } else if let Some(stream) = name.strip_suffix("/camera_info") {
            if is_text(bag, topic) {
                self.intrinsics.insert(stream.to_owned(), text::camera_info(&bag.text(topic, 0)?)?);
            }
        } else if let Some((sensor, option)) = name.split_once("/option/") {
            match option.to_ascii_lowercase().replace('_', " ").as_str() {
                "depth units/value" => {
                    for number in 0..count {
                        let unit = value(bag, topic, number)?;
                        self.add_unit(sensor, unit);
                    }
                }
                "emitter enabled/value" => self.emitter = value(bag, topic, 0)? != 0.0,
                _ => {}
            }
        }
        Ok(())
    }

    /// Keeps a unit; one that is no unit is as good as none.
    fn add_unit(&mut self, of: &str, unit: f32) {
        if unit.is_finite() && unit > 0.0 {
            self.units.push((of.to_owned(), round_unit(unit)));
        }
    }

    /// The intrinsics of a stream, where they are text.
    pub fn intrinsics(&self, stream: &str) -> Option<&CameraInfo> {
        self.intrinsics.get(stream)
    }

    /// The units that are recorded for a depth stream.
    fn units(&self, topic: &str) -> impl Iterator<Item = f64> {
        let stream = stream(topic);
        let of_stream =
            |of: &str| stream.strip_prefix(of).is_some_and(|r| r.is_empty() || r.starts_with('/'));
        self.units.iter().filter(move |(of, _)| of_stream(of)).map(|(_, unit)| *unit)
    }

    /// Metres per unit of a depth stream; an error where it is not recorded, or was changed meanwhile.
    pub fn depth_unit(&self, shown: &str, topic: &str) -> Result<f64, SourceError> {
        let mut units = self.units(topic);
        let Some(first) = units.next() else {
            let why = format!("{topic}: how many metres a unit of its depth is, is not recorded");
            let cure = "give --rig FILE with metres_per_unit under [depth] (0.001 for a D400 as delivered)";
            return Err(SourceError::new(shown, why, cure));
        };
        match units.find(|unit| is_other(*unit, first)) {
            None => Ok(first),
            Some(other) => {
                let why = format!("{topic}: the unit of its depth changes from {first} m to {other} m");
                Err(SourceError::new(shown, why, "record it again without changing Depth Units"))
            }
        }
    }

    /// Refuses a rig whose unit of depth is another than the recording's.
    pub fn check(&self, shown: &str, rig: &Rig, topic: &str) -> Result<(), SourceError> {
        let Some(sensor) = rig.depth.as_ref().filter(|_| self.units(topic).next().is_some()) else {
            return Ok(());
        };
        let unit = self.depth_unit(shown, topic)?;
        if !is_other(sensor.metres_per_unit, unit) {
            return Ok(());
        }
        let why =
            format!("{topic}: a unit of its depth is {unit} m, the rig says {} m", sensor.metres_per_unit);
        let cure = format!("write metres_per_unit = {unit} under [depth] of the rig, or leave --rig away");
        Err(SourceError::new(shown, why, cure))
    }

    /// The streams to use: colour (else the left infrared) with depth, without depth the infrared pair, else one camera.
    pub fn chosen(&self, bag: &mut BagReader) -> Chosen {
        let find = |what: &str| {
            let fits = |name: &str| is_stream(name) && name.contains(what);
            bag.topics().iter().position(|t| fits(&t.name) && !t.entries.is_empty())
        };
        let (left, right) = (find("/Infrared_1/"), find("/Infrared_2/"));
        let (colour, depth) = (find("/Color_0/"), find("/Depth_0/"));
        let only = find("/Infrared_0/").or(left);
        let (cameras, depth) = match (colour.or(only), depth) {
            (Some(camera), Some(depth)) => (vec![camera], Some(depth)),
            (camera, _) => match (left, right) {
                (Some(left), Some(right)) => (vec![left, right], None),
                _ => (camera.into_iter().collect(), None),
            },
        };
        let imu = match (find("/Gyro_0/"), find("/Accel_0/")) {
            (Some(gyro), Some(accel)) => ImuTopics::Split { gyro, accel },
            _ => ImuTopics::None,
        };
        Chosen { cameras, depth, imu, info: [None; 3] }
    }

    /// What to say of an infrared pair, if it was lit by the projector.
    pub fn doubt(&self) -> Option<String> {
        self.emitter.then(|| {
            "the projector was on: its dots move with the camera and disturb tracking in the infrared images".to_owned()
        })
    }
}

fn is_text(bag: &BagReader, topic: usize) -> bool {
    bag.topics().get(topic).is_some_and(|t| t.kind == "std_msgs/String")
}

fn format(bag: &BagReader, topic: usize) -> WireFormat {
    bag.topics().get(topic).map_or(WireFormat::Other, |t| t.format)
}

fn extrinsics(bag: &mut BagReader, topic: usize) -> Result<Se3, MessageError> {
    if is_text(bag, topic) {
        return Ok(text::stream_from_reference(&bag.text(topic, 0)?)?);
    }
    let format = format(bag, topic);
    Ok(transform(format, &bag.message(topic, 0)?)?)
}

/// The value of an option: a number, or a text of one; 0 where that text is none.
fn value(bag: &mut BagReader, topic: usize, number: usize) -> Result<f32, MessageError> {
    if is_text(bag, topic) {
        return Ok(bag.text(topic, number)?.trim().parse().unwrap_or(0.0));
    }
    let format = format(bag, topic);
    Ok(float32(format, &bag.message(topic, number)?)?)
}

fn is_other(unit: f64, than: f64) -> bool {
    (unit / than - 1.0).abs() > SAME_UNIT
}

/// The unit as the device means it: the SDK stores 0.001 as a 32-bit number.
fn round_unit(unit: f32) -> f64 {
    format!("{unit}").parse().unwrap_or(f64::from(unit))
}
