//! `cairn map info`: summary of saved maps.

use super::{bytes_of, doubts_of, failed};
use crate::failure::Failure;
use crate::output::Output;
use cairn::{Map, routes_of};
use cairn_atlas::store::{DEPTH_PREFIX, MapFile, StoreError, Table, sensor_name};
use cairn_atlas::{MapId, MapScale, Snapshot};
use cairn_guide::{CleanConfig, Route, RouteError, survey};
use cairn_vision::RectifiedCamera;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
struct Info {
    file: PathBuf,
    bytes: u64,
    format: u32,
    program: String,
    sensor: &'static str,
    metric: bool,
    camera: Camera,
    /// The cameras of key frames that are not the atlas's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    other_cameras: Vec<OtherCamera>,
    /// Correction added to every measured right-image x coordinate, as estimated by the map.
    right_offset_px: f64,
    key_frames: usize,
    removed_key_frames: usize,
    landmarks: usize,
    observations: usize,
    /// Key frames that each robot created.
    robots: BTreeMap<u16, usize>,
    maps: Vec<MapReport>,
    routes: Vec<RouteReport>,
    /// What was doubtful of the source when the map was made.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    doubts: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<DepthReport>,
    parts: Vec<Part>,
}

/// The depth images of key frames.
#[derive(Serialize)]
struct DepthReport {
    images: usize,
    submaps: usize,
    bytes: usize,
}

#[derive(Serialize)]
struct Camera {
    focal_px: [f64; 2],
    centre_px: [f64; 2],
    baseline_m: f64,
}

impl Camera {
    fn of(camera: &RectifiedCamera) -> Self {
        Self {
            focal_px: [camera.fx, camera.fy],
            centre_px: [camera.cx, camera.cy],
            baseline_m: camera.baseline_fx / camera.fx,
        }
    }
}

#[derive(Serialize)]
struct OtherCamera {
    sensor: &'static str,
    camera: Camera,
    /// Key frames that it made.
    key_frames: usize,
}

impl OtherCamera {
    fn of(snapshot: &Snapshot, other: &cairn_atlas::OtherCamera) -> Self {
        let its = |k: &&cairn_atlas::KeyFrame| k.other_camera.as_deref() == Some(other);
        Self {
            sensor: sensor_name(other.sensor),
            camera: Camera::of(&other.camera),
            key_frames: snapshot.key_frames().filter(its).count(),
        }
    }
}

#[derive(Serialize)]
struct MapReport {
    /// Number of its root, the oldest key frame.
    root: usize,
    key_frames: usize,
    landmarks: usize,
    /// Smallest and largest coordinates of the key frames' camera centres.
    bounds: [[f64; 3]; 2],
    /// Seconds of the first and the last key frame, in the clock of the source.
    from_s: f64,
    to_s: f64,
    /// What is known of its unit of length.
    scale: ScaleReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    map_prior: Option<MapPriorReport>,
}

/// What is known of a map's unit of length.
#[derive(Serialize)]
#[serde(rename_all = "snake_case", tag = "known")]
enum ScaleReport {
    /// Nothing.
    Unknown,
    /// It was guessed by the walking pace against an earlier map: standard deviation of the logarithm of the scale between both.
    Guessed { sigma_log: f64 },
    /// It is a metre: standard deviation of the logarithm of metres in it.
    Metric { sigma_log: f64 },
}

impl From<MapScale> for ScaleReport {
    fn from(scale: MapScale) -> Self {
        match scale {
            MapScale::Unknown => Self::Unknown,
            MapScale::Guessed { sigma_log } => Self::Guessed { sigma_log },
            MapScale::Metric { sigma_log } => Self::Metric { sigma_log },
        }
    }
}

/// The prior on a map's pose relative to an earlier one, until they are merged.
#[derive(Serialize)]
struct MapPriorReport {
    key_frame: usize,
    sigma: f64,
    sigma_deg: f64,
}

#[derive(Serialize)]
struct RouteReport {
    name: String,
    bytes: usize,
    points: usize,
    /// Length with the current poses of its key frames.
    length_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    damaged: Option<String>,
}

#[derive(Serialize)]
struct Part {
    name: String,
    bytes: u64,
    unpacked: u64,
}

/// All files, in the order given.
#[derive(Serialize)]
struct Infos {
    maps: Vec<Info>,
}

