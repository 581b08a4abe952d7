//! `cairn map export`: landmarks as PLY, key frames as a trajectory, recorded routes as files, the ground as a grid, and all for
//! photogrammetry.

use super::{open, photogrammetry};
use crate::failure::Failure;
use crate::number::number;
use crate::output::Output;
use crate::outputs::Outputs;
use cairn::{Map, routes_of};
use cairn_atlas::store::MapFile;
use cairn_atlas::{Landmark, LandmarkId, MapId};
use cairn_dense::{MapId as DenseMapId, MeshConfig, Occupancy, OccupancyConfig, SubmapConfig, TsdfConfig};
use cairn_engine::{SavedDepthError, saved_dense_map};
use cairn_eval::to_tum;
use cairn_geometry::Vec3;
use cairn_plan::band::{BandConfig, Ground, Voxel};
use cairn_plan::map_server::{Mode, save};
use cairn_plan::sparse::{Seen, SparseConfig, grid_of};
use serde::Serialize;
use std::fmt::Write;
use std::fs::File;
use std::io::Write as _;
use std::ops::Bound;
use std::path::{Path, PathBuf};

/// Exports landmarks as points (PLY), key frames as a trajectory (TUM), recorded routes as files, the ground as a grid, and models for photogrammetry.
#[derive(clap::Args)]
pub struct Arguments {
    /// The saved map.
    file: PathBuf,
    /// Writes the landmarks, with mean viewing direction and number of observing key frames.
    #[arg(long, value_name = "OUT.ply")]
    points: Option<PathBuf>,
    /// Writes the pose of the body at each key frame.
    #[arg(long, value_name = "OUT.tum")]
    trajectory: Option<PathBuf>,
    /// Writes each recorded route to a file in this folder; existing files are not overwritten.
    #[arg(long, alias = "ways", value_name = "DIR")]
    routes: Option<PathBuf>,
    /// Writes the ground as a ROS map_server map, a PGM beside it. From depth, where the map carries it (cairn run --dense): what stands
    /// 0.1 to 2 m above the ground is an obstacle, seen through is free. With --camera-height from landmarks: where the camera went is
    /// free, landmarks at the height of a body are obstacles. All else is unknown.
    #[arg(long, value_name = "OUT.yaml")]
    grid: Option<PathBuf>,
    /// Height of the camera above the ground in metres: --grid then uses landmarks. The map must be level (recorded with an IMU).
    #[arg(long, value_name = "M", 
        value_parser = number((Bound::Excluded(0.0), Bound::Excluded(100.0)), "above 0 and below 100"), requires = "grid")]
    camera_height: Option<f64>,
    #[command(flatten)]
    photogrammetry: photogrammetry::Arguments,
    /// Which map of the file, by the number of its root key frame; by default the one with the most key frames.
    #[arg(long, alias = "world", value_name = "ROOT")]
    map: Option<usize>,
    /// Replace the files of --points, --trajectory, --grid, --colmap and --nerfstudio if they exist.
    #[arg(long)]
    overwrite: bool,
}

#[derive(Serialize)]
struct Exported {
    /// Number of its root key frame.
    map: usize,
    /// Other maps in the file.
    others: Vec<usize>,
    landmarks: usize,
    key_frames: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    trajectory: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    grid: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    photogrammetry: Option<photogrammetry::Report>,
    routes: Vec<PathBuf>,
}

