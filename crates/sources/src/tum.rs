//! TUM RGB-D folders: `rgb.txt`, `depth.txt`, `groundtruth.txt`; or an associations file in place of the first two; or the
//! folders `rgb/` and `depth/` alone, whose images are named by their times. ETH3D and Bonn have the same layout, the first
//! with a `calibration.txt`; OpenLORIS calls the lists `color.txt` and `aligned_depth.txt`; ICL-NUIM has numbers of frames for
//! times ([`crate::icl_nuim`]).
//!
//! Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012). Depth is registered to
//! colour; 5000 units are one metre.

use crate::recording::{
    ImageAt, Instant, Recording, apart, in_folder, join_depth, named_by_time, read_index, read_truth,
};
use crate::rig::{self, Document};
use crate::text::{data_lines, fields, numbers, place, read_text, stamp_any, stamp_seconds};
use crate::{decode, first_image, icl_nuim};
use cairn_eval::Format;
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthSensor, Distortion, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Largest time between a colour image and its depth image, nanoseconds.
const MAX_APART_NS: u64 = 20_000_000;

/// True when a folder looks like a TUM RGB-D recording.
pub fn is(folder: &Path) -> bool {
    colour_list(folder).is_file()
        || associations(folder).is_some()
        || (folder.join("depth").is_dir() && !named_by_time(&folder.join("rgb"), stamp_of_name).is_empty())
}

/// The list of colour images: that of TUM, else that of OpenLORIS.
fn colour_list(folder: &Path) -> PathBuf {
    ["rgb.txt", "color.txt"]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|p| p.is_file())
        .unwrap_or(folder.join("rgb.txt"))
}

/// A name with a decimal point, or as long as nanoseconds since 1970, is a time; others are numbers of frames.
fn stamp_of_name(stem: &str) -> Option<Stamp> {
    let is_time = stem.contains('.') || stem.len() >= 16;
    is_time.then(|| if stem.contains('.') { stamp_seconds(stem) } else { stamp_any(stem) }).flatten()
}

