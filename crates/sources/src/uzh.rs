//! Folders of the UZH-FPV dataset and of the other recordings and benchmarks of that laboratory: a list `left_images.txt` with
//! `right_images.txt`, or `images.txt`; `imu.txt`; `groundtruth.txt` or `stamped_groundtruth.txt`.
//!
//! Delmerico et al., "Are we ready for autonomous drone racing? The UZH-FPV drone racing dataset" (2019); Mueggler et al., "The
//! event-camera dataset and simulator" (2017), with a `calib.txt` of `fx fy cx cy k1 k2 p1 p2 k3`. Lines are `number time file`
//! or `time file`, in seconds; in `imu.txt` the gyroscope comes first (UZH-FPV) or the accelerometer (the other), which is told
//! by gravity.

use crate::imu::{Columns, first_samples};
use crate::recording::{ImageAt, ImuAt, Instant, Recording, apart, in_folder, pair, read_truth};
use crate::rig;
use crate::text::{data_lines, fields, numbers, place, read_text, stamp_seconds};
use crate::{decode, first_image};
use cairn_eval::{Format, parse_stamped_pose};
use cairn_sensor::{Camera, Distortion, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// Samples that tell which sensor comes first.
const FIRST: usize = 2000;
/// Stamps of cameras triggered together differ by less, nanoseconds.
const SAME_INSTANT_NS: u64 = 500_000;

/// True when a folder has such a list, whose first line of data names an image beside it.
pub fn is(folder: &Path) -> bool {
    let Some(list) = lists(folder).into_iter().next() else { return false };
    let Ok(text) = read_text(&list) else { return false };
    data_lines(&text).next().and_then(|(_, line)| entry(folder, line)).is_some_and(|(_, path)| path.is_file())
}

/// The list of each camera.
fn lists(folder: &Path) -> Vec<PathBuf> {
    let [left, right, one] =
        ["left_images.txt", "right_images.txt", "images.txt"].map(|name| folder.join(name));
    let all = if left.is_file() { vec![left, right] } else { vec![one] };
    all.into_iter().filter(|path| path.is_file()).collect()
}

/// The time and file of a line: the last word is the file, the one before it the time.
fn entry(folder: &Path, line: &str) -> Option<(Stamp, PathBuf)> {
    let words: Vec<&str> = fields(line).collect();
    let (&[time, file] | &[_, time, file]) = words.as_slice() else { return None };
    let path = in_folder(folder, file);
    Some((stamp_seconds(time)?, path)).filter(|(_, path)| decode::is_image(path))
}

/// Indexes the folder. Its rig is the one given, a Cairn or Kalibr file in it, or its `calib.txt`.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let shown = folder.display().to_string();
    let lists = lists(folder);
    let mut rig = match given {
        Some(rig) => rig,
        None => own_rig(folder)?,
    };
    if rig.cameras.len() > lists.len() {
        let why =
            format!("the rig has {} cameras, the folder has images of {}", rig.cameras.len(), lists.len());
        return Err(SourceError::new(shown, why, "give a rig of the cameras that are there"));
    }
    rig.depth = None;
    let mut skipped = Vec::new();
    let images: Vec<_> = lists[..rig.cameras.len()]
        .iter()
        .map(|list| images(folder, list, &mut skipped))
        .collect::<Result<_, _>>()?;
    let instants = match images.as_slice() {
        [left, right, ..] => pair(left, right, apart(left, right).1.max(SAME_INSTANT_NS), &mut skipped),
        _ => images
            .into_iter()
            .flatten()
            .map(|(stamp, image)| Instant { stamp, images: vec![image], depth: None })
            .collect(),
    };
    let imu = if rig.imu.is_some() { motion(folder, &mut skipped) } else { None };
    rig.imu = rig.imu.filter(|_| imu.is_some());
    Ok(Recording {
        name: format!("UZH folder {shown}"),
        rig,
        instants,
        imu,
        bag: None,
        truth: truth(folder, &mut skipped)?,
        no_depth: None,
        skipped,
        assumed: None,
    })
}