/// Writes the requested files.
///
/// # Errors
/// When nothing is requested, the map cannot be read, or a file cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let shown = a.file.display().to_string();
    let has_model = a.photogrammetry.is_requested()?;
    if a.points.is_none() && a.trajectory.is_none() && a.routes.is_none() && a.grid.is_none() && !has_model {
        return Err(Failure::new(
            shown,
            "nothing to write was requested",
            "give --points OUT.ply, --trajectory OUT.tum, --grid OUT.yaml, --routes DIR, --colmap DIR or --nerfstudio DIR",
        ));
    }
    let pgm = a.grid.as_ref().map(|yaml| yaml.with_extension("pgm"));
    let outputs = Outputs::new(a.overwrite)
        .input("the map", Some(&a.file))
        .output("--points", a.points.as_deref())
        .output("--trajectory", a.trajectory.as_deref())
        .output("--grid", a.grid.as_deref())
        .output("the image of --grid", pgm.as_deref())
        .checked()?;
    let file = open(&a.file)?;
    let map = Map::of_file(&file);
    let roots: Vec<usize> = map.maps().map(|id| id.root().index()).collect();
    let id = chosen(&map, a.map).ok_or_else(|| {
        let (why, hint) = match a.map {
            Some(root) => (format!("it has no map {root}"), format!("it has these: {roots:?}")),
            None => ("the file is empty".to_owned(), "give a map with key frames".to_owned()),
        };
        Failure::new(shown, why, hint)
    })?;
    a.photogrammetry.prepare(a.overwrite)?;
    let landmarks: Vec<&Landmark> = map.landmarks(id).collect();
    let (routes, failed) = a.routes.as_deref().map(|folder| write_routes(&file, folder)).unwrap_or_default();
    let points = outputs.write("--points", || Ok(ply(&landmarks).into_bytes()));
    let trajectory = outputs.write("--trajectory", || Ok(to_tum(&map.trajectory(id)).into_bytes()));
    let grid = match (&a.grid, a.camera_height) {
        (Some(yaml), Some(height_m)) => write_grid(&map, id, height_m, yaml, &a.file),
        (Some(yaml), None) => write_grid_of_depth(&file, id, yaml, &a.file),
        (None, _) => Ok(()),
    };
    let model = has_model.then(|| a.photogrammetry.write(&a.file, &file, &map, id)).transpose();
    let (photogrammetry, model) = model.map_or_else(|e| (None, Err(e)), |report| (report, Ok(())));
    Failure::all([points, trajectory, grid, model].into_iter().filter_map(Result::err).chain(failed))?;
    let root = id.root().index();
    let exported = Exported {
        map: root,
        others: roots.into_iter().filter(|r| *r != root).collect(),
        landmarks: landmarks.len(),
        key_frames: map.key_frames(id).count(),
        points: a.points.clone(),
        trajectory: a.trajectory.clone(),
        grid: a.grid.clone(),
        photogrammetry,
        routes,
    };
    output.result(&exported, text)
}

/// Writes the ground of a level map.
fn write_grid(map: &Map, id: MapId, height_m: f64, yaml: &Path, file: &Path) -> Result<(), Failure> {
    let snapshot = map.snapshot();
    if !snapshot.is_gravity_aligned(id) {
        let hint = "record with an IMU, or lay a grid from depth while driving";
        return Err(Failure::new(
            file.display().to_string(),
            "which way is up in this map is not known",
            hint,
        ));
    }
    let position = |l: &Option<LandmarkId>| Some(snapshot.landmark((*l)?)?.position);
    let seen: Vec<Seen> = snapshot
        .key_frames_of(id)
        .map(|k| Seen {
            from: k.world_from_camera.translation,
            landmarks: k.landmarks.iter().filter_map(position).collect(),
        })
        .collect();
    let failed =
        |why: String| Failure::new(yaml.display().to_string(), why, "check --camera-height and the folder");
    let grid = grid_of(&seen, &SparseConfig::new(height_m)).map_err(|e| failed(e.to_string()))?;
    save(yaml, &grid.to_map(), Mode::Trinary).map_err(|e| failed(e.to_string()))
}