/// A file of lines `t colour t depth`, as `associate.py` of the benchmark writes it and ORB-SLAM reads it.
fn associations(folder: &Path) -> Option<PathBuf> {
    const NAMES: [&str; 5] =
        ["associations.txt", "association.txt", "associated.txt", "associate.txt", "assoc.txt"];
    NAMES.iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

/// Indexes the folder. Its rig is the one given, a Cairn or Kalibr file in it, or the published calibration
/// of the camera named by the folder (`freiburg1`, `2`, `3`), or else the ROS default.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let mut name = format!("TUM RGB-D folder {}", folder.display());
    let mut assumed = None;
    let mut rig = match (given, rig::file_in(folder)) {
        (Some(rig), _) => rig,
        (None, Some(path)) => {
            let rig = rig::read_rig(&path)?;
            // Kalibr has no depth sensors; depth is registered to the colour camera, whose poses the ground
            // truth gives.
            let own = path.extension().is_some_and(|e| e == "toml");
            if own { rig } else { rgbd(rig.cameras[0].camera) }
        }
        (None, None) => {
            let own = match calibration_txt(folder)? {
                Some(camera) => Some((camera, "intrinsics of calibration.txt")),
                None => openloris(folder)?.map(|camera| (camera, "intrinsics of sensors.yaml")),
            };
            let (camera, which) = match (own, icl_nuim::poses_file(folder)) {
                (Some(own), _) => own,
                (None, Some(_)) => {
                    (icl_nuim::camera(), "intrinsics of ICL-NUIM, whose fy is negative: y points down here")
                }
                (None, None) => published(folder),
            };
            name += &format!(" ({which})");
            assumed = own.is_none().then(|| which.to_owned());
            let mut rig = rgbd(camera);
            // OpenLORIS has millimetres, as its camera gives them.
            if let (true, Some(depth)) = (folder.join("aligned_depth.txt").is_file(), &mut rig.depth) {
                depth.metres_per_unit = 0.001;
            }
            rig
        }
    };
    rig.cameras.truncate(1);
    rig.imu = None;
    let mut skipped = Vec::new();
    let (mut colour, mut depth) = match (colour_list(folder), associations(folder)) {
        (list, Some(pairs)) if !list.is_file() => read_pairs(&pairs, folder, &mut skipped)?,
        (list, None) if !list.is_file() => {
            let named = |name: &str| named_by_time(&folder.join(name), stamp_of_name);
            (named("rgb"), named("depth"))
        }
        (list, _) => {
            let aligned = folder.join("aligned_depth.txt");
            let depth_file = if aligned.is_file() { aligned } else { folder.join("depth.txt") };
            let depth = match rig.depth.is_some() && depth_file.is_file() {
                true => read_index(&depth_file, stamp_seconds, folder, &mut skipped)?,
                false => Vec::new(),
            };
            (read_index(&list, stamp_seconds, folder, &mut skipped)?, depth)
        }
    };
    if rig.depth.is_none() {
        depth.clear();
    }
    if depth.is_empty() && rig.depth.take().is_some() {
        skipped.extend(unlisted_depth(folder));
    }
    let numbered = icl_nuim::are_numbers(&colour);
    if numbered {
        name += &format!(" (the times are numbers of frames: {} images a second)", icl_nuim::RATE_HZ);
        colour.iter_mut().chain(&mut depth).for_each(|(stamp, _)| *stamp = icl_nuim::at_rate(*stamp));
    }
    let truth = truth(folder, numbered, &mut skipped)?;
    let (apart_ns, half_ns) = apart(&colour, &depth);
    let tolerance_ns = if apart_ns > MAX_APART_NS { half_ns } else { MAX_APART_NS };
    if apart_ns > MAX_APART_NS {
        let apart_ms = apart_ns as f64 / 1e6;
        let text = format!("colour and depth images {apart_ms:.1} ms apart, taken as of one instant");
        skipped.push(Skipped::new(SkipKind::Other, "colour and depth images are apart", text));
    }
    let mut instants: Vec<Instant> = colour
        .into_iter()
        .map(|(stamp, image)| Instant { stamp, images: vec![image], depth: None })
        .collect();
    if let Some(sensor) = rig.depth.as_ref().filter(|d| d.metres_per_unit == 1.0 / 5000.0)
        && let Some(note) = doubt_of_unit(&depth, sensor.metres_per_unit)
    {
        skipped.push(Skipped::new(SkipKind::Other, "the unit of depth is doubtful", note));
    }
    join_depth(&mut instants, depth, tolerance_ns);
    Ok(Recording { name, rig, instants, imu: None, bag: None, truth, no_depth: None, skipped, assumed })
}

/// True poses; those of numbered frames have numbers for times as well.
fn truth(
    folder: &Path,
    numbered: bool,
    skipped: &mut Vec<Skipped>,
) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    if let Some(path) = icl_nuim::poses_file(folder) {
        return icl_nuim::truth(&path, skipped);
    }
    let path = folder.join("groundtruth.txt");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let truth = read_truth(&path, Format::Tum, skipped)?;
    let stamp = |stamp| if numbered { icl_nuim::at_rate(stamp) } else { stamp };
    Ok(truth.into_iter().map(|(at, pose)| (stamp(at), pose)).collect())
}

type Files = Vec<(Stamp, ImageAt)>;

/// Colour and depth images of an associations file, whichever of the two comes first in a line.
fn read_pairs(path: &Path, folder: &Path, skipped: &mut Vec<Skipped>) -> Result<(Files, Files), SourceError> {
    let text = read_text(path)?;
    let (mut colour, mut depth) = (Vec::new(), Vec::new());
    for (number, line) in data_lines(&text) {
        let mut from = fields(line);
        let mut one = || Some((stamp_seconds(from.next()?)?, in_folder(folder, from.next()?)));
        let Some((first, second)) = one().zip(one()) else {
            let why = "not two time stamps, each with a file";
            let text = format!("{}: {why}, line left out", place(path, number));
            skipped.push(Skipped::new(SkipKind::Line, why, text));
            continue;
        };
        let is_depth = |file: &Path| {
            let inside = file.strip_prefix(folder).unwrap_or(file).to_string_lossy().to_ascii_lowercase();
            inside.contains("depth")
        };
        let (c, d) = if is_depth(&first.1) { (second, first) } else { (first, second) };
        colour.push((c.0, ImageAt::File(c.1)));
        depth.push((d.0, ImageAt::File(d.1)));
    }
    if colour.is_empty() {
        let cure = "each line must be: time stamp, colour image, time stamp, depth image";
        return Err(SourceError::new(path.display().to_string(), "names no images", cure));
    }
    Ok((colour, depth))
}

