//! Colour and depth in numbered files, as several data sets and scanning apps have them:
//!
//! | | colour | depth | calibration | poses and times |
//! |---|---|---|---|---|
//! | Replica (as NICE-SLAM renders it) | `results/frame000000.jpg` | `results/depth000000.png` | `cam_params.json` here or above | `traj.txt` |
//! | ScanNet | `color/0.jpg` | `depth/0.png`, mm | `intrinsic/intrinsic_color.txt`, `..._depth.txt` | `pose/0.txt` |
//! | Stray Scanner | `rgb.mp4` or `rgb/000000.jpg` | `depth/000000.png`, mm | `camera_matrix.csv` | times of `odometry.csv` |
//! | others | `rgb/`, `color/`, `image/`: numbered | `depth/`, mm | `camera_intrinsic.json` of Open3D, else a guess | `traj_w_c.txt`, `times.txt` |
//! | Record3D | `rgb/0.jpg`, or `rgbd/0.jpg` of an unzipped .r3d | none that is read (EXR, LZFSE) | `metadata.json`, `metadata` | times or rate there |
//!
//! Stray Scanner's `imu.csv` is used where gravity is in it ([`crate::stray`]). Without times they are played at 30 images a
//! second, which is told.

use crate::android::phone_from_camera;
use crate::live::Film;
use crate::numbered::{NumberedError, NumberedImage, image_size, numbered_after, numbered_somehow};
use crate::record3d;
use crate::recording::{ImageAt, ImuAt, Instant, Recording};
use crate::stray::{self, Motion};
use crate::text::{data_lines, fields, in_range, numbers, read_text};
use crate::{first_image, images, rig, tum};
use cairn_eval::pose_from_matrix;
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Images a second where nothing states it.
const NOMINAL_HZ: f64 = 30.0;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    Replica,
    ScanNet,
    Stray,
    Record3d,
    /// Colour and depth in folders of the usual names, and no more.
    Plain,
}

/// What people call the folder of colour images beside `depth`.
const COLOURS: [&str; 5] = ["rgb", "color", "colour", "image", "images"];

/// The folder of colour images beside one of depth, where nothing else tells what they are.
fn plain(folder: &Path) -> Option<&'static str> {
    let is_listed = tum::is(folder) || !folder.join("depth").is_dir();
    COLOURS.into_iter().find(|name| !is_listed && numbered_somehow(&folder.join(name)).is_ok())
}

impl Layout {
    fn of(folder: &Path) -> Option<Self> {
        let file = |name: &str| folder.join(name).is_file();
        if file("traj.txt") && folder.join("results").is_dir() {
            Some(Self::Replica)
        } else if folder.join("color").is_dir() && intrinsics_file(folder, "color").is_file() {
            Some(Self::ScanNet)
        } else if file("odometry.csv") && file("camera_matrix.csv") {
            Some(Self::Stray)
        } else if record3d::metadata(folder).is_some() {
            Some(Self::Record3d)
        } else {
            plain(folder).map(|_| Self::Plain)
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Replica => "Replica",
            Self::ScanNet => "ScanNet",
            Self::Stray => "Stray Scanner",
            Self::Record3d => "Record3D",
            Self::Plain => "RGB-D",
        }
    }

    /// Folder and beginning of the names of colour and depth.
    fn images(self, folder: &Path) -> [(&'static str, &'static str); 2] {
        match self {
            Self::Replica => [("results", "frame"), ("results", "depth")],
            Self::ScanNet => [("color", ""), ("depth", "")],
            Self::Record3d if folder.join("rgbd").is_dir() => [("rgbd", ""), ("depth", "")],
            Self::Stray | Self::Record3d => [("rgb", ""), ("depth", "")],
            Self::Plain => [(plain(folder).unwrap_or("rgb"), ""), ("depth", "")],
        }
    }

    /// The numbered images of a folder, after this beginning of their names.
    fn numbered(self, folder: &Path, prefix: &str) -> Result<Vec<NumberedImage>, NumberedError> {
        match self {
            Self::Plain => numbered_somehow(folder),
            _ => numbered_after(folder, prefix),
        }
    }
}

/// True when a folder has one of these layouts.
pub fn is(folder: &Path) -> bool {
    Layout::of(folder).is_some()
}

