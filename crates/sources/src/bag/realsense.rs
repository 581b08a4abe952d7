//! Recordings of the RealSense SDK: rosbag1 with topics `/device_0/sensor_N/STREAM_N/...`.
//!
//! After the SDK's own page on recording (librealsense, `src/media/readme.md`): `image/data`, `imu/data`,
//! `info/camera_info` (factory intrinsics, most with inverse Brown-Conrady), `tf/0` (from the reference of the device to the
//! stream, so that `p_stream = R p_reference + t`), `option/Depth Units/value` (metres per unit). Stamps of headers are the
//! device's. No recording of a real device was at hand: the tests write files in this layout.

use super::frames::Frames;
use super::topics::Chosen;
use crate::bag_reader::{BagReader, ImuTopics, MessageError};
use cairn_bag::{float32, transform};

/// Metres per unit where the recording does not tell.
const USUAL_DEPTH_UNIT: f64 = 0.001;

/// What the SDK recorded beside the streams.
pub struct Recorder {
    /// Where the streams are, by [`stream`].
    pub frames: Frames,
    /// Metres per unit of the depth images, and whether that was assumed.
    pub depth_unit: (f64, bool),
    /// Whether the projector of the infrared pattern was on.
    emitter: bool,
}

/// The name of a stream: its topics without `image/data` and the like.
pub fn stream(topic: &str) -> &str {
    ["/image/data", "/imu/data"].iter().find_map(|end| topic.strip_suffix(end)).unwrap_or(topic)
}

impl Recorder {
    /// What is recorded beside the streams; `None` if the SDK did not write the bag.
    pub fn of(bag: &BagReader) -> Option<Self> {
        let is_stream = |name: &str| name.starts_with("/device_") && name.ends_with("/image/data");
        bag.topics().iter().any(|t| is_stream(&t.name)).then(|| Self {
            frames: Frames::default(),
            depth_unit: (USUAL_DEPTH_UNIT, true),
            emitter: false,
        })
    }

    /// Reads extrinsics and options; messages that cannot be read are listed in `skipped`.
    pub fn read(&mut self, bag: &mut BagReader, skipped: &mut Vec<String>) {
        for topic in 0..bag.topics().len() {
            let Some(about) = bag.topics().get(topic).filter(|t| !t.entries.is_empty()) else { continue };
            let (name, format) = (about.name.clone(), about.format);
            let bytes = bag.message(topic, 0);
            let fail = |e: &dyn std::fmt::Display| format!("{name}: {e}");
            if let Some((stream, group)) = name.split_once("/tf/") {
                match bytes.and_then(|b| Ok(transform(format, &b)?)) {
                    Ok(stream_from_reference) => {
                        self.frames.add(stream, &format!("reference {group}"), stream_from_reference);
                    }
                    Err(e) => skipped.push(fail(&e)),
                }
                continue;
            }
            let option = name.to_ascii_lowercase().replace('_', " ");
            let value = |b: Vec<u8>| Ok::<_, MessageError>(float32(format, &b)?);
            if option.ends_with("/option/depth units/value") {
                match bytes.and_then(value) {
                    Ok(unit) if unit.is_finite() && unit > 0.0 => self.depth_unit = (round_unit(unit), false),
                    Ok(unit) => skipped.push(fail(&format_args!("a depth unit of {unit} m is none"))),
                    Err(e) => skipped.push(fail(&e)),
                }
            } else if option.ends_with("/option/emitter enabled/value") {
                self.emitter = bytes.and_then(value).is_ok_and(|v| v != 0.0);
            }
        }
    }

    /// The streams to use: colour (else the left infrared) with depth, without depth the infrared pair, else one camera.
    pub fn chosen(&self, bag: &mut BagReader) -> Chosen {
        let find = |what: &str| {
            let fits = |name: &str| {
                name.contains(what) && (name.ends_with("/image/data") || name.ends_with("/imu/data"))
            };
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

/// The unit as the device means it: the SDK stores 0.001 as a 32-bit number.
fn round_unit(unit: f32) -> f64 {
    format!("{unit}").parse().unwrap_or(f64::from(unit))
}
