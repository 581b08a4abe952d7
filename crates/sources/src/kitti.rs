//! KITTI odometry folders: `image_0/ image_1/ calib.txt times.txt`, and the truth in `poses.txt`; and drives of KITTI raw:
//! `image_00/data/ image_00/timestamps.txt` with `calib_cam_to_cam.txt` in the folder of the day.
//!
//! Geiger, Lenz and Urtasun, "Are we ready for autonomous driving?" (2012). A pose line is the 3x4 matrix
//! from camera 0 to the first pose of camera 0.

use crate::numbered::{NumberedError, NumberedImage, image_size, numbered};
use crate::recording::{ImageAt, Instant, Recording};
use crate::rig::{self, kitti as calib};
use crate::text::{data_lines, fields, numbers, place, read_text, stamp_of_date, stamp_seconds};
use cairn_eval::pose_from_matrix;
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// Nanoseconds between images without a `times.txt`.
const NOMINAL_STEP_NS: i64 = 100_000_000;

/// True when a folder looks like a KITTI odometry sequence.
pub fn is(folder: &Path) -> bool {
    [0, 2].iter().any(|camera| images_of(folder, *camera).is_dir())
}

/// The images of a camera: as the odometry benchmark has them, or the raw recordings.
fn images_of(folder: &Path, camera: usize) -> PathBuf {
    let raw = folder.join(format!("image_0{camera}/data"));
    if raw.is_dir() { raw } else { folder.join(format!("image_{camera}")) }
}

/// Indexes the folder: the gray pair, or the colour pair where there is no gray one.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let pair = if images_of(folder, 0).is_dir() { [0, 1] } else { [2, 3] };
    let present: Vec<usize> = pair.into_iter().filter(|i| images_of(folder, *i).is_dir()).collect();
    let rig = match (given, folder.join("rig.toml")) {
        (Some(rig), _) => rig,
        (None, own) if own.is_file() => rig::read_rig(own)?,
        (None, _) => own_rig(folder, &present)?,
    };
    if rig.cameras.len() > present.len() {
        return Err(SourceError::new(
            folder.display().to_string(),
            format!("the rig has {} cameras, the folder has images of {}", rig.cameras.len(), present.len()),
            "give a rig of the cameras that are there",
        ));
    }
    let mut skipped = Vec::new();
    let used = &present[..rig.cameras.len()];
    let files = numbered(&images_of(folder, used[0])).map_err(|e| unreadable(folder, &e))?;
    let lines = match_lines(&files);
    let times = times(folder, used[0], &mut skipped)?;
    let mut instants = Vec::new();
    for (file, &line) in files.iter().zip(&lines) {
        let stamp = match &times {
            None => Stamp(line as i64 * NOMINAL_STEP_NS),
            Some(times) => match times.get(line) {
                Some(Some(stamp)) => *stamp,
                _ => {
                    let why = "times.txt has no time for it";
                    let text = format!("{}: {why}", file.path.display());
                    skipped.push(Skipped::new(SkipKind::Frame, why, text));
                    continue;
                }
            },
        };
        // A missing right image is detected when it is read, and that pair is skipped.
        let images = used.iter().map(|i| ImageAt::File(counterpart(folder, *i, &file.path))).collect();
        instants.push((line, Instant { stamp, images, depth: None }));
    }
    let truth = truth(folder, &instants)?;
    let instants = instants.into_iter().map(|(_, instant)| instant).collect();
    let name = format!("KITTI folder {}", folder.display());
    Ok(Recording {
        name,
        rig: Rig { depth: None, imu: None, ..rig },
        instants,
        imu: None,
        bag: None,
        truth,
        no_depth: None,
        skipped,
        assumed: None,
    })
}

