//! The common form of all data sets: instants in time with the files of their images.

use crate::bag_reader::{BagReader, ImuTopics};
use crate::decode;
use crate::imu::Columns;
use crate::text::{data_lines, in_range, place, read_text};
use cairn_bag::Entry;
use cairn_eval::{Format, parse_stamped_pose};
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SkipKind, Skipped, SourceError, Stamp};
use std::ops::RangeInclusive;
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
    /// A picture of a film, by its number from 0.
    Film(PathBuf, usize),
    /// The left (0) or right (1) picture of a file with both of a stereo camera, side by side or one above the other.
    Half(PathBuf, usize),
}

/// Where the samples of the IMU are.
#[derive(Clone, Debug)]
pub enum ImuAt {
    /// In a csv file with these columns.
    Csv(PathBuf, Columns),
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
    /// Numbers the instants in their order; what is timed otherwise, an IMU and the truth, is left out.
    pub fn number(&mut self, hz: f64) -> Result<(), SourceError> {
        if !(hz.is_finite() && (1e-3..=1e6).contains(&hz)) {
            let why = format!("cannot number frames at {hz} Hz");
            return Err(SourceError::new(&self.name, why, "give frames per second"));
        }
        for (k, instant) in self.instants.iter_mut().enumerate() {
            instant.stamp = Stamp((k as f64 * 1e9 / hz) as i64);
        }
        (self.rig.imu, self.imu) = (None, None);
        self.truth.clear();
        Ok(())
    }

