//! A folder of PNG, JPEG or BMP images of one camera, in the order of their names; or of a stereo camera, left and right side by
//! side in each, where a rig of two cameras of half the width is given.
//!
//! Times are those in the names where all are times (nanoseconds as EuRoC has them, or seconds as TUM has them), else
//! those of `times.txt` or `timestamps.txt` with a line for each image, else 30 images a second.

use crate::decode;
use crate::halves::{DOUBT, alike, two_in_one};
use crate::recording::{ImageAt, Instant, Recording};
use crate::rig;
use crate::text::{data_lines, fields, read_text, stamp_ns, stamp_seconds};
use cairn_sensor::{Camera, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Nanoseconds between images without times: 30 a second.
const NOMINAL_STEP_NS: i64 = 33_333_333;

/// Files with the times of the images.
const TIMES: [&str; 2] = ["times.txt", "timestamps.txt"];

/// True when a folder holds images.
pub fn is(folder: &Path) -> bool {
    images(folder).nth(1).is_some()
}

/// Indexes the folder. Its rig is the one given (its first camera), a Cairn or Kalibr file in it, or a guess.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let shown = folder.display().to_string();
    let mut files: Vec<PathBuf> = images(folder).collect();
    files.sort_by_cached_key(|path| natural(path));
    let Some(first) = files.first().cloned() else {
        return Err(SourceError::new(
            shown,
            "holds no PNG, JPEG or BMP",
            "give the folder of the images themselves",
        ));
    };
    let mut notes = Vec::new();
    let (mut rig, mut assumed) = match (given, rig::file_in(folder)) {
        (Some(rig), _) => (rig, None),
        (None, Some(path)) => (rig::read_rig(path)?, None),
        (None, None) => {
            let [width, height] = files.iter().find_map(|path| decode::size(path).ok()).ok_or_else(|| {
                let why = decode::size(&first).err().map(|e| e.to_string()).unwrap_or_default();
                SourceError::new(
                    &shown,
                    format!("not a single image can be read ({why})"),
                    "check the images",
                )
            })?;
            let camera = Camera::guessed(width, height);
            let what =
                format!("a focal length of {:.0} px (0.7 of the longer side), no distortion", camera.fx);
            (Rig::mono(camera), Some(what))
        }
    };
    let size = files.iter().find_map(|path| decode::size(path).ok());
    let both = size.and_then(|size| two_in_one(&rig, size));
    if let Some(how) = both {
        rig.cameras.truncate(2);
        notes.push(how.to_owned());
    } else {
        if rig.cameras.len() > 1 || rig.depth.is_some() || rig.imu.is_some() {
            notes.push("only the first camera of the rig is used".to_owned());
        }
        rig.cameras.truncate(1);
    }
    (rig.depth, rig.imu) = (None, None);
    let mut skipped = Vec::new();
    if assumed.is_some() && files.iter().find_map(|path| decode::gray(path).ok()).is_some_and(|i| alike(&i)) {
        skipped.push(Skipped::new(SkipKind::Other, "two pictures side by side", DOUBT));
    }
    skipped.extend(of_several(&files));
    skipped.extend(turned(&first, &rig.cameras[0].camera));
    let stamps = match stamps(folder, &files)? {
        Some(stamps) => stamps,
        None => {
            notes.push("without times: 30 images a second".to_owned());
            (0..files.len() as i64).map(|i| Stamp(i * NOMINAL_STEP_NS)).collect()
        }
    };
    if let Some(assumed) = &mut assumed {
        // Times are part of what poses rest on.
        if notes.iter().any(|note| note.starts_with("without times")) {
            assumed.push_str(", 30 images a second");
        }
    }
    let notes = if notes.is_empty() { String::new() } else { format!(" ({})", notes.join("; ")) };
    let instants = files
        .into_iter()
        .zip(stamps)
        .map(|(image, stamp)| {
            let halves = |image: PathBuf| vec![ImageAt::Half(image.clone(), 0), ImageAt::Half(image, 1)];
            let images = if both.is_some() { halves(image) } else { vec![ImageAt::File(image)] };
            Instant { stamp, images, depth: None }
        })
        .collect();
    Ok(Recording {
        name: format!("folder of images {shown}{notes}"),
        rig,
        instants,
        imu: None,
        bag: None,
        truth: Vec::new(),
        no_depth: None,
        skipped,
        assumed,
    })
}

/// That pictures are marked as turned, and how they are taken.
fn turned(first: &Path, camera: &Camera) -> Option<Skipped> {
    let orientation = decode::orientation(first)?;
    let [width, height] = decode::size(first).ok()?;
    let how = match (width, height) == (camera.width, camera.height) {
        true => {
            "as they are stored, which is as the sensor sees: a calibration of turned pictures (OpenCV turns them) would not fit"
        }
        false => "turned, as the calibration is of turned pictures",
    };
    let text =
        format!("the pictures are marked as turned (EXIF orientation {orientation}), and are taken {how}");
    Some(Skipped::new(SkipKind::Other, "turned pictures", text))
}

