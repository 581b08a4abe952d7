//! ROS bags and MCAP files as recordings.
//!
//! In: a bag, names of topics if the user gave some, a rig if there is one. Out: a [`Recording`] whose images and samples are
//! messages. Which topic is which sensor is found by the types and names of the topics ([`topics`]); the rig comes from
//! `camera_info` and `tf_static` ([`rig`]), or from what the RealSense SDK records ([`realsense`]).

mod frames;
mod realsense;
mod rig;
mod topics;

pub use frames::Frames;
pub use topics::{NamedTopic, NamedTopicError, TopicRole};

use crate::bag_reader::{BagReader, ImuTopics, median_step_ns};
use crate::recording::{ImageAt, ImuAt, Instant, Recording, forward_only, join_depth, pair};
use cairn_bag::{Bag, BagError, MessageKind, Topic, is_bag, stamped_pose};
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::Path;
use topics::Chosen;

/// Largest time between the images of a pair, and between an image and its depth, nanoseconds; never more than 0.4 of the
/// time between images.
const PAIR_APART_NS: u64 = 10_000_000;
const DEPTH_APART_NS: u64 = 20_000_000;

/// Images of a pair further apart than this in the median are no longer taken at one time, nanoseconds: it is said.
const TOLD_APART_NS: u64 = 1_000_000;

/// True when the path is a bag.
pub fn is(path: &Path) -> bool {
    is_bag(path)
}

/// Indexes the bag.
pub fn index(path: &Path, mut given: Option<Rig>, named: &[NamedTopic]) -> Result<Recording, SourceError> {
    let shown = path.display().to_string();
    let truth_topic = named.iter().rev().find(|n| n.role == TopicRole::Truth).map(|n| n.topic.as_str());
    let bag = Bag::open(path, &|name, kind| match truth_topic == Some(name) {
        true => usize::MAX,
        false => wanted(name, kind),
    });
    let bag = bag.map_err(source_error)?;
    let mut skipped = bag.notes().to_vec();
    let mut reader = BagReader::new(bag);
    let recorder = realsense::Recorder::of(&mut reader, &mut skipped);
    let mut chosen = match &recorder {
        Some(recorder) if named.iter().all(|n| n.role == TopicRole::Truth) => recorder.chosen(&mut reader),
        _ => topics::choose(&shown, &mut reader, named)?,
    };
    if let Some(rig) = &mut given {
        fit(&shown, rig, &mut chosen, &mut skipped)?;
        let depth = chosen.depth.and_then(|topic| reader.topics().get(topic));
        if let (Some(recorder), Some(depth)) = (&recorder, depth) {
            recorder.check(&shown, rig, &depth.name)?;
        }
    }
    if recorder.is_some() {
        realsense::restamp(&mut reader, &chosen.sensors(), &mut skipped);
    }
    let (rig, assumed) = match given {
        Some(rig) => (rig, Vec::new()),
        None => rig::of(&shown, &mut reader, &mut chosen, recorder, &mut skipped)?,
    };
    chosen.cameras.iter().for_each(|topic| skipped.extend(reader.find_bits(*topic)));
    let other = |text: String| Skipped::new(SkipKind::Other, "told about the bag", text);
    let mut skipped: Vec<Skipped> = skipped.into_iter().map(other).collect();
    let instants = instants(&reader, &chosen, &mut skipped);
    let truth =
        truth_topic.map_or(Ok(Vec::new()), |topic| truth(&shown, &mut reader, topic, &mut skipped))?;
    Ok(Recording {
        name: format!("bag {shown} ({})", chosen.text(reader.topics())),
        imu: rig.imu.is_some().then(|| ImuAt::Messages(chosen.imu.clone())),
        rig,
        instants,
        bag: Some(reader),
        truth,
        no_depth: None,
        skipped,
        assumed: (!assumed.is_empty()).then(|| assumed.join("; ")),
    })
}

/// The poses of a topic in order of time, the first of each time. Those that cannot be read are counted.
fn truth(
    shown: &str,
    reader: &mut BagReader,
    topic: &str,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let found = reader.topics().iter().position(|t| t.name == topic && !t.entries.is_empty());
    let Some(found) = found else {
        let why = format!("has no messages on \"{topic}\"");
        return Err(SourceError::new(shown, why, "name a topic of poses: --topic truth=TOPIC"));
    };
    let Some(about) = reader.topics().get(found) else { return Ok(Vec::new()) };
    let (kind, format, count) = (about.kind.clone(), about.format, about.entries.len());
    let mut poses: Vec<(Stamp, Se3)> = Vec::with_capacity(count);
    let mut first_fault = None;
    for number in 0..count {
        let message = reader.message(found, number);
        match message.and_then(|bytes| Ok(stamped_pose(&kind, format, &bytes)?)) {
            Ok((ns, pose)) => poses.push((Stamp(ns), pose)),
            Err(why) => {
                skipped.push(Skipped::new(SkipKind::Other, "a pose of the truth", format!("{topic}: {why}")));
                first_fault.get_or_insert(why);
            }
        }
    }
    if let (true, Some(why)) = (poses.is_empty(), first_fault) {
        return Err(SourceError::new(
            shown,
            format!("no pose of {topic} can be read: {why}"),
            "name another topic",
        ));
    }
    poses.sort_by_key(|(stamp, _)| *stamp);
    poses.dedup_by_key(|(stamp, _)| *stamp);
    Ok(poses)
}

