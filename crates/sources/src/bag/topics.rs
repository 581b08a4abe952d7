//! Which topic of a bag is which sensor.
//!
//! Named by the user, or found: topics of images by their types, depth by its encoding or name, a stereo pair by two names
//! that differ in left and right or in one digit, the IMU by its type. What could be meant in two ways is an error that
//! lists the topics.

use crate::bag_reader::{BagReader, ImuTopics, MessageError};
use cairn_bag::{MessageKind, Topic, WireFormat};
use cairn_sensor::SourceError;
use std::str::FromStr;

/// A sensor, or the calibration of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TopicRole {
    /// The images of the only or left camera.
    Left,
    /// The images of the right camera.
    Right,
    /// Depth images.
    Depth,
    /// Gyroscope and accelerometer.
    Imu,
    /// The gyroscope alone.
    Gyro,
    /// The accelerometer alone.
    Accel,
    /// `camera_info` of the left camera.
    LeftInfo,
    /// `camera_info` of the right camera.
    RightInfo,
    /// `camera_info` of the depth sensor.
    DepthInfo,
    /// Poses of the body by another system, to compare with.
    Truth,
}

const ROLES: [(&str, TopicRole); 10] = [
    ("left", TopicRole::Left),
    ("right", TopicRole::Right),
    ("depth", TopicRole::Depth),
    ("imu", TopicRole::Imu),
    ("gyro", TopicRole::Gyro),
    ("accel", TopicRole::Accel),
    ("left-info", TopicRole::LeftInfo),
    ("right-info", TopicRole::RightInfo),
    ("depth-info", TopicRole::DepthInfo),
    ("truth", TopicRole::Truth),
];

/// A topic named for a sensor, written `left=/cam0/image_raw`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedTopic {
    /// The sensor.
    pub role: TopicRole,
    /// The topic.
    pub topic: String,
}

/// Why a text names no topic.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NamedTopicError {
    /// It has another form.
    #[error("write SENSOR=TOPIC; sensors are {}", roles())]
    Form,
    /// There is no such sensor.
    #[error("\"{0}\" is no sensor; known are {known}", known = roles())]
    Sensor(String),
    /// Nothing follows the sensor.
    #[error("the topic is empty")]
    Empty,
}

fn roles() -> String {
    ROLES.map(|(name, _)| name).join(", ")
}

impl FromStr for NamedTopic {
    type Err = NamedTopicError;

    fn from_str(text: &str) -> Result<Self, NamedTopicError> {
        let (role, topic) = text.split_once('=').ok_or(NamedTopicError::Form)?;
        let found = ROLES.iter().find(|(name, _)| *name == role);
        let (_, role) = found.ok_or_else(|| NamedTopicError::Sensor(role.to_owned()))?;
        if topic.is_empty() {
            return Err(NamedTopicError::Empty);
        }
        Ok(Self { role: *role, topic: topic.to_owned() })
    }
}

/// Indices of the topics that are read.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// One or two cameras, the left first.
    pub cameras: Vec<usize>,
    /// Depth images.
    pub depth: Option<usize>,
    /// The IMU.
    pub imu: ImuTopics,
    /// `camera_info` of the cameras and of the depth sensor, where named.
    pub info: [Option<usize>; 3],
}

impl Chosen {
    /// The topics of all sensors.
    pub fn sensors(&self) -> Vec<usize> {
        let imu = match self.imu {
            ImuTopics::None => vec![],
            ImuTopics::One(topic) => vec![topic],
            ImuTopics::Split { gyro, accel } => vec![gyro, accel],
        };
        self.cameras.iter().copied().chain(self.depth).chain(imu).collect()
    }

    /// The names, for people.
    pub fn text(&self, topics: &[Topic]) -> String {
        let all = self.sensors().into_iter();
        let names: Vec<&str> = all.filter_map(|i| topics.get(i)).map(|t| t.name.as_str()).collect();
        names.join(", ")
    }
}

/// The topics of the named sensors, and of those found beside them.
pub fn choose(shown: &str, bag: &mut BagReader, named: &[NamedTopic]) -> Result<Chosen, SourceError> {
    let of = |role: TopicRole| -> Result<Option<usize>, SourceError> {
        let Some(name) = named.iter().rev().find(|n| n.role == role).map(|n| n.topic.as_str()) else {
            return Ok(None);
        };
        let found = bag.topics().iter().position(|t| t.name == name && !t.entries.is_empty());
        found.map(Some).ok_or_else(|| {
            let why = format!("has no messages of images, camera_info or an IMU on \"{name}\"");
            SourceError::new(shown, why, format!("its topics are: {}", list(bag.topics(), |_| true)))
        })
    };
    let (left, right, depth) = (of(TopicRole::Left)?, of(TopicRole::Right)?, of(TopicRole::Depth)?);
    let info = [of(TopicRole::LeftInfo)?, of(TopicRole::RightInfo)?, of(TopicRole::DepthInfo)?];
    let imu = match (of(TopicRole::Imu)?, of(TopicRole::Gyro)?, of(TopicRole::Accel)?) {
        (Some(topic), _, _) => ImuTopics::One(topic),
        (None, Some(gyro), Some(accel)) => ImuTopics::Split { gyro, accel },
        (None, None, None) => found_imu(shown, bag.topics())?,
        _ => {
            let cure = "name both with --topic gyro=TOPIC --topic accel=TOPIC";
            return Err(SourceError::new(shown, "only one of gyroscope and accelerometer is named", cure));
        }
    };
    let (cameras, depth) = match (left, right, depth) {
        (Some(left), right, depth) => (std::iter::once(left).chain(right).collect(), depth),
        (None, None, None) => found_images(shown, bag)?,
        _ => {
            let cure = "name the left or only camera too, with --topic left=TOPIC";
            return Err(SourceError::new(
                shown,
                "a right camera or depth is named without a left camera",
                cure,
            ));
        }
    };
    Ok(Chosen { cameras, depth, imu, info })
}

