//! The common form of all data sets: instants in time with the files of their images.

use crate::bag_reader::{BagReader, ImuTopics};
use crate::text::{data_lines, in_range, place, read_text};
use cairn_bag::Entry;
use cairn_eval::{Format, parse_stamped_pose};
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// The files of one instant.
#[derive(Clone, Debug)]
pub struct Instant {
    /// When the images were taken.
    pub stamp: Stamp,
    /// One image per camera of the rig.
    pub images: Vec<ImageAt>,
    /// The depth image, if there is one.
    pub depth: Option<ImageAt>,
}

/// Where an image is.
#[derive(Clone, Debug)]
pub enum ImageAt {
    /// In a file.
    File(PathBuf),
    /// In a message of a bag, of the topic with this index.
    Message(usize, Entry),
}

/// Where the samples of the IMU are.
#[derive(Clone, Debug)]
pub enum ImuAt {
    /// In a csv file.
    Csv(PathBuf),
    /// In two csv files, each with times of its own.
    Split {
        /// That of the gyroscope.
        gyro: PathBuf,
        /// That of the accelerometer.
        accel: PathBuf,
    },
    /// In messages of a bag.
    Messages(ImuTopics),
}

/// A data set, indexed but not yet read.
pub struct Recording {
    /// Kind and location, for people.
    pub name: String,
    /// The sensors.
    pub rig: Rig,
    /// Its instants; [`Recording::select`] puts them in order.
    pub instants: Vec<Instant>,
    /// The IMU's samples, if they are to be read.
    pub imu: Option<ImuAt>,
    /// The bag in which the images and samples are, if it is one.
    pub bag: Option<BagReader>,
    /// True poses of the body.
    pub truth: Vec<(Stamp, Se3)>,
    /// The value that means "no depth" besides 0.
    pub no_depth: Option<u16>,
    /// What indexing had to leave out.
    pub skipped: Vec<Skipped>,
    /// See [`cairn_sensor::SourceInfo::assumed`].
    pub assumed: Option<String>,
}

impl Recording {
    /// Drops instants whose time does not increase, and keeps only the requested part.
    pub fn select(&mut self, start_s: f64, frames: Option<usize>) -> Result<(), SourceError> {
        forward_only(&mut self.instants, |i| i.stamp, &mut self.skipped);
        let count = self.instants.len();
        let first_stamp = self.instants.first().map(|i| i.stamp);
        if let Some(first) = self.instants.first().map(|i| i.stamp) {
            self.instants.retain(|i| i.stamp - first >= start_s);
            self.instants.truncate(frames.unwrap_or(usize::MAX));
        }
        // What was left out outside of the requested part is not part of this run.
        if let (Some(first), Some(last)) = (self.instants.first(), self.instants.last()) {
            let from = if Some(first.stamp) == first_stamp { Stamp(i64::MIN) } else { first.stamp };
            let to = if frames.is_some() { last.stamp } else { Stamp(i64::MAX) };
            self.skipped.retain(|s| s.stamp.is_none_or(|at| (from..=to).contains(&at)));
        }
        if self.instants.is_empty() {
            let why = match count {
                0 => "contains no image".to_owned(),
                n => format!("none of its {n} instants lies {start_s} s after the first"),
            };
            let first = self.skipped.first().map_or(String::new(), |s| format!(" ({})", s.text));
            return Err(SourceError::new(&self.name, why + &first, "check the folder, --start and --frames"));
        }
        Ok(())
    }

    /// Frames per second: from the median step of up to 500 instants.
    pub fn rate_hz(&self) -> f64 {
        let mut steps: Vec<f64> = self
            .instants
            .windows(2)
            .take(500)
            .map(|w| w[1].stamp - w[0].stamp)
            .filter(|s| *s > 0.0)
            .collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).map_or(0.0, |s| 1.0 / s)
    }
}

/// Keeps stamps strictly increasing. A stamp later than both that follow is itself the wrong one.
pub fn forward_only<T>(instants: &mut Vec<T>, stamp: impl Fn(&T) -> Stamp, skipped: &mut Vec<Skipped>) {
    let stamps: Vec<Stamp> = instants.iter().map(&stamp).collect();
    let mut last: Option<Stamp> = None;
    let mut at = 0;
    instants.retain(|instant| {
        let (stamp, next) = (stamp(instant), stamps.get(at + 1..at + 3));
        at += 1;
        let back = last.is_some_and(|last| stamp <= last);
        let jump =
            next.is_some_and(|next| next.iter().all(|&n| n < stamp && last.is_none_or(|last| n > last)));
        if back || jump {
            let how = if Some(stamp) == last {
                "is repeated"
            } else if back {
                "goes backwards"
            } else {
                "jumps ahead"
            };
            let (reason, text) =
                (format!("the time {how}"), format!("{stamp}: the time {how}, image dropped"));
            skipped.push(Skipped::new(SkipKind::Frame, reason, text).at(stamp));
            return false;
        }
        last = Some(stamp);
        true
    });
}