/// What is to be doubted of the unit. Depth cameras see nothing nearer than 0.3 m, so where a twentieth of all depth is nearer by it,
/// but not by millimetres, these are meant. (The nearest of the benchmark's recordings have 0.4 m.) A room is larger than 1.2 m, so
/// where hardly any depth is farther by it, they are meant too: the depth of 7-Scenes' kitchen would end at 0.6 m. In a hall neither
/// tells, but the steps in which a camera measures do ([`step_of_depth`]).
fn doubt_of_unit(depth: &[(Stamp, ImageAt)], metres_per_unit: f64) -> Option<String> {
    let step = depth.len().div_ceil(8).max(1);
    let mut values: Vec<u16> = Vec::new();
    for (_, at) in depth.iter().step_by(step) {
        if let ImageAt::File(path) = at
            && let Ok(image) = decode::depth(path)
        {
            values.extend(image.data().iter().step_by(37).filter(|v| **v > 0));
        }
    }
    if values.len() < 1000 {
        return None;
    }
    let steps = step_of_depth(&values);
    let at = values.len() / 20;
    let [near, far] = [at, values.len() - 1 - at].map(|nth| f64::from(*values.select_nth_unstable(nth).1));
    let (share, units) = match () {
        () if near * metres_per_unit < 0.3 && near * 0.001 >= 0.3 => ("a twentieth", near),
        () if far * metres_per_unit < 1.2 && far * 0.001 >= 1.2 => ("nearly all", far),
        () => {
            let [by_unit, by_mm] =
                [metres_per_unit, 0.001].map(|unit| 1000.0 * steps.unwrap_or(f64::NAN) / unit);
            return STEPS_MM.iter().any(|of| of.contains(&by_mm)).then(|| {
                format!(
                    "5000 units of depth are taken for a metre, but then it comes in steps of {by_unit:.1} mm at a metre, and in \
                     millimetres of {by_mm:.1} mm as that of a Kinect or RealSense: give a rig with metres_per_unit = 0.001 if \
                     distances are five times too small"
                )
            });
        }
    };
    let [by_unit, by_mm] = [metres_per_unit, 0.001].map(|unit| units * unit);
    Some(format!(
        "5000 units of depth are taken for a metre, but then {share} of it is nearer than {by_unit:.2} m, and in \
         millimetres {by_mm:.2} m: give a rig with metres_per_unit = 0.001 if distances are five times too small"
    ))
}

/// The steps of depth at a metre, mm: RealSense D435 (a 32nd of a pixel, 50 mm apart, 380 to 640 px) and Kinect (an eighth, 75 mm,
/// 580 px; 2.9 in 7-Scenes' kitchen). At 5000 units a metre a Kinect's would be taken for 0.6 mm in millimetres.
const STEPS_MM: [RangeInclusive<f64>; 2] = [0.9..=1.7, 2.6..=3.2];

/// Depth by disparity comes in steps that grow with its square, `dz = z^2 / (f b n)` with `n` steps a pixel: the median of `dz / z^2`
/// over the values that occur, in 1/units. `None` where they are not apart, as in depth that was interpolated or timed.
fn step_of_depth(values: &[u16]) -> Option<f64> {
    const CLEAR: u16 = 3;
    const LEAST: usize = 40;
    let levels: BTreeSet<u16> = values.iter().copied().collect();
    let levels: Vec<u16> = levels.into_iter().collect();
    // Only values that are apart by more than the whole numbers of the file: and most from some depth on have to be.
    let from = levels.windows(2).position(|w| w[1] - w[0] >= CLEAR)?;
    let pairs = levels.get(from..)?.windows(2);
    let mut steps: Vec<f64> =
        pairs.map(|w| f64::from(w[1] - w[0]) / (0.5 * (f64::from(w[0]) + f64::from(w[1]))).powi(2)).collect();
    if steps.len() < LEAST {
        return None;
    }
    steps.sort_by(f64::total_cmp);
    let [low, median, high] = [1, 2, 3].map(|k| steps[k * steps.len() / 4]);
    (high < 1.7 * low).then_some(median)
}