fn is_image(topic: &Topic) -> bool {
    matches!(topic.message_kind(), MessageKind::Image | MessageKind::CompressedImage)
        && topic.format != WireFormat::Other
        && !topic.entries.is_empty()
}

/// Names and types of some topics.
fn list(topics: &[Topic], which: impl Fn(&Topic) -> bool) -> String {
    const SHOWN: usize = 20;
    let all: Vec<String> =
        topics.iter().filter(|t| which(t)).map(|t| format!("{} ({})", t.name, t.kind)).collect();
    match all.len() {
        0 => "none".into(),
        n if n > SHOWN => format!("{} and {} more", all[..SHOWN].join(", "), n - SHOWN),
        _ => all.join(", "),
    }
}

/// The name without the transport of compressed images, and its namespace.
fn base(name: &str) -> (&str, &str) {
    let base =
        ["/compressed", "/compressedDepth"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
    (base, base.rsplit_once('/').map_or("", |(space, _)| space))
}

/// The namespace of a topic of images, in which its `camera_info` is.
pub fn namespace(name: &str) -> &str {
    base(name).1
}

fn found_images(shown: &str, bag: &mut BagReader) -> Result<(Vec<usize>, Option<usize>), SourceError> {
    let mut candidates: Vec<usize> =
        (0..bag.topics().len()).filter(|i| bag.topics().get(*i).is_some_and(is_image)).collect();
    if candidates.is_empty() {
        let why = "has no images of a type that is read (sensor_msgs/Image, sensor_msgs/CompressedImage, those of Foxglove)";
        let cure = format!("its topics are: {}", list(bag.topics(), |_| true));
        return Err(SourceError::new(shown, why, cure));
    }
    let encodings: Vec<(usize, Result<String, MessageError>)> =
        candidates.iter().map(|i| (*i, bag.first_image(*i).map(|first| first.encoding))).collect();
    let topics = bag.topics();
    let name = |i: usize| topics.get(i).map_or("", |t| t.name.as_str());
    let is_depth = |i: usize| {
        let encoding = encodings.iter().find(|(j, _)| *j == i).and_then(|(_, e)| e.as_ref().ok());
        let by_name = name(i).to_ascii_lowercase().contains("depth");
        encoding.is_some_and(|e| {
            e == "16UC1" || e == "32FC1" || e.contains("compressedDepth") || (e == "mono16" && by_name)
        }) || (by_name && encoding.is_some_and(|e| e.contains("png")))
    };
    let readable = |i: &usize| encodings.iter().any(|(j, e)| j == i && e.is_ok());
    candidates.retain(readable);
    if let (true, Some((i, Err(why)))) = (candidates.is_empty(), encodings.first()) {
        let cure = "check that the recording is complete; its messages of images are damaged";
        return Err(SourceError::new(shown, format!("no image of {} can be read ({why})", name(*i)), cure));
    }
    let (mut depth, cameras): (Vec<usize>, Vec<usize>) = candidates.into_iter().partition(|i| is_depth(*i));
    let cameras = one_each(cameras, &name);
    depth = one_each(depth, &name);
    let matching = |words: &[&str], among: &[usize]| -> Option<usize> {
        let has = |i: &usize| words.iter().any(|w| name(*i).to_ascii_lowercase().contains(w));
        let found: Vec<usize> = among.iter().copied().filter(has).collect();
        if let [one] = found[..] { Some(one) } else { None }
    };
    let depth = match depth[..] {
        [] => None,
        [one] => Some(one),
        _ => Some(
            matching(&["aligned", "registered"], &depth).ok_or_else(|| ambiguous(shown, "depth", topics))?,
        ),
    };
    let cameras = match (&cameras[..], depth) {
        ([], _) => {
            let why = "has depth images, but none of a camera";
            let cure =
                "record the camera too, or name its topic with --topic left=TOPIC if one of these is it";
            return Err(SourceError::new(shown, why, cure));
        }
        ([one], _) => vec![*one],
        (many, Some(_)) => vec![
            matching(&["color", "colour", "rgb"], many)
                .or_else(|| pairs(many, &name).first().map(|pair| pair[0]))
                .ok_or_else(|| ambiguous(shown, "left", topics))?,
        ],
        (many, None) => match pairs(many, &name)[..] {
            [pair] => pair.to_vec(),
            _ => return Err(ambiguous(shown, "left", topics)),
        },
    };
    Ok((cameras, depth))
}

fn ambiguous(shown: &str, role: &str, topics: &[Topic]) -> SourceError {
    SourceError::new(
        shown,
        "has several topics that could be meant",
        format!(
            "name them with --topic {role}=TOPIC (and right=, depth=); images are: {}",
            list(topics, is_image)
        ),
    )
}

/// Of the topics of one camera (compressed or not, raw or rectified) the one to read: raw images before others.
fn one_each<'a>(topics: Vec<usize>, name: &dyn Fn(usize) -> &'a str) -> Vec<usize> {
    let rank = |i: usize| {
        let (base, _) = base(name(i));
        (!base.ends_with("image_raw"), base != name(i), name(i))
    };
    let mut out: Vec<usize> = Vec::new();
    for topic in topics {
        match out.iter_mut().find(|i| namespace(name(**i)) == namespace(name(topic))) {
            Some(kept) if rank(topic) < rank(*kept) => *kept = topic,
            Some(_) => {}
            None => out.push(topic),
        }
    }
    out
}