/// Pairs two lists by stamps at most `tolerance_ns` apart; images without a partner are listed in `skipped`.
pub fn pair(
    left: &[(Stamp, ImageAt)],
    right: &[(Stamp, ImageAt)],
    tolerance_ns: u64,
    skipped: &mut Vec<Skipped>,
) -> Vec<Instant> {
    let mut alone = |stamp: Stamp, why: &str| {
        skipped.push(Skipped::new(SkipKind::Frame, why, format!("{stamp}: {why}")).at(stamp));
    };
    let mut pairs = Vec::with_capacity(left.len());
    let (mut l, mut r) = (0, 0);
    while l < left.len() || r < right.len() {
        match (left.get(l), right.get(r)) {
            (Some(a), Some(b)) if a.0.0.abs_diff(b.0.0) <= tolerance_ns => {
                pairs.push(Instant { stamp: a.0, images: vec![a.1.clone(), b.1.clone()], depth: None });
                (l, r) = (l + 1, r + 1);
            }
            (Some(a), b) if b.is_none_or(|b| a.0 < b.0) => {
                alone(a.0, "the left image has no right one");
                l += 1;
            }
            (_, Some(b)) => {
                alone(b.0, "the right image has no left one");
                r += 1;
            }
            (_, None) => break,
        }
    }
    pairs
}

/// Gives each instant the depth image nearest in time, if there is one within `tolerance_ns`.
pub fn join_depth(instants: &mut [Instant], mut depth: Vec<(Stamp, ImageAt)>, tolerance_ns: u64) {
    depth.sort_by_key(|(stamp, _)| *stamp);
    for instant in instants {
        let stamp = instant.stamp;
        let after = depth.partition_point(|(d, _)| *d < stamp);
        let around = &depth[after.saturating_sub(1)..depth.len().min(after + 1)];
        let nearest = around.iter().min_by_key(|(d, _)| d.0.abs_diff(stamp.0));
        instant.depth =
            nearest.filter(|(d, _)| d.0.abs_diff(stamp.0) <= tolerance_ns).map(|(_, path)| path.clone());
    }
}

/// Reads a file of `stamp file` lines; other lines are listed in `skipped`, a file without any is an error.
pub fn read_index(
    path: &Path,
    parse_stamp: fn(&str) -> Option<Stamp>,
    folder: &Path,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, ImageAt)>, SourceError> {
    let text = read_text(path)?;
    let before = skipped.len();
    let mut list = Vec::new();
    for (number, line) in data_lines(&text) {
        let entry = line.split_once([',', ' ', '\t']).and_then(|(stamp, file)| {
            let file = file.trim_matches(|c: char| c == ',' || c.is_whitespace());
            (!file.is_empty()).then_some((parse_stamp(stamp.trim())?, ImageAt::File(folder.join(file))))
        });
        match entry {
            Some(entry) => list.push(entry),
            None => {
                let why = "not a time stamp and a file";
                let text = format!("{}: {why}, line left out", place(path, number));
                skipped.push(Skipped::new(SkipKind::Line, why, text));
            }
        }
    }
    if list.is_empty() {
        let (what, why) = match skipped.get(before) {
            Some(first) => (first.text.clone(), "and no other line names an image".to_owned()),
            None => (path.display().to_string(), "is empty: it names no image".to_owned()),
        };
        return Err(SourceError::new(what, why, "each line must be: time stamp, image file"));
    }
    Ok(list)
}

/// Poses from the lines of a TUM or EuRoC file, ordered by time; other lines are left out.
pub fn read_truth(path: &Path, format: Format) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let text = read_text(path)?;
    let mut truth: Vec<(Stamp, Se3)> = data_lines(&text)
        .filter_map(|(_, line)| {
            let (ns, pose) = parse_stamped_pose(line, format).ok()??;
            Some((in_range(ns)?, pose))
        })
        .collect();
    truth.sort_by_key(|(stamp, _)| *stamp);
    truth.dedup_by_key(|(stamp, _)| *stamp);
    Ok(truth)
}
