//! The clock of a recording of the RealSense SDK.
//!
//! Until 2.57 a header has the device's time; since 2.58 it has the time of arrival, and the metadata beside each frame the
//! device's. In: the chosen streams. Out: their messages stamped by the device, where all of them have one clock; else by
//! their arrival, which is told.

use super::{stream, text};
use crate::bag_reader::BagReader;
use cairn_bag::key_value;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Stamps the messages of the chosen topics.
pub fn restamp(bag: &mut BagReader, chosen: &[usize], skipped: &mut Vec<String>) {
    let clocks: Vec<(usize, Clock)> = chosen.iter().map(|&topic| (topic, Clock::of(bag, topic))).collect();
    let domains: BTreeSet<&str> =
        clocks.iter().flat_map(|(_, clock)| &clock.domains).map(String::as_str).collect();
    let unstamped = clocks.iter().find(|(_, clock)| clock.is_unstamped);
    if domains.len() > 1 || unstamped.is_some() {
        let why = match unstamped {
            Some((topic, _)) => format!("{} has no times of the device", name(bag, *topic)),
            None => {
                let all: Vec<&str> = domains.into_iter().collect();
                format!("the streams have different clocks ({})", all.join(", "))
            }
        };
        skipped.push(format!("{why}: times of arrival are used, which are late and uneven"));
        for (topic, _) in clocks {
            bag.restamp(topic, |entry| Some(entry.log_ns));
        }
        return;
    }
    for (topic, clock) in clocks {
        let Some(mut stamps) = clock.stamps else { continue };
        let mut lost = 0;
        bag.restamp(topic, |entry| {
            let stamp = stamps.get_mut(&entry.log_ns).and_then(VecDeque::pop_front);
            lost += usize::from(stamp.is_none());
            stamp
        });
        if lost > 0 {
            let name = name(bag, topic);
            skipped.push(format!("{name}: {lost} messages have no time of the device, left out"));
        }
    }
}

fn name(bag: &BagReader, topic: usize) -> String {
    bag.topics().get(topic).map_or(String::new(), |t| t.name.clone())
}

/// What the metadata of a stream tells.
#[derive(Default)]
struct Clock {
    /// The names of the clocks.
    domains: BTreeSet<String>,
    /// The device's times by the time of recording; `None` where the headers have them.
    stamps: Option<BTreeMap<i64, VecDeque<i64>>>,
    /// Whether headers have the time of arrival and nothing has the device's.
    is_unstamped: bool,
}

impl Clock {
    fn of(bag: &mut BagReader, topic: usize) -> Self {
        let name = name(bag, topic);
        let stream = stream(&name);
        let names = [format!("{stream}/image/metadata"), format!("{stream}/imu/metadata")];
        let is_ros1 = bag.topics().get(topic).is_some_and(|t| t.format == cairn_bag::WireFormat::Ros1);
        let found = bag.topics().iter().position(|t| names.contains(&t.name) && !t.entries.is_empty());
        match found {
            Some(metadata) if is_ros1 => Self { domains: domain_of_pairs(bag, metadata), ..Self::default() },
            Some(metadata) => Self::of_texts(bag, metadata),
            None => Self { is_unstamped: !is_ros1, ..Self::default() },
        }
    }

    /// Since 2.58: one text for each frame, recorded at the time of the frame.
    fn of_texts(bag: &mut BagReader, metadata: usize) -> Self {
        let times: Vec<i64> =
            bag.topics().get(metadata).map_or(Vec::new(), |t| t.entries.iter().map(|e| e.log_ns).collect());
        let mut domains = BTreeSet::new();
        let mut stamps: BTreeMap<i64, VecDeque<i64>> = BTreeMap::new();
        for (number, log_ns) in times.into_iter().enumerate() {
            let Ok(text) = bag.text(metadata, number) else { continue };
            let Some(stamp) = text::stamp_ns(&text) else { continue };
            domains.insert(text::value(&text, "timestamp_domain").unwrap_or("unnamed").to_owned());
            stamps.entry(log_ns).or_default().push_back(stamp);
        }
        Self { is_unstamped: stamps.is_empty(), domains, stamps: Some(stamps) }
    }
}

/// Until 2.57: a pair of key and value for each property of a frame; the first of them tell the clock.
fn domain_of_pairs(bag: &mut BagReader, metadata: usize) -> BTreeSet<String> {
    let Some((format, count)) = bag.topics().get(metadata).map(|t| (t.format, t.entries.len())) else {
        return BTreeSet::new();
    };
    let pairs = (0..count).filter_map(|number| key_value(format, &bag.message(metadata, number).ok()?).ok());
    pairs.filter(|(key, _)| key == "timestamp_domain").map(|(_, value)| value).collect()
}