/// Writes the ground of a map that carries depth. Where gravity is not known, up is what was up in the images, made exact by the surfaces that
/// are nearly level.
fn write_grid_of_depth(file: &MapFile, id: MapId, yaml: &Path, path: &Path) -> Result<(), Failure> {
    let fail = |why: String, hint: &str| Failure::new(path.display().to_string(), why, hint);
    let (mut dense, _) = saved_dense_map(file, SubmapConfig::default()).map_err(|e| match e {
        SavedDepthError::NoDepth => {
            let hint = "record with a depth sensor and cairn run --dense, or give --camera-height for a grid from landmarks";
            fail("the map carries no depth".into(), hint)
        }
        SavedDepthError::Store(e) => super::failed(path, &e),
        SavedDepthError::Dense(e) => fail(e.to_string(), "see cairn map check"),
    })?;
    let of = DenseMapId(id.root().index() as u64);
    let tsdf = TsdfConfig { voxel_m: BandConfig::default().resolution_m, ..TsdfConfig::default() };
    let mesh = dense.surface(of, tsdf, MeshConfig::of_key_frames());
    let mesh = mesh.map_err(|e| fail(e.to_string(), "see cairn map check"))?;
    let point = |p: &[f32; 3]| Vec3::new(p[0].into(), p[1].into(), p[2].into());
    let surface: Vec<_> = mesh.positions.iter().map(point).zip(mesh.normals.iter().map(point)).collect();
    let ground = if file.snapshot.is_gravity_aligned(id) {
        Ground::below(&surface, &Vec3::z())
    } else {
        let cameras = file.snapshot.key_frames_of(id).map(|k| k.world_from_camera.rotation * -Vec3::y());
        Ground::near(&surface, &cameras.sum())
    };
    let ground = ground
        .ok_or_else(|| fail("its depth shows no level surface".into(), "record a part of the floor too"))?;
    let config = OccupancyConfig { voxel_m: tsdf.voxel_m, ..OccupancyConfig::default() };
    let voxels =
        dense.occupancy_of_all(of, config).map_err(|e| fail(e.to_string(), "see cairn map check"))?;
    let voxel = |p: &Vec3| match voxels.at(p) {
        Occupancy::Occupied => Voxel::Occupied,
        Occupancy::Free => Voxel::Free,
        Occupancy::Unknown => Voxel::Unknown,
    };
    let grid = ground.grid(surface.iter().map(|s| s.0), voxel, &BandConfig::default());
    let written = grid
        .map_err(|e| e.to_string())
        .and_then(|grid| save(yaml, &grid, Mode::Trinary).map_err(|e| e.to_string()));
    written.map_err(|why| Failure::new(yaml.display().to_string(), why, "check the folder"))
}

fn chosen(map: &Map, root: Option<usize>) -> Option<MapId> {
    match root {
        Some(root) => map.maps().find(|id| id.root().index() == root),
        None => map.largest(),
    }
}

fn ply(landmarks: &[&Landmark]) -> String {
    let mut text = String::from("ply\nformat ascii 1.0\n");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "element vertex {}", landmarks.len());
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(text, "property float {name}");
    }
    text += "property uint observations\nend_header\n";
    for l in landmarks {
        let (p, n) = (l.position, l.normal);
        let observations = l.observations.len();
        let _ = writeln!(
            text,
            "{:.5} {:.5} {:.5} {:.4} {:.4} {:.4} {observations}",
            p.x, p.y, p.z, n.x, n.y, n.z
        );
    }
    text
}

/// Writes each route to a new file named after it; returns the files written and what failed.
fn write_routes(file: &MapFile, folder: &Path) -> (Vec<PathBuf>, Vec<Failure>) {
    let (mut written, mut failed) = (Vec::new(), Vec::new());
    for (name, bytes, _) in routes_of(file) {
        // A name stored in a map must not be used as a path.
        let plain = Path::new(name).file_name().and_then(|n| n.to_str()) == Some(name);
        let path = folder.join(format!("{name}.route"));
        let created = match plain {
            true => File::options().write(true).create_new(true).open(&path),
            false => Err(std::io::Error::other("the name of the route is not a valid file name")),
        };
        match created.and_then(|mut out| out.write_all(bytes)) {
            Ok(()) => written.push(path),
            Err(e) => {
                let hint = "give an existing folder without routes of these names";
                failed.push(Failure::new(path.display().to_string(), e.to_string(), hint));
            }
        }
    }
    (written, failed)
}

fn text(e: &Exported) -> String {
    let mut text = format!("map       {}: {} landmarks, {} key frames\n", e.map, e.landmarks, e.key_frames);
    if !e.others.is_empty() {
        let _ = writeln!(text, "others    {:?}: each has its own frame; choose one with --map", e.others);
    }
    text += &e.photogrammetry.as_ref().map(photogrammetry::Report::text).unwrap_or_default();
    let folders = e.photogrammetry.iter().flat_map(|model| &model.folders);
    for path in [&e.points, &e.trajectory, &e.grid].into_iter().flatten().chain(folders).chain(&e.routes) {
        let _ = writeln!(text, "written   {}", path.display());
    }
    text
}