/// That images are of several cameras, by what stands before the numbers in their names.
fn of_several(files: &[PathBuf]) -> Option<Skipped> {
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    for stem in files.iter().filter_map(|path| path.file_stem()?.to_str()) {
        let before = stem.trim_end_matches(|c: char| c.is_ascii_digit() || c == '.');
        *kinds.entry(before.to_owned()).or_default() += 1;
    }
    kinds.retain(|_, count| 10 * *count >= files.len());
    let (first, second) = (kinds.keys().next()?, kinds.keys().nth(1)?);
    let text = format!(
        "the images have names of {} kinds ({first}... and {second}...) and are played one kind after the other as of one camera: \
         give the folder of one kind",
        kinds.len()
    );
    Some(Skipped::new(SkipKind::Other, "images of several cameras", text))
}

fn images(folder: &Path) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| {
        let path = entry.ok()?.path();
        // Hidden files are those of a file system, such as "._a.jpg" of a Mac.
        let hidden = path.file_name()?.to_str()?.starts_with('.');
        (decode::is_image(&path) && !hidden && path.is_file()).then_some(path)
    })
}

/// A key by which names are ordered as people count: `a2` before `a10`.
fn natural(path: &Path) -> Vec<(u8, u128, String)> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let mut key = Vec::new();
    let mut rest = name.as_str();
    while !rest.is_empty() {
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        let text = rest.bytes().take_while(|b| !b.is_ascii_digit()).count();
        let (part, after) = rest.split_at(if digits > 0 { digits } else { text });
        // More digits than a number holds are compared as text.
        match part.parse::<u128>() {
            Ok(number) if digits > 0 => key.push((0, number, String::new())),
            _ => key.push((1, 0, part.to_owned())),
        }
        rest = after;
    }
    // Names that differ in leading zeros only keep one order.
    key.push((2, 0, name));
    key
}

/// The times of the images, if there are any.
pub fn stamps(folder: &Path, files: &[PathBuf]) -> Result<Option<Vec<Stamp>>, SourceError> {
    if let Some(path) = TIMES.iter().map(|name| folder.join(name)).find(|path| path.is_file()) {
        let text = read_text(&path)?;
        let lines: Vec<(usize, &str)> = data_lines(&text).collect();
        if lines.len() != files.len() {
            let why = format!("has {} lines, the folder {} images", lines.len(), files.len());
            return Err(SourceError::new(
                path.display().to_string(),
                why,
                "write one time for each image, or delete it",
            ));
        }
        let parse = |(number, line): &(usize, &str)| {
            // The time is the only number of a line, or its first beside the name of the image.
            fields(line).find_map(time).ok_or_else(|| {
                let what = format!("{}, line {number}", path.display());
                SourceError::new(what, "is not a time in seconds or nanoseconds", "correct the line")
            })
        };
        return lines.iter().map(parse).collect::<Result<Vec<_>, _>>().map(Some);
    }
    let of_name = |path: &PathBuf| time_of_name(path.file_stem()?.to_str()?);
    Ok(files.iter().map(of_name).collect())
}

/// Nanoseconds where the number is as long as those since 1970, else seconds.
fn time(text: &str) -> Option<Stamp> {
    if text.len() >= 16 && text.bytes().all(|b| b.is_ascii_digit()) {
        stamp_ns(text)
    } else {
        stamp_seconds(text)
    }
}

/// A name counts as a time only where it cannot be a number of an image.
fn time_of_name(stem: &str) -> Option<Stamp> {
    let decimal = stem.contains('.') || stem.len() >= 16;
    time(stem).filter(|_| decimal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_as_people_count() {
        let mut names = ["b1.png", "a10.png", "a2.png", "a02.png", "10.png", "9.png"].map(PathBuf::from);
        names.sort_by_cached_key(|path| natural(path));
        let names: Vec<&str> = names.iter().filter_map(|p| p.to_str()).collect();
        assert_eq!(names, ["9.png", "10.png", "a02.png", "a2.png", "a10.png", "b1.png"]);
    }

    #[test]
    fn names_are_times_only_where_they_cannot_be_numbers() {
        assert_eq!(time_of_name("1403636579763555584"), Some(Stamp(1_403_636_579_763_555_584)));
        assert_eq!(time_of_name("1305031102.175304"), Some(Stamp(1_305_031_102_175_304_000)));
        assert_eq!((time_of_name("000123"), time_of_name("frame-1.5")), (None, None));
    }
}