/// Indexes the folder; its rig is the one given, a Cairn or Kalibr file in it, or its own calibration.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let shown = folder.display().to_string();
    let Some(layout) = Layout::of(folder) else {
        return Err(SourceError::new(shown, "is no folder of numbered frames", "choose another --as"));
    };
    let [_, (depth, of_depth)] = layout.images(folder);
    let depth = folder.join(depth);
    let mut skipped = Vec::new();
    let rows = if layout == Layout::Stray { stray::rows(folder)? } else { Vec::new() };
    let colour = colour(layout, folder, &rows)?;
    let mut imu = None;
    let own = ["camera_intrinsic.json", "intrinsic.json"].map(|name| folder.join(name));
    let own = own.into_iter().find(|path| layout == Layout::Plain && path.is_file());
    let mut assumed = None;
    let mut rig = match (given, rig::file_in(folder).or(own)) {
        (Some(rig), _) => rig,
        (None, Some(path)) => rig::read_rig(path)?,
        (None, None) => {
            let rig = own_rig(layout, folder, &colour)?;
            let focal = rig.cameras[0].camera.fx;
            assumed = (layout == Layout::Plain)
                .then(|| format!("a focal length of {focal:.0} px (0.7 of the longer side), no distortion"));
            rig
        }
    };
    if layout == Layout::Plain && rig.depth.is_none() && rig.cameras.len() == 1 {
        let unit = "depth in millimetres, registered to the camera";
        assumed = Some(assumed.map_or(unit.to_owned(), |camera| format!("{camera}; {unit}")));
        rig.depth = Some(sensor(rig.cameras[0].camera, true));
    }
    if layout == Layout::Stray {
        imu = motion(folder, &rows, &mut rig, &mut skipped);
    }
    rig.cameras.truncate(1);
    rig.imu = rig.imu.filter(|_| imu.is_some());
    let depths: BTreeMap<usize, PathBuf> = match rig.depth.is_some() && depth.is_dir() {
        true => layout
            .numbered(&depth, of_depth)
            .unwrap_or_default()
            .into_iter()
            .map(|f| (f.number, f.path))
            .collect(),
        false => BTreeMap::new(),
    };
    if depths.is_empty() && rig.depth.take().is_some() && layout != Layout::Record3d {
        let why = first_image::unread(&depth).map_or(String::new(), |why| format!(" ({why})"));
        let text = format!("{} has no numbered PNG{why}: one camera without depth", depth.display());
        skipped.push(Skipped::new(SkipKind::Other, "depth is not read", text));
    }
    if layout == Layout::Record3d {
        let what = "Record3D's depth (EXR or LZFSE) is not read: one camera without depth";
        skipped.push(Skipped::new(SkipKind::Other, "depth is not read", what));
    }
    let (times, poses) = (times(layout, folder, &rows, &colour)?, poses(layout, folder)?);
    let note = match &times {
        Times::Rate(hz, false) => format!(" (without times: {hz} images a second)"),
        Times::Rate(hz, true) => format!(" ({hz} images a second, as it states)"),
        Times::Each(_) => String::new(),
    };
    let (mut instants, mut truth) = (Vec::new(), Vec::new());
    for (number, image) in colour {
        let stamp = match &times {
            Times::Rate(hz, _) => in_range((number as f64 * 1e9 / hz) as i64).unwrap_or(Stamp(0)),
            Times::Each(times) => match times.get(&number) {
                Some(stamp) => *stamp,
                None => {
                    let why = "it has no time";
                    let text = format!("image {number}: {why}, left out");
                    skipped.push(Skipped::new(SkipKind::Frame, why, text));
                    continue;
                }
            },
        };
        truth.extend(poses.get(&number).map(|pose| (stamp, *pose)));
        let depth = depths.get(&number).cloned().map(ImageAt::File);
        instants.push(Instant { stamp, images: vec![image], depth });
    }
    Ok(Recording {
        name: format!("{} folder {shown}{note}", layout.name()),
        rig,
        instants,
        imu,
        bag: None,
        truth,
        no_depth: None,
        skipped,
        assumed,
    })
}

