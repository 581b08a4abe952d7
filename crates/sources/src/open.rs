//! Opening a source by its name; its kind is detected.

use crate::options::{OpenOptions, SourceKind};
use crate::player::Player;
use crate::prefetch::Prefetch;
use crate::recording::Recording;
use crate::{android, bag, euroc, first_image, frames, images, kitti, live, seven_scenes, tum, uzh};
use cairn_sensor::{Rig, Source, SourceError};
use cairn_sim::{SimConfig, SimSource};
use std::path::{Path, PathBuf};

struct Kind {
    kind: SourceKind,
    name: &'static str,
    is: fn(&Path) -> bool,
    index: fn(&Path, Option<Rig>) -> Result<Recording, SourceError>,
}

const KINDS: [Kind; 8] = [
    Kind { kind: SourceKind::Euroc, name: "EuRoC", is: euroc::is, index: euroc::index },
    Kind { kind: SourceKind::Tum, name: "TUM RGB-D", is: tum::is, index: tum::index },
    Kind { kind: SourceKind::Kitti, name: "KITTI", is: kitti::is, index: kitti::index },
    Kind {
        kind: SourceKind::SevenScenes,
        name: "7-Scenes",
        is: seven_scenes::is,
        index: seven_scenes::index,
    },
    Kind { kind: SourceKind::Frames, name: "numbered frames", is: frames::is, index: frames::index },
    Kind { kind: SourceKind::Android, name: "Android", is: android::is, index: android::index },
    Kind { kind: SourceKind::Uzh, name: "UZH", is: uzh::is, index: uzh::index },
    Kind { kind: SourceKind::Images, name: "folder of images", is: images::is, index: images::index },
];

const KNOWN: &str = "known are EuRoC and TUM-VI (mav0/ or cam0/), TUM RGB-D (rgb.txt or associations.txt), KITTI odometry and raw (image_0/, image_00/data/), 7-Scenes (frame-*.color.*), Replica (results/ and traj.txt), ScanNet (color/ and intrinsic/), Stray Scanner (odometry.csv and camera_matrix.csv), Record3D (metadata.json with rgb/), numbered images in rgb/ and depth/, UZH-FPV (left_images.txt or images.txt), Android phones (frames.csv and gyroscope.csv), a folder of PNG, JPEG or BMP images, ROS bags (.bag, .db3, folders of ros2 bag) and MCAP (.mcap)";

/// Opens a recording (a folder, a bag or an MCAP file), a simulated world (`sim:WORLD?key=value`, see [`SimConfig::KEYS`]) or video: a file, a
/// camera (`camera:0`), `rtsp://`, `rtmp://`, or `rtmp-listen://HOST:PORT/NAME`, which waits for a sender; on 64-bit
/// Linux, cameras of the kernel (`v4l2:/dev/video0`, `realsense:`).
/// Packets are read on a thread, which ends when the source is dropped; live sources deliver the newest
/// image.
///
/// # Errors
///
/// [`SourceError`] with a remedy, when the source does not exist, is of an unknown kind, or cannot be read.
pub fn open(source: &str, options: OpenOptions) -> Result<Box<dyn Source>, SourceError> {
    if !(options.start_s.is_finite() && options.start_s >= 0.0) {
        let why = format!("cannot start at {} s", options.start_s);
        return Err(SourceError::new(source, why, "give seconds after the first image, 0 or more"));
    }
    if options.frames == Some(0) {
        return Err(SourceError::new(source, "0 frames are requested", "request at least one"));
    }
    if !options.topics.is_empty() && !bag::is(Path::new(source)) {
        return Err(SourceError::new(source, "is no bag, so it has no topics", "leave --topic out"));
    }
    if source.starts_with("sim:") {
        let cancel = options.cancel.clone();
        return Ok(Box::new(Prefetch::start(simulated(source, options)?)?.cancelled_by(cancel)));
    }
    if let Some(camera) = camera_of(source, &options) {
        return camera;
    }
    if let Some(video) = live::open(source, &options) {
        return video;
    }
    if let Some(scheme) = scheme(source) {
        return Err(SourceError::new(
            source,
            format!("sources of the kind \"{scheme}:\" cannot be read"),
            format!(
                "give a folder, a video, camera:N, v4l2:NODE, realsense:, rtmp://, rtmp-listen://, rtsp:// or sim:WORLD; {KNOWN}"
            ),
        ));
    }
    let path = sequence_of(Path::new(source))?;
    let mut recording = match kind_of(&path, options.kind)? {
        Found::Bag => bag::index(&path, options.rig, &options.topics)?,
        Found::Folder(kind) => (kind.index)(&path, options.rig)?,
    };
    if let Some(hz) = options.number_frames_hz {
        recording.number(hz)?;
    }
    recording.select(options.start_s, options.frames)?;
    Ok(Box::new(Prefetch::start(Player::new(recording)?)?.cancelled_by(options.cancel)))
}