    /// Drops instants whose time does not increase, and keeps only the requested part. Where it is a tenth of them, what the times
    /// look like is told; where it is more than half, it is an error: what would be left is no recording.
    pub fn select(&mut self, start_s: f64, frames: Option<usize>) -> Result<(), SourceError> {
        let all: Vec<Stamp> = self.instants.iter().map(|i| i.stamp).collect();
        forward_only(&mut self.instants, |i| i.stamp, &mut self.skipped);
        let count = self.instants.len();
        let lost = all.len() - count;
        if 10 * lost >= all.len() && lost > 0 {
            let (of, like) = (all.len(), looks_like(&all));
            let why = format!("the times of {lost} of its {of} images do not go forward{like}");
            let cure = "sort its list, or give --number-frames HZ to number the images at that rate in the order of the list";
            if 2 * count < all.len() {
                return Err(SourceError::new(&self.name, why, cure));
            }
            self.skipped.push(Skipped::new(
                SkipKind::Other,
                "times do not go forward",
                format!("{why}; {cure}"),
            ));
        }
        let rate_hz = self.rate_hz();
        if count > 2 && !RATES_HZ.contains(&rate_hz) {
            let why = format!("its images are {:.3e} s apart: the times are in another unit", 1.0 / rate_hz);
            let cure = "write the times in the unit of this layout, or give --number-frames HZ to number the images at that rate";
            return Err(SourceError::new(&self.name, why, cure));
        }
        self.skipped.extend(self.foreign_truth());
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

    /// That no true pose lies between the images: then nothing is compared with it.
    fn foreign_truth(&self) -> Option<Skipped> {
        let (first, last) = (self.instants.first()?.stamp, self.instants.last()?.stamp);
        let [from, to] = [self.truth.first()?.0, self.truth.last()?.0];
        (from > last || to < first).then(|| {
            let text = format!(
                "the ground truth has no time in common with the images: it is of {:.3} to {:.3} s, they of {:.3} to {:.3} s; \
                 nothing is compared with it (is it of another clock or unit?)",
                from.seconds(),
                to.seconds(),
                first.seconds(),
                last.seconds()
            );
            Skipped::new(SkipKind::Other, "the ground truth is of another time", text)
        })
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

/// Images a second of whatever may be a recording: beyond are microseconds that were taken for nanoseconds, milliseconds for seconds.
const RATES_HZ: RangeInclusive<f64> = 0.2..=2000.0;

/// What times that do not go forward look like.
fn looks_like(stamps: &[Stamp]) -> String {
    let steps = || stamps.windows(2).map(|w| w[1].0.cmp(&w[0].0));
    let (back, same) = (steps().filter(|s| s.is_lt()).count(), steps().filter(|s| s.is_eq()).count());
    let lexical = stamps.windows(2).all(|w| w[0].0.to_string() <= w[1].0.to_string());
    if 2 * same > stamps.len() {
        ": most are those of the image before".into()
    } else if back + 1 == stamps.len() {
        ": they are in reverse".into()
    } else if lexical {
        ": they are in the order of text, 10 before 9".into()
    } else if back > 0 && 4 * back < stamps.len() {
        format!(": they begin anew {back} times, like those of a film that was played again")
    } else {
        String::new()
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

/// The median time between the images of pairs by these lists, nanoseconds, and half the usual time from one image to the
/// next, within which two images are a pair.
pub fn apart(left: &[(Stamp, ImageAt)], right: &[(Stamp, ImageAt)]) -> (u64, u64) {
    let median = |mut all: Vec<u64>| {
        all.sort_unstable();
        all.get(all.len() / 2).copied().unwrap_or(0)
    };
    let half = median(left.windows(2).map(|w| w[0].0.0.abs_diff(w[1].0.0)).collect()) / 2;
    let nearest = left.iter().filter_map(|(stamp, _)| {
        let after = right.partition_point(|(r, _)| r < stamp);
        let around = &right[after.saturating_sub(1)..right.len().min(after + 1)];
        around.iter().map(|(r, _)| r.0.abs_diff(stamp.0)).min().filter(|d| *d <= half)
    });
    (median(nearest.collect()), half)
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

/// A file of a list, with the separators of whatever system wrote it.
pub fn in_folder(folder: &Path, file: &str) -> PathBuf {
    let path = folder.join(file);
    if file.contains('\\') && !path.is_file() { folder.join(file.replace('\\', "/")) } else { path }
}

/// The images of a folder whose names are times, in the order of their names.
pub fn named_by_time(folder: &Path, stamp: fn(&str) -> Option<Stamp>) -> Vec<(Stamp, ImageAt)> {
    let files = std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| Some(e.ok()?.path()));
    let named = files
        .filter(|path| decode::is_image(path))
        .filter_map(|path| Some((stamp(path.file_stem()?.to_str()?)?, ImageAt::File(path))));
    let mut list: Vec<(Stamp, ImageAt)> = named.collect();
    list.sort_by_key(|(stamp, _)| *stamp);
    list
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
        let entry = line.split_once([',', ';', ' ', '\t']).and_then(|(stamp, file)| {
            let file = file.trim_matches(|c: char| matches!(c, ',' | ';') || c.is_whitespace());
            (!file.is_empty()).then_some((parse_stamp(stamp.trim())?, ImageAt::File(in_folder(folder, file))))
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

/// Poses from the lines of a TUM or EuRoC file, ordered by time; other lines are left out, which is told where no pose is left.
pub fn read_truth(
    path: &Path,
    format: Format,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let text = read_text(path)?;
    let mut truth: Vec<(Stamp, Se3)> = data_lines(&text)
        .filter_map(|(_, line)| {
            let (ns, pose) = parse_stamped_pose(line, format).ok()??;
            Some((in_range(ns)?, pose))
        })
        .collect();
    truth.sort_by_key(|(stamp, _)| *stamp);
    truth.dedup_by_key(|(stamp, _)| *stamp);
    if let (true, Some((number, _))) = (truth.is_empty(), data_lines(&text).last()) {
        let why = "no line is a pose with a time: nothing is compared with it";
        let text = format!("{}: {why}", place(path, number));
        skipped.push(Skipped::new(SkipKind::Other, "the ground truth is not read", text));
    }
    Ok(truth)
}
