//! A saved map in the window.

use super::Arguments;
use super::window::Window;
use crate::commands::map::{failed, open};
use crate::failure::Failure;
use crate::output::{Output, note};
use cairn::{Map, routes_of};
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrameId, MapId};
use cairn_dense::{
    BlockKey, ColumnChanges, DenseMap, MapId as DenseMapId, MeshConfig, Mesher, SubmapConfig, TsdfConfig,
};
use cairn_engine::{SavedDepthError, saved_dense_map};
use cairn_geometry::Vec3;
use cairn_session::View;
use cairn_view::{begin, walker};
use cairn_web::{StillSurface, still};
use std::collections::BTreeMap;
use std::path::Path;

/// Landmarks that are shown, at most.
const POINTS: usize = 200_000;
/// Depth images that are fused at once.
const IMAGES: usize = 64;

/// What is shown.
#[derive(serde::Serialize)]
struct Shown {
    /// Number of the map's root.
    map: usize,
    key_frames: usize,
    points: usize,
    loops: usize,
    triangles: usize,
    columns: usize,
}

/// Shows a saved map until the window is closed.
///
/// # Errors
/// When the map cannot be read, or the window cannot be opened.
pub fn show(a: &Arguments, output: &Output) -> Result<(), Failure> {
    let path = Path::new(&a.source);
    let file = open(path)?;
    let map = Map::of_file(&file);
    let roots: Vec<usize> = map.maps().map(|id| id.root().index()).collect();
    let chosen = match a.map {
        Some(root) => map.maps().find(|id| id.root().index() == root),
        None => map.largest(),
    };
    let id = chosen.ok_or_else(|| {
        let why = a.map.map_or_else(|| "it is empty".into(), |root| format!("it has no map {root}"));
        Failure::new(&a.source, why, format!("it has these: {roots:?}"))
    })?;
    // Before the work: who has no window learns so at once.
    let mut window = Window::open(a)?;
    if roots.len() > 1 {
        note(&format!("map {} of {roots:?}; choose another with --map", id.root().index()));
    }
    let mut view = View::of_map(&file.snapshot, Some(id), POINTS);
    // The newest of its routes; others may lie in the other maps.
    for (_, _, route) in routes_of(&file) {
        if let Ok(route) = route {
            view.record(&route, &file.snapshot);
        }
    }
    let up = Vec3::from(view.up.map(f64::from));
    let surface = surface(a, &file, id, &up)?;
    let shown = Shown {
        map: id.root().index(),
        key_frames: view.key_frames.len(),
        points: view.points.len(),
        loops: view.loops.len(),
        triangles: surface.blocks.iter().map(|(_, mesh, _)| mesh.triangles.len()).sum(),
        columns: surface.columns.tiles.len(),
    };
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let first = [begin(&name, map.is_metric(id)), walker(None)];
    let is_open = first.into_iter().chain(still(&view, surface)).all(|message| window.send(&message));
    if is_open {
        output.result(&shown, text)?;
    }
    window.end()
}

/// The surface and the columns; nothing where the map carries no depth.
fn surface(a: &Arguments, file: &MapFile, id: MapId, up: &Vec3) -> Result<StillSurface, Failure> {
    let config = SubmapConfig::default();
    let fail = |e: cairn_dense::DenseError| {
        Failure::new(&a.source, e.to_string(), "change --voxel; see also cairn map check")
    };
    let mut dense = match saved_dense_map(file, config) {
        Ok((dense, _)) => dense,
        Err(SavedDepthError::NoDepth) => return Ok(StillSurface::default()),
        Err(SavedDepthError::Store(e)) => return Err(failed(Path::new(&a.source), &e)),
        Err(SavedDepthError::Dense(e)) => return Err(fail(e)),
    };
    let of = DenseMapId(id.root().index() as u64);
    let tsdf = TsdfConfig { voxel_m: a.voxel, ..config.tsdf };
    let blocks = blocks(&mut dense, file, of, tsdf).map_err(fail)?;
    while dense.step(&Vec3::zeros(), IMAGES).waiting > 0 {}
    let columns = ColumnChanges::new().of(&dense, Some(of), up, &Vec3::zeros(), usize::MAX);
    Ok(StillSurface { voxel_m: a.voxel, blocks, columns: columns.map_err(fail)? })
}

/// The meshes of the whole map, and when the key frame that saw each first was made, tenths of a second from the first.
fn blocks(
    dense: &mut DenseMap,
    file: &MapFile,
    of: DenseMapId,
    tsdf: TsdfConfig,
) -> Result<Vec<(BlockKey, cairn_dense::Mesh, u32)>, cairn_dense::DenseError> {
    let first = file.snapshot.key_frames().map(|k| k.stamp.0).min().unwrap_or_default();
    let tenths = |anchor: cairn_dense::AnchorId| {
        let id = KeyFrameId::from_index(anchor.0 as usize)?;
        let since_ns = file.snapshot.key_frame(id)?.stamp.0 - first;
        u32::try_from(since_ns / 100_000_000).ok()
    };
    let (mut born, mut revision) = (BTreeMap::<BlockKey, u32>::new(), 0);
    let volume = dense.fuse_in_order(of, tsdf, |anchor, volume| {
        let now = tenths(anchor).unwrap_or_default();
        for key in volume.changed_since(revision) {
            born.entry(key).or_insert(now);
        }
        revision = volume.revision();
    })?;
    let mut mesher = Mesher::new(MeshConfig::of_key_frames());
    let meshes = mesher.changed(&volume, 0).filter(|(_, mesh)| !mesh.triangles.is_empty());
    Ok(meshes.map(|(key, mesh)| (key, mesh, born.get(&key).copied().unwrap_or_default())).collect())
}

fn text(s: &Shown) -> String {
    let depth = match s.triangles {
        0 => "no depth".to_owned(),
        n => format!("{n} triangles, {} tiles of columns", s.columns),
    };
    format!("map {}: {} key frames, {} points, {} loops, {depth}", s.map, s.key_frames, s.points, s.loops)
}