/// The colour images with their numbers: files, else the film of Stray Scanner.
fn colour(layout: Layout, folder: &Path, rows: &[stray::Row]) -> Result<Vec<(usize, ImageAt)>, SourceError> {
    let [(name, frame), _] = layout.images(folder);
    let (images, film) = (folder.join(name), folder.join("rgb.mp4"));
    if !images.is_dir() && film.is_file() {
        Film::open(&film).map_err(|e| {
            let cure = format!(
                "or take the images out of it elsewhere: mkdir {0} && ffmpeg -noautorotate -i {1} -q:v 2 -start_number 0 {0}/%06d.jpg",
                images.display(),
                film.display()
            );
            SourceError::new(film.display().to_string(), format!("cannot be read ({e})"), cure)
        })?;
        return Ok(rows
            .iter()
            .enumerate()
            .map(|(k, r)| (r.number, ImageAt::Film(film.clone(), k)))
            .collect());
    }
    let files = layout
        .numbered(&images, frame)
        .map_err(|e| SourceError::new(folder.display().to_string(), e.to_string(), "check the images"))?;
    Ok(files.into_iter().map(|file| (file.number, ImageAt::File(file.path))).collect())
}

/// Columns and rows of the first colour image.
fn size(folder: &Path, colour: &[(usize, ImageAt)]) -> Result<[usize; 2], SourceError> {
    let mut files = colour.iter().filter_map(|(_, at)| match at {
        ImageAt::File(path) => crate::decode::size(path).ok(),
        ImageAt::Film(path, 0) => Film::open(path).ok().map(|film| film.size()),
        _ => None,
    });
    let none = || {
        SourceError::new(folder.display().to_string(), "not a single image can be read", "check the images")
    };
    files.next().ok_or_else(none)
}

/// The IMU of Stray Scanner: with the camera in the axes of the phone, unless a rig with an IMU was given.
fn motion(folder: &Path, rows: &[stray::Row], rig: &mut Rig, skipped: &mut Vec<Skipped>) -> Option<ImuAt> {
    match stray::motion(folder, rows) {
        Motion::Missing => None,
        Motion::LeftOut(why) => {
            let text = format!("{why}; the IMU is not used");
            skipped.push(Skipped::new(SkipKind::Other, "the IMU is not used", text));
            None
        }
        Motion::Used(path, columns, sensor) => {
            if rig.imu.is_none() {
                let phone_from_body = Se3::new(phone_from_camera(), Vec3::zeros());
                rig.cameras
                    .iter_mut()
                    .for_each(|c| c.body_from_camera = phone_from_body * c.body_from_camera);
                rig.depth.iter_mut().for_each(|d| d.body_from_depth = phone_from_body * d.body_from_depth);
                rig.imu = Some(sensor);
            }
            Some(ImuAt::Csv(path, columns))
        }
    }
}

fn intrinsics_file(folder: &Path, of: &str) -> PathBuf {
    let name = format!("intrinsic_{of}.txt");
    let inner = folder.join("intrinsic").join(&name);
    if inner.is_file() { inner } else { folder.join(name) }
}

fn own_rig(layout: Layout, folder: &Path, colour: &[(usize, ImageAt)]) -> Result<Rig, SourceError> {
    match layout {
        Layout::Replica => {
            let files = [folder.join("cam_params.json"), folder.join("../cam_params.json")];
            let found = files.iter().find(|path| path.is_file());
            rig::read_rig(found.ok_or_else(|| {
                SourceError::new(
                    files[0].display().to_string(),
                    "is missing, also above",
                    "give one with --rig",
                )
            })?)
        }
        Layout::ScanNet => {
            let camera = of_matrix(&intrinsics_file(folder, "color"), 4, size(folder, colour)?)?;
            let path = intrinsics_file(folder, "depth");
            let depth_size = image_size(&folder.join("depth")).ok().filter(|_| path.is_file());
            let depth = depth_size.map(|size| of_matrix(&path, 4, size)).transpose()?;
            Ok(Rig { depth: depth.map(|depth| sensor(depth, false)), ..Rig::mono(camera) })
        }
        Layout::Stray => {
            let camera = of_matrix(&folder.join("camera_matrix.csv"), 3, size(folder, colour)?)?;
            Ok(Rig { depth: Some(sensor(camera, true)), ..Rig::mono(camera) })
        }
        Layout::Record3d => record3d::rig(folder, size(folder, colour)?),
        Layout::Plain => {
            let [width, height] = size(folder, colour)?;
            Ok(Rig::mono(Camera::guessed(width, height)))
        }
    }
}