/// Prints a summary of the maps.
///
/// # Errors
/// When a file cannot be read, is not a map or is damaged.
pub fn run(files: &[PathBuf], output: &Output) -> Result<(), Failure> {
    let maps = files.iter().map(|path| info(path)).collect::<Result<_, _>>()?;
    output.result(&Infos { maps }, |all| all.maps.iter().map(text).collect::<Vec<_>>().join("\n"))
}

fn info(path: &Path) -> Result<Info, Failure> {
    let bytes = bytes_of(path)?;
    let table = Table::read(&bytes).map_err(|e| failed(path, &e))?;
    let file = MapFile::read(&bytes).map_err(|e| failed(path, &e))?;
    let all = Map::of_file(&file);
    let (snapshot, camera) = (all.snapshot(), all.camera());
    let part = |p: &cairn_atlas::store::PartInfo| Part {
        name: p.name.clone(),
        bytes: p.stored_bytes,
        unpacked: p.plain_bytes,
    };
    Ok(Info {
        file: path.to_owned(),
        bytes: table.bytes,
        format: table.version,
        program: file.about.program.clone(),
        sensor: sensor_name(file.about.sensor),
        metric: snapshot.is_metric(camera),
        camera: Camera::of(camera),
        other_cameras: snapshot.other_cameras().map(|other| OtherCamera::of(snapshot, other)).collect(),
        right_offset_px: snapshot.right_offset(),
        key_frames: snapshot.key_frame_count(),
        removed_key_frames: snapshot.removed_key_frame_count(),
        landmarks: snapshot.landmark_count(),
        observations: snapshot.landmarks().map(|l| l.observations.len()).sum(),
        robots: snapshot.robots(),
        maps: all.maps().map(|id| map(&all, id)).collect(),
        doubts: doubts_of(&file),
        routes: routes_of(&file)
            .map(|(name, bytes, read)| route(name, bytes.len(), read, snapshot))
            .collect(),
        depth: depth(&file).map_err(|e| failed(path, &e))?,
        parts: table.parts.iter().map(part).collect(),
    })
}

fn depth(file: &MapFile) -> Result<Option<DepthReport>, StoreError> {
    let parts = file.depth()?;
    // Large submaps are saved in several parts, one after the other.
    let continued = parts.windows(2).filter(|w| w[0].submap == w[1].submap).count();
    let images = parts.iter().map(|part| part.images.len()).sum();
    let report = DepthReport { images, submaps: parts.len() - continued, bytes: file.depth_bytes() };
    Ok((!parts.is_empty()).then_some(report))
}

fn map(all: &Map, id: MapId) -> MapReport {
    let snapshot = all.snapshot();
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let mut span = [f64::INFINITY, f64::NEG_INFINITY];
    for k in snapshot.key_frames_of(id) {
        for axis in 0..3 {
            let at = k.world_from_camera.translation[axis];
            bounds[0][axis] = bounds[0][axis].min(at);
            bounds[1][axis] = bounds[1][axis].max(at);
        }
        let t = k.stamp.seconds();
        span = [span[0].min(t), span[1].max(t)];
    }
    let prior = snapshot.maps().find(|(other, _)| *other == id).and_then(|(_, prior)| prior);
    MapReport {
        root: id.root().index(),
        key_frames: snapshot.key_frames_of(id).count(),
        landmarks: all.landmarks(id).count(),
        bounds,
        from_s: span[0],
        to_s: span[1],
        scale: snapshot.scale_of(id, all.camera()).into(),
        map_prior: prior.map(|prior| MapPriorReport {
            key_frame: prior.to.index(),
            sigma: prior.sigma,
            sigma_deg: prior.sigma_rad.to_degrees(),
        }),
    }
}

fn route(name: &str, bytes: usize, read: Result<Route, RouteError>, snapshot: &Snapshot) -> RouteReport {
    let mut report = RouteReport { name: name.to_owned(), bytes, points: 0, length_m: 0.0, damaged: None };
    match read {
        Ok(route) => {
            let here = |anchor: cairn_guide::Anchor| {
                let name = cairn_atlas::KeyFrameName { robot: anchor.robot, seq: anchor.seq };
                snapshot.world_from_here(snapshot.key_frame_named(name)?)
            };
            let (info, ..) = survey(&route, here, &CleanConfig::default());
            (report.points, report.length_m) = (info.points, info.length_m);
        }
        Err(e) => report.damaged = Some(e.to_string()),
    }
    report
}