/// ETH3D's `calibration.txt`: focal lengths and centre; the size is that of the images.
fn calibration_txt(folder: &Path) -> Result<Option<Camera>, SourceError> {
    let path = folder.join("calibration.txt");
    if !path.is_file() {
        return Ok(None);
    }
    let wrong =
        |why: &str| SourceError::new(path.display().to_string(), why, "write fx fy cx cy, or give --rig");
    let [fx, fy, cx, cy] =
        numbers::<4>(fields(&read_text(&path)?)).ok_or_else(|| wrong("does not hold fx fy cx cy"))?;
    let [width, height] = first_image::size(folder).ok_or_else(|| {
        let why = first_image::unread(folder);
        wrong(&format!(
            "is beside no image that can be read{}",
            why.map_or(String::new(), |why| format!(": {why}"))
        ))
    })?;
    // Of ICL-NUIM people write fy = -480: y points down here.
    Ok(Some(Camera::pinhole(width, height, fx, fy.abs(), cx, cy)))
}

/// OpenLORIS's `sensors.yaml`: size and `fx, cx, fy, cy` of its colour camera, whose lens is without distortion.
fn openloris(folder: &Path) -> Result<Option<Camera>, SourceError> {
    let path = folder.join("sensors.yaml");
    if !path.is_file() {
        return Ok(None);
    }
    let doc = Document::parse(&path, &read_text(&path)?)?;
    let Some(node) = doc.root.get("d400_color_optical_frame") else { return Ok(None) };
    let size = doc.size(node.line, [doc.need_number(node, "width")?, doc.need_number(node, "height")?])?;
    let intrinsics = doc.need(node, "intrinsics")?;
    let &[fx, cx, fy, cy] = doc.matrix(intrinsics, "intrinsics")?.as_slice() else {
        return Err(doc.error(intrinsics.line, "intrinsics need 4 numbers"));
    };
    doc.camera(intrinsics.line, size, [fx, fy, cx, cy], Distortion::None).map(Some)
}

/// That there is depth which no list names.
fn unlisted_depth(folder: &Path) -> Option<Skipped> {
    let there = ["depth", "aligned_depth"].into_iter().find(|name| folder.join(name).is_dir())?;
    let text = format!(
        "{there}/ is not used: no {there}.txt with times lists its images, and their names are no times; one camera without depth"
    );
    Some(Skipped::new(SkipKind::Other, "depth is not read", text))
}

fn rgbd(camera: Camera) -> Rig {
    let depth = DepthSensor {
        camera,
        body_from_depth: Se3::identity(),
        metres_per_unit: 1.0 / 5000.0,
        registered: true,
    };
    Rig { depth: Some(depth), ..Rig::mono(camera) }
}

/// The data set's published colour calibrations, by the name of the folder.
fn published(folder: &Path) -> (Camera, &'static str) {
    let name = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = name.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let with = |[fx, fy, cx, cy]: [f64; 4], distortion| Camera {
        distortion,
        ..Camera::pinhole(640, 480, fx, fy, cx, cy)
    };
    let brown = Distortion::RadialTangential;
    if name.contains("freiburg1") || name.starts_with("fr1") {
        let lens = brown([0.2624, -0.9531, -0.0054, 0.0026, 1.1633]);
        (with([517.3, 516.5, 318.6, 255.3], lens), "published intrinsics of freiburg1")
    } else if name.contains("freiburg2") || name.starts_with("fr2") {
        let lens = brown([0.2312, -0.7849, -0.0033, -0.0001, 0.9172]);
        (with([520.9, 521.0, 325.1, 249.7], lens), "published intrinsics of freiburg2")
    } else if name.contains("freiburg3") || name.starts_with("fr3") {
        (with([535.4, 539.2, 320.1, 247.6], Distortion::None), "published intrinsics of freiburg3")
    } else if name.contains("bonn") {
        let lens = brown([0.039903, -0.099343, -0.000730, -0.000144, 0.0]);
        (
            with([542.822841, 542.576870, 315.593520, 237.756098], lens),
            "published intrinsics of Bonn RGB-D Dynamic",
        )
    } else {
        let which = "no intrinsics given: ROS default fx = fy = 525, centre (319.5, 239.5)";
        (with([525.0, 525.0, 319.5, 239.5], Distortion::None), which)
    }
}