/// A camera of the kernel, where there are any.
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
fn camera_of(source: &str, options: &OpenOptions) -> Option<Result<Box<dyn Source>, SourceError>> {
    crate::camera::open(source, options)
}

#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
fn camera_of(source: &str, _: &OpenOptions) -> Option<Result<Box<dyn Source>, SourceError>> {
    let cure = "they need 64-bit Linux; camera:0 reads a webcam through ffmpeg";
    live::is_camera(source)
        .then(|| Err(SourceError::new(source, "this build has no cameras of the kernel", cure)))
}

fn simulated(source: &str, options: OpenOptions) -> Result<SimSource, SourceError> {
    if options.rig.is_some() {
        let cure = "leave the rig out, and choose the camera with sim:WORLD?key=value";
        return Err(SourceError::new(source, "a simulated world has a rig of its own", cure));
    }
    let mut config = SimConfig::parse(source)?;
    config.start_s += options.start_s;
    if let Some(frames) = options.frames {
        let seconds = (frames - 1) as f64 / config.rate_hz;
        config.duration_s = Some(config.duration_s.map_or(seconds, |d| d.min(seconds)));
    }
    SimSource::new(&config)
}

/// `rtsp` of `rtsp://...`; a drive letter is not a scheme.
fn scheme(source: &str) -> Option<&str> {
    let (scheme, _) = source.split_once(':')?;
    let plain = scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-');
    (plain && !Path::new(source).exists()).then_some(scheme)
}

/// What a path is.
enum Found {
    Bag,
    Folder(&'static Kind),
}

/// The folder of the sequence: of a KITTI root with one sequence that one, and `ROOT/NN` is found in `ROOT/sequences`.
fn sequence_of(path: &Path) -> Result<PathBuf, SourceError> {
    let (folder, name) = (path.parent().unwrap_or(Path::new("")), path.file_name().unwrap_or_default());
    if !path.exists() {
        let beneath = [folder.join("sequences").join(name), folder.join("dataset/sequences").join(name)];
        return Ok(beneath.into_iter().find(|p| p.is_dir()).unwrap_or_else(|| path.to_owned()));
    }
    let roots = [path.join("sequences"), path.join("dataset/sequences"), path.to_owned()];
    let Some(root) = roots.into_iter().find(|root| root.ends_with("sequences") && root.is_dir()) else {
        return Ok(path.to_owned());
    };
    let mut all: Vec<PathBuf> = std::fs::read_dir(&root)
        .into_iter()
        .flatten()
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.is_dir() && kitti::is(p))
        .collect();
    all.sort();
    match all.as_slice() {
        [] => Ok(path.to_owned()),
        [one] => Ok(one.clone()),
        [first, ..] => {
            let why = format!("is a KITTI root with {} sequences", all.len());
            let cure = format!("choose one, such as {}", first.display());
            Err(SourceError::new(path.display().to_string(), why, cure))
        }
    }
}

/// The size of a source's images, found without a calibration: for calibrations that do not state it. `None` where
/// nothing can be read, or the source is live.
pub fn image_size(source: &str) -> Option<[usize; 2]> {
    if let Some(size) = live::image_size(source) {
        return Some(size);
    }
    let path = sequence_of(Path::new(source)).ok()?;
    first_image::size(&path)
}