/// How many messages of a topic are indexed.
fn wanted(name: &str, kind: &str) -> usize {
    match MessageKind::of(kind) {
        MessageKind::Image | MessageKind::CompressedImage | MessageKind::Imu => return usize::MAX,
        MessageKind::CameraInfo => return 1,
        MessageKind::Other => {}
    }
    match kind {
        "tf2_msgs/TFMessage" | "tf/tfMessage" if name.ends_with("tf_static") => 10_000,
        // What the RealSense SDK writes: options that may change, extrinsics, and of the metadata in pairs the first frame's.
        "std_msgs/Float32" if name.starts_with("/device_") => usize::MAX,
        "geometry_msgs/Transform" if name.starts_with("/device_") => 1,
        "diagnostic_msgs/KeyValue" if name.starts_with("/device_") => 20,
        "std_msgs/String" if name.starts_with("/device_") && !name.ends_with("/description") => usize::MAX,
        _ => 0,
    }
}

pub(super) fn source_error(e: BagError) -> SourceError {
    let cure = e.cure().to_owned();
    let (what, why) = match e {
        BagError::Io { path, source } => (path, format!("cannot be read ({source})")),
        BagError::Unsupported { path, why, .. } => (path, why),
        BagError::Damaged { path, at, why } => (path, format!("damaged at byte {at}: {why}")),
    };
    SourceError::new(what, why, cure)
}

/// A given rig decides what is read: fewer cameras, depth or not, the IMU or not.
fn fit(
    shown: &str,
    rig: &mut Rig,
    chosen: &mut Chosen,
    skipped: &mut Vec<String>,
) -> Result<(), SourceError> {
    let lacks = |why: String| {
        let cure = "give a rig of the sensors that are there, or name their topics with --topic";
        Err(SourceError::new(shown, why, cure))
    };
    if rig.cameras.len() > chosen.cameras.len() {
        let (n, there) = (rig.cameras.len(), chosen.cameras.len());
        return lacks(format!("the rig has {n} cameras, the bag has images of {there}"));
    }
    chosen.cameras.truncate(rig.cameras.len());
    match (&rig.depth, chosen.depth) {
        (Some(_), None) => return lacks("the rig has a depth sensor, the bag has no depth images".into()),
        (None, _) => chosen.depth = None,
        _ => {}
    }
    if chosen.imu == ImuTopics::None && rig.imu.take().is_some() {
        skipped.push("the rig has an IMU, the bag has no topic of sensor_msgs/Imu".into());
    }
    Ok(())
}

/// Messages of images in order of time, those of one instant together.
fn instants(reader: &BagReader, chosen: &Chosen, skipped: &mut Vec<Skipped>) -> Vec<Instant> {
    let mut list = |topic: usize| {
        let entries = reader.topics().get(topic).map_or(&[][..], |t: &Topic| &t.entries);
        let mut list: Vec<(Stamp, ImageAt)> =
            entries.iter().map(|e| (Stamp(e.stamp_ns), ImageAt::Message(topic, *e))).collect();
        forward_only(&mut list, |(stamp, _)| *stamp, skipped);
        list
    };
    let lists: Vec<_> = chosen.cameras.iter().map(|topic| list(*topic)).collect();
    let depth = chosen.depth.map(list);
    let [Some(left), right] = [lists.first(), lists.get(1)] else { return Vec::new() };
    let period_ns = median_step_ns(left.iter().map(|(stamp, _)| stamp.0));
    let within = |most: u64| most.min(period_ns * 2 / 5);
    let mut instants: Vec<Instant> = match right {
        Some(right) => {
            let mut apart: Vec<u64> = Vec::new();
            let pairs = pair(left, right, within(PAIR_APART_NS), skipped);
            for instant in &pairs {
                if let [ImageAt::Message(_, a), ImageAt::Message(_, b)] = &instant.images[..] {
                    apart.push(a.stamp_ns.abs_diff(b.stamp_ns));
                }
            }
            apart.sort_unstable();
            let median = apart.get(apart.len() / 2).copied().unwrap_or(0);
            if median > TOLD_APART_NS {
                let ms = median as f64 * 1e-6;
                let text = format!("left and right images are {ms:.1} ms apart, taken as one instant");
                skipped.push(Skipped::new(SkipKind::Other, "left and right images apart in time", text));
            }
            pairs
        }
        None => {
            let one = |(stamp, at): &(Stamp, ImageAt)| Instant {
                stamp: *stamp,
                images: vec![at.clone()],
                depth: None,
            };
            left.iter().map(one).collect()
        }
    };
    if let Some(depth) = depth {
        join_depth(&mut instants, depth, within(DEPTH_APART_NS));
    }
    instants
}