fn images(
    folder: &Path,
    list: &Path,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, ImageAt)>, SourceError> {
    let text = read_text(list)?;
    let mut images = Vec::new();
    for (number, line) in data_lines(&text) {
        match entry(folder, line) {
            Some((stamp, path)) => images.push((stamp, ImageAt::File(path))),
            None => {
                let why = "not a time stamp and a file";
                let text = format!("{}: {why}, line left out", place(list, number));
                skipped.push(Skipped::new(SkipKind::Line, why, text));
            }
        }
    }
    if images.is_empty() {
        let cure = "each line must be: number, time in seconds, image file";
        return Err(SourceError::new(list.display().to_string(), "names no image", cure));
    }
    Ok(images)
}

/// A rig in the folder: any chain of Kalibr, else `calib.txt`.
fn own_rig(folder: &Path) -> Result<Rig, SourceError> {
    let named = rig::file_in(folder).or_else(|| rig::chain_in(folder));
    if let Some(path) = named {
        return rig::read_rig(path);
    }
    let path = folder.join("calib.txt");
    let wrong = |why: &str| SourceError::new(path.display().to_string(), why, "give a rig with --rig");
    if !path.is_file() {
        return Err(wrong("is missing, and there is no chain of Kalibr (UZH-FPV has it in another archive)"));
    }
    let text = read_text(&path)?;
    let [fx, fy, cx, cy] = numbers::<4>(fields(&text)).ok_or_else(|| wrong("does not hold fx fy cx cy"))?;
    let lens = numbers::<9>(fields(&text)).map_or([0.0; 5], |n| [n[4], n[5], n[6], n[7], n[8]]);
    let size = first_image::size(folder).or_else(|| {
        let text = read_text(lists(folder).first()?).ok()?;
        data_lines(&text).find_map(|(_, line)| decode::size(&entry(folder, line)?.1).ok())
    });
    let [width, height] = size.ok_or_else(|| wrong("is beside no image that can be read"))?;
    let distortion = Distortion::RadialTangential(lens);
    Ok(Rig::mono(Camera { distortion, ..Camera::pinhole(width, height, fx, fy, cx, cy) }))
}

/// The IMU's file, when gravity tells its columns.
fn motion(folder: &Path, skipped: &mut Vec<Skipped>) -> Option<ImuAt> {
    let path = folder.join("imu.txt");
    let text = if path.is_file() { read_text(&path).ok()? } else { return None };
    let words = data_lines(&text).next().map_or(0, |(_, line)| fields(line).count());
    let before = usize::from(words >= 8);
    let gravity = |accel_first: bool| {
        let columns = Columns { before, accel_first, ..Columns::default() };
        let mut norms: Vec<f64> =
            first_samples(&path, columns, FIRST).iter().map(|s| s.accel.norm()).collect();
        norms.sort_by(f64::total_cmp);
        norms.get(norms.len() / 2).is_some_and(|norm| (7.0..13.0).contains(norm)).then_some(columns)
    };
    match (gravity(false), gravity(true)) {
        (Some(columns), None) | (None, Some(columns)) => Some(ImuAt::Csv(path, columns)),
        _ => {
            let text = "gravity is in neither or both sensors of imu.txt: which is which is not known, the IMU is not used";
            skipped.push(Skipped::new(SkipKind::Other, "the IMU is not used", text));
            None
        }
    }
}

/// True poses; in some files each line begins with its number.
fn truth(
    folder: &Path,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, cairn_geometry::Se3)>, SourceError> {
    let files = ["groundtruth.txt", "stamped_groundtruth.txt"].map(|name| folder.join(name));
    let Some(path) = files.into_iter().find(|path| path.is_file()) else { return Ok(Vec::new()) };
    let text = read_text(&path)?;
    let numbered = data_lines(&text).next().is_some_and(|(_, line)| fields(line).count() == 9);
    if !numbered {
        return read_truth(&path, Format::Tum, skipped);
    }
    let pose = |(_, line): (usize, &str)| {
        let words: Vec<&str> = fields(line).skip(1).collect();
        let (ns, pose) = parse_stamped_pose(&words.join(" "), Format::Tum).ok()??;
        Some((crate::text::in_range(ns)?, pose))
    };
    let mut truth: Vec<_> = data_lines(&text).filter_map(pose).collect();
    truth.sort_by_key(|(stamp, _)| *stamp);
    truth.dedup_by_key(|(stamp, _)| *stamp);
    Ok(truth)
}