/// Endings of files that hold another, and what unpacks them.
const PACKED: [(&str, &str); 9] = [
    ("zstd", "zstd -d"),
    ("zst", "zstd -d"),
    ("gz", "gunzip (or tar xzf)"),
    ("tgz", "tar xzf"),
    ("bz2", "bunzip2 (or tar xjf)"),
    ("xz", "xz -d (or tar xJf)"),
    ("tar", "tar xf"),
    ("zip", "unzip"),
    ("7z", "7z x"),
];

fn kind_of(path: &Path, asked: Option<SourceKind>) -> Result<Found, SourceError> {
    let shown = path.display().to_string();
    if !path.exists() {
        return Err(SourceError::new(shown, "does not exist", "check the path"));
    }
    if !path.is_dir() && !path.is_file() {
        return Err(SourceError::new(shown, "is a device or a pipe", format!("give a folder; {KNOWN}")));
    }
    if !path.is_dir() {
        if bag::is(path) {
            return Ok(Found::Bag);
        }
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        if let Some((_, with)) = PACKED.iter().find(|(packed, _)| *packed == ending) {
            let cure = format!("unpack it with {with}, and give what comes out");
            return Err(SourceError::new(shown, "is packed as a whole, which is not read", cure));
        }
        let cure = format!("give a folder, a bag or a video; {KNOWN}");
        return Err(SourceError::new(shown, "is a file, not a folder, and neither a bag nor a video", cure));
    }
    if let Some(kind) = asked.and_then(|asked| KINDS.iter().find(|kind| kind.kind == asked)) {
        return Ok(Found::Folder(kind));
    }
    let mut found: Vec<&'static Kind> = KINDS.iter().filter(|kind| (kind.is)(path)).collect();
    // Images beside the files of a data set are not another recording.
    if found.len() > 1 {
        found.retain(|kind| kind.kind != SourceKind::Images);
    }
    // Single .mcap and .db3 files may lie in any folder.
    let bag = (found.is_empty() || path.join("metadata.yaml").is_file()) && bag::is(path);
    match (found.as_slice(), bag) {
        ([], true) => Ok(Found::Bag),
        ([one], false) => Ok(Found::Folder(one)),
        ([], false) => {
            Err(SourceError::new(shown, format!("is not a recording of a known kind; {KNOWN}"), hint(path)))
        }
        (many, _) => {
            let names = many.iter().map(|kind| kind.name).chain(bag.then_some("rosbag2"));
            let names: Vec<&str> = names.collect();
            let why = format!("looks like more than one kind of recording: {}", names.join(" and "));
            Err(SourceError::new(
                shown,
                why,
                "choose one with --as, or move the files that do not belong to it elsewhere",
            ))
        }
    }
}

/// A hint naming a recording inside the folder, if there is one.
fn hint(path: &Path) -> String {
    let mut inside: Vec<_> = std::fs::read_dir(path)
        .into_iter()
        .flatten()
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| bag::is(p) || (p.is_dir() && KINDS.iter().any(|kind| (kind.is)(p))))
        .collect();
    inside.sort();
    match inside.as_slice() {
        [] => first_image::unread(path).unwrap_or_else(|| "check the path".into()),
        [one] => format!("did you mean {}?", one.display()),
        [first, second] if is_pair(first, second) => format!(
            "did you mean {}? Both cameras of a pair are read as mav0/cam0/data and mav0/cam1/data with --rig, or as image_0 and \
             image_1 with calib.txt",
            first.display()
        ),
        [first, ..] => {
            format!("it contains {} recordings; choose one, such as {}", inside.len(), first.display())
        }
    }
}

/// Whether two folders are named as those of the two cameras of a pair.
fn is_pair(first: &Path, second: &Path) -> bool {
    let name =
        |path: &Path| path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let (first, second) = (name(first), name(second));
    let letters = |name: &str| name.chars().filter(|c| c.is_alphabetic()).collect::<String>();
    let are_cameras = letters(&first) == letters(&second)
        && matches!(letters(&first).as_str(), "cam" | "camera" | "image" | "images" | "img");
    are_cameras || (first != second && first.replace("left", "right") == second)
}