/// Depth in millimetres.
fn sensor(camera: Camera, registered: bool) -> DepthSensor {
    DepthSensor { camera, body_from_depth: Se3::identity(), metres_per_unit: 0.001, registered }
}

/// A camera of a file with a matrix of rows of `columns` numbers.
fn of_matrix(path: &Path, columns: usize, [w, h]: [usize; 2]) -> Result<Camera, SourceError> {
    let text = read_text(path)?;
    let wrong = || {
        SourceError::new(path.display().to_string(), "is no 3x3 or 4x4 matrix", "correct it, or give --rig")
    };
    let all: Vec<f64> = fields(&text).map(|f| f.parse().unwrap_or(f64::NAN)).collect();
    if all.len() < 3 * columns {
        return Err(wrong());
    }
    checked(path, Camera::pinhole(w, h, all[0], all[columns + 1], all[2], all[columns + 2]))
}

fn checked(path: &Path, camera: Camera) -> Result<Camera, SourceError> {
    let wrong = |why: String| SourceError::new(path.display().to_string(), why, "correct it, or give --rig");
    camera.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(camera)
}

/// When images were taken.
enum Times {
    /// So many a second, and whether the recording states it.
    Rate(f64, bool),
    /// Each by its number.
    Each(BTreeMap<usize, Stamp>),
}

fn times(
    layout: Layout,
    folder: &Path,
    rows: &[stray::Row],
    colour: &[(usize, ImageAt)],
) -> Result<Times, SourceError> {
    if layout == Layout::Plain {
        let file =
            |(_, at): &(usize, ImageAt)| if let ImageAt::File(path) = at { Some(path.clone()) } else { None };
        let files: Vec<PathBuf> = colour.iter().filter_map(file).collect();
        if let Some(stamps) = images::stamps(folder, &files)? {
            return Ok(Times::Each(colour.iter().map(|(number, _)| *number).zip(stamps).collect()));
        }
    }
    Ok(nominal_times(layout, folder, rows, colour))
}

fn nominal_times(layout: Layout, folder: &Path, rows: &[stray::Row], colour: &[(usize, ImageAt)]) -> Times {
    if layout == Layout::Stray {
        return Times::Each(rows.iter().map(|row| (row.number, row.stamp)).collect());
    }
    if layout == Layout::Record3d {
        if let Some(stamps) = record3d::stamps(folder).filter(|stamps| stamps.len() >= colour.len()) {
            return Times::Each(stamps.into_iter().enumerate().collect());
        }
        return record3d::rate_hz(folder).map_or(Times::Rate(NOMINAL_HZ, false), |hz| Times::Rate(hz, true));
    }
    Times::Rate(NOMINAL_HZ, false)
}

/// True poses of the camera by the number of its frame; those that are not finite are left out.
fn poses(layout: Layout, folder: &Path) -> Result<BTreeMap<usize, Se3>, SourceError> {
    let of = |text: &str| pose_from_matrix(&numbers::<16>(fields(text))?).ok();
    match layout {
        Layout::Replica => {
            let text = read_text(&folder.join("traj.txt"))?;
            Ok(data_lines(&text).enumerate().filter_map(|(k, (_, line))| Some((k, of(line)?))).collect())
        }
        Layout::ScanNet => {
            let folder = folder.join("pose");
            Ok(numbered_texts(&folder)
                .filter_map(|(n, path)| Some((n, of(&read_text(&path).ok()?)?)))
                .collect())
        }
        Layout::Plain => {
            let path = ["traj_w_c.txt", "traj.txt"].map(|name| folder.join(name));
            let Some(path) = path.into_iter().find(|path| path.is_file()) else { return Ok(BTreeMap::new()) };
            let text = read_text(&path)?;
            Ok(data_lines(&text).enumerate().filter_map(|(k, (_, line))| Some((k, of(line)?))).collect())
        }
        Layout::Stray | Layout::Record3d => Ok(BTreeMap::new()),
    }
}

fn numbered_texts(folder: &Path) -> impl Iterator<Item = (usize, PathBuf)> {
    std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| {
        let path = entry.ok()?.path();
        let number = path.file_stem()?.to_str()?.parse().ok()?;
        path.extension().is_some_and(|e| e == "txt").then_some((number, path))
    })
}