/// Pairs of topics whose names differ in left and right, or in one digit by one.
fn pairs<'a>(topics: &[usize], name: &dyn Fn(usize) -> &'a str) -> Vec<[usize; 2]> {
    let mut out = Vec::new();
    for &a in topics {
        for &b in topics {
            if is_pair(name(a), name(b)) {
                out.push([a, b]);
            }
        }
    }
    out
}

fn is_pair(left: &str, right: &str) -> bool {
    let words = [("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT")];
    if words.iter().any(|(l, r)| left.contains(l) && left.replace(l, r) == right) {
        return true;
    }
    let mut changed = left.bytes().zip(right.bytes()).filter(|(a, b)| a != b);
    match (left.len() == right.len(), changed.next(), changed.next()) {
        (true, Some((a @ (b'0' | b'1'), b)), None) => b == a + 1,
        _ => false,
    }
}

fn found_imu(shown: &str, topics: &[Topic]) -> Result<ImuTopics, SourceError> {
    let is_imu = |t: &Topic| {
        t.message_kind() == MessageKind::Imu && t.format != WireFormat::Other && !t.entries.is_empty()
    };
    let of = |test: &dyn Fn(&str) -> bool| -> Vec<usize> {
        let fits = |(_, t): &(usize, &Topic)| is_imu(t) && test(&t.name.to_ascii_lowercase());
        topics.iter().enumerate().filter(fits).map(|(i, _)| i).collect()
    };
    let gyro = of(&|n| n.contains("gyro"));
    let accel = of(&|n| n.contains("accel"));
    let both = of(&|n| !n.contains("gyro") && !n.contains("accel"));
    match (&both[..], &gyro[..], &accel[..]) {
        ([one], _, _) => Ok(ImuTopics::One(*one)),
        ([], [gyro], [accel]) => Ok(ImuTopics::Split { gyro: *gyro, accel: *accel }),
        ([], [], _) | ([], _, []) => Ok(ImuTopics::None),
        _ => Err(SourceError::new(
            shown,
            "has several IMUs",
            format!("name one with --topic imu=TOPIC; they are: {}", list(topics, is_imu)),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_differ_in_side_or_one_digit() {
        assert!(is_pair("/stereo/left/image_raw", "/stereo/right/image_raw"));
        assert!(is_pair("/cam0/image_raw", "/cam1/image_raw"));
        assert!(is_pair("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"));
        assert!(!is_pair("/cam1/image_raw", "/cam0/image_raw"), "the order counts");
        assert!(!is_pair("/cam0/image_raw", "/cam2/image_raw"));
        assert!(!is_pair("/cam0/image_raw", "/cam0/image_raw"));
        assert!(!is_pair("/cam00/image", "/cam11/image"));
    }

    #[test]
    fn namespaces_leave_the_transport_out() {
        assert_eq!(namespace("/cam0/image_raw/compressed"), "/cam0");
        assert_eq!(namespace("/cam0/image_raw"), "/cam0");
        assert_eq!(namespace("image"), "");
    }

    #[test]
    fn names_of_topics_are_checked() {
        let named: NamedTopic = "left=/cam0/image_raw".parse().unwrap();
        assert_eq!((named.role, named.topic.as_str()), (TopicRole::Left, "/cam0/image_raw"));
        assert!("left".parse::<NamedTopic>().unwrap_err().to_string().contains("SENSOR=TOPIC"));
        assert!("top=/a".parse::<NamedTopic>().unwrap_err().to_string().contains("left, right, depth"));
    }
}