fn own_rig(folder: &Path, present: &[usize]) -> Result<Rig, SourceError> {
    let raw = [folder.to_owned(), folder.join("..")].map(|f| f.join("calib_cam_to_cam.txt"));
    let path = raw.into_iter().find(|path| path.is_file()).unwrap_or(folder.join("calib.txt"));
    if !path.is_file() {
        return Err(SourceError::new(path.display().to_string(), "is missing", "restore it, or give --rig"));
    }
    let size = image_size(&images_of(folder, present[0])).map_err(|e| unreadable(folder, &e))?;
    calib::rig(&path, &calib::projections(&path)?, present, size)
}

fn unreadable(folder: &Path, why: &NumberedError) -> SourceError {
    SourceError::new(
        folder.display().to_string(),
        format!("not a single image can be read ({why})"),
        "check the images",
    )
}

/// The line of `times.txt` and `poses.txt` for each file: its number, or its index in order where the numbers
/// do not start near 0 (a part cut from a longer sequence, with its lines cut as well).
fn match_lines(files: &[NumberedImage]) -> Vec<usize> {
    let cut = files.first().is_some_and(|f| f.number >= files.len());
    files.iter().enumerate().map(|(i, f)| if cut { i } else { f.number }).collect()
}

/// The same file name under another camera, with that camera's extension if it differs.
fn counterpart(folder: &Path, camera: usize, like: &Path) -> PathBuf {
    let images = images_of(folder, camera);
    let path = images.join(like.file_name().unwrap_or_default());
    if path.is_file() {
        return path;
    }
    let others = ["png", "jpg", "jpeg", "bmp"].map(|e| path.with_extension(e));
    others.into_iter().find(|p| p.is_file()).unwrap_or(path)
}

type Times = Option<Vec<Option<Stamp>>>;

fn times(folder: &Path, camera: usize, skipped: &mut Vec<Skipped>) -> Result<Times, SourceError> {
    let raw = folder.join(format!("image_0{camera}/timestamps.txt"));
    let path = if raw.is_file() { raw } else { folder.join("times.txt") };
    if !path.is_file() {
        return Ok(None);
    }
    let text = read_text(&path)?;
    let mut times = Vec::new();
    for (number, line) in data_lines(&text) {
        let stamp = stamp_seconds(line).or_else(|| stamp_of_date(line));
        if stamp.is_none() {
            let text = format!("{}: \"{line}\" is not a time in seconds", place(&path, number));
            skipped.push(Skipped::new(SkipKind::Line, "not a time in seconds", text));
        }
        times.push(stamp);
    }
    if times.is_empty() {
        let cure = "delete it to play at 10 images per second";
        return Err(SourceError::new(path.display().to_string(), "is empty", cure));
    }
    Ok(Some(times))
}

/// Poses of `poses.txt`, or of `../../poses/NN.txt` as in the benchmark's layout, for the images present.
fn truth(folder: &Path, instants: &[(usize, Instant)]) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    let sequence = folder.file_name().map(|n| format!("../../poses/{}.txt", n.to_string_lossy()));
    let candidates = [Some("poses.txt".to_owned()), sequence];
    let Some(path) = candidates.into_iter().flatten().map(|n| folder.join(n)).find(|p| p.is_file()) else {
        return Ok(Vec::new());
    };
    let text = read_text(&path)?;
    let lines: Vec<(usize, &str)> = data_lines(&text).collect();
    let mut truth = Vec::new();
    for (line, instant) in instants {
        let Some((number, text)) = lines.get(*line) else { continue };
        let wrong = |why: String| {
            SourceError::new(place(&path, *number), why, "correct the line, or move the file away")
        };
        let p = numbers::<12>(fields(text)).ok_or_else(|| wrong("a pose needs 12 finite numbers".into()))?;
        truth.push((instant.stamp, pose_from_matrix(&p).map_err(|e| wrong(e.to_string()))?));
    }
    truth.sort_by_key(|(stamp, _)| *stamp);
    truth.dedup_by_key(|(stamp, _)| *stamp);
    Ok(truth)
}