fn text(i: &Info) -> String {
    let mut text = String::new();
    let unit = if i.metric { "m" } else { "units" };
    // Writing to a string cannot fail.
    let _ = writeln!(text, "file      {}, {:.3} MB", i.file.display(), i.bytes as f64 / 1e6);
    let _ = writeln!(text, "written   by {}, format {}", i.program, i.format);
    let [fx, fy] = i.camera.focal_px;
    let baseline = match (i.camera.baseline_m > 0.0, i.metric) {
        (true, _) => format!(", baseline {:.4} m, right x {:+.3} px", i.camera.baseline_m, i.right_offset_px),
        (false, true) => ", metric scale from the IMU".to_owned(),
        (false, false) => ", without metric scale".to_owned(),
    };
    let _ = writeln!(text, "made with {}, focal length {fx:.2} {fy:.2} px{baseline}", i.sensor);
    for other in &i.other_cameras {
        let [fx, fy] = other.camera.focal_px;
        let baseline = match other.camera.baseline_m > 0.0 {
            true => format!(", baseline {:.4} m", other.camera.baseline_m),
            false => String::new(),
        };
        let _ = writeln!(
            text,
            "and with  {}, focal length {fx:.2} {fy:.2} px{baseline}: {} key frames",
            other.sensor, other.key_frames
        );
    }
    let _ = writeln!(
        text,
        "total     {} key frames ({} removed), {} landmarks, {} observations",
        i.key_frames, i.removed_key_frames, i.landmarks, i.observations
    );
    if i.robots.keys().any(|robot| *robot != 0) {
        let each: Vec<String> = i.robots.iter().map(|(robot, n)| format!("{n} by robot {robot}")).collect();
        let _ = writeln!(text, "key frames {}", each.join(", "));
    }
    for m in &i.maps {
        let [a, b] = m.bounds;
        let _ = writeln!(
            text,
            "map       {}: {} key frames, {} landmarks, {:.1} s, x {:.2} to {:.2}, y {:.2} to {:.2}, z {:.2} to {:.2} {unit}",
            m.root,
            m.key_frames,
            m.landmarks,
            m.to_s - m.from_s,
            a[0],
            b[0],
            a[1],
            b[1],
            a[2],
            b[2]
        );
        let _ = match m.scale {
            ScaleReport::Unknown => writeln!(text, "          lengths in a unit that is not known"),
            ScaleReport::Guessed { sigma_log } => {
                writeln!(text, "          lengths guessed by the walking pace, to {:.0} %", 100.0 * sigma_log)
            }
            ScaleReport::Metric { sigma_log } => {
                writeln!(text, "          metres, with a standard deviation of {:.2} %", 100.0 * sigma_log)
            }
        };
        if let Some(prior) = &m.map_prior {
            let _ = writeln!(
                text,
                "          prior relative to key frame {}, standard deviation {:.2} {unit} and {:.0} degrees",
                prior.key_frame, prior.sigma, prior.sigma_deg
            );
        }
    }
    for r in &i.routes {
        let _ = match &r.damaged {
            Some(why) => writeln!(text, "route     {}: {why}", r.name),
            None => writeln!(text, "route     {}: {} points, {:.2} {unit}", r.name, r.points, r.length_m),
        };
    }
    for doubt in &i.doubts {
        let _ = writeln!(text, "doubtful  {doubt}");
    }
    if let Some(d) = &i.depth {
        let (mb, each) = (d.bytes as f64 / 1e6, d.bytes as f64 / 1e3 / d.images.max(1) as f64);
        let _ = writeln!(
            text,
            "depth     {} images in {} submaps, {mb:.1} MB, {each:.0} kB an image",
            d.images, d.submaps
        );
    }
    // The many parts with features are summed up in one line; those with depth are above.
    let depth = |p: &&&Part| p.name.strip_prefix("attached/").is_some_and(|n| n.starts_with(DEPTH_PREFIX));
    let (features, others): (Vec<&Part>, Vec<&Part>) =
        i.parts.iter().filter(|p| !depth(&p)).partition(|p| p.name.starts_with("features "));
    for p in others {
        let _ = writeln!(text, "part      {}: {} bytes, {} unpacked", p.name, p.bytes, p.unpacked);
    }
    let sum = |of: fn(&Part) -> u64| features.iter().map(|p| of(p)).sum::<u64>();
    let (bytes, unpacked) = (sum(|p| p.bytes), sum(|p| p.unpacked));
    let _ =
        writeln!(text, "part      features: {bytes} bytes, {unpacked} unpacked, in {} parts", features.len());
    text
}
