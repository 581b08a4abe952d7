//! The surface of a saved map that carries depth.

use super::Arguments;
use crate::commands::map::{doubts_of, failed, open};
use crate::failure::Failure;
use crate::output::warn;
use crate::surface::Surface;
use cairn_dense::{DepthConfig, MapId, MeshConfig, SubmapConfig, TsdfConfig};
use cairn_engine::{SavedDepthError, saved_dense_map};
use cairn_geometry::Vec3;
use std::cmp::Reverse;
use std::path::Path;

/// What was made.
#[derive(serde::Serialize)]
pub struct Report {
    /// Number of the map's root.
    pub map: usize,
    /// Depth images that were fused.
    pub images: usize,
    /// Images of other maps in the file, whose place relative to this one is not known.
    pub other_maps: usize,
    /// Images of another depth camera, and images whose key frame is not in the map.
    pub other_camera: usize,
    pub lost: usize,
    pub vertices: usize,
    pub triangles: usize,
    /// Isolated pieces that were dropped.
    pub isolated: usize,
    pub file: String,
}

/// Whether a path names a saved map.
pub fn is_map(path: &str) -> bool {
    use std::io::Read;
    let mut start = [0; 8];
    let path = Path::new(path);
    // Not the address of a stream, nor a pipe, whose first bytes would be gone.
    path.is_file()
        && std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == cairn_atlas::store::MAGIC
}

/// The surface of the map with the most depth.
///
/// # Errors
/// When the file is damaged, carries no depth, or its depth cannot be fused.
pub fn fuse(a: &Arguments) -> Result<(Surface, Report), Failure> {
    let path = Path::new(&a.source);
    if a.poses.is_some() || a.every != 1 {
        let option = if a.poses.is_some() { "--poses" } else { "--every" };
        let hint = "leave it out, or give the recording in place of the map";
        return Err(Failure::usage(option, "a saved map has its own poses and frames", hint));
    }
    let file = open(path)?;
    doubts_of(&file).iter().for_each(|doubt| warn(&format!("doubtful when the map was made: {doubt}")));
    let tsdf = TsdfConfig { voxel_m: a.voxel, colour: true, ..TsdfConfig::default() };
    let depth = DepthConfig { farthest_m: a.farthest, ..DepthConfig::default() };
    let config = SubmapConfig { depth, tsdf, ..SubmapConfig::default() };
    let dense = |e: cairn_dense::DenseError| {
        Failure::new(&a.source, e.to_string(), "change --voxel or --farthest; see also cairn map check")
    };
    let (mut map, restored) = saved_dense_map(&file, config).map_err(|e| match e {
        SavedDepthError::NoDepth => {
            let hint = "walk there again with a depth sensor and cairn run --dense --map-out";
            Failure::new(&a.source, "the map carries no depth, so it has no surface", hint)
        }
        SavedDepthError::Store(e) => failed(path, &e),
        SavedDepthError::Dense(e) => dense(e),
    })?;
    let id_of = |map: cairn_atlas::MapId| MapId(map.root().index() as u64);
    let maps = file.snapshot.maps().map(|(id, _)| id);
    let largest = maps.min_by_key(|id| Reverse(map.images_of(id_of(*id))));
    let largest = largest.filter(|_| restored.images > 0).ok_or_else(|| {
        Failure::new(&a.source, "no depth image belongs to one of its key frames", "use a backup")
    })?;
    let images = map.images_of(id_of(largest));
    let mut mesh = map.surface(id_of(largest), tsdf, MeshConfig::of_key_frames()).map_err(dense)?;
    let isolated = a.drop_isolated.map_or(0, |m| mesh.drop_isolated(m));
    let report = Report {
        map: largest.root().index(),
        images,
        other_maps: restored.images - images,
        other_camera: restored.other_camera,
        lost: restored.lost,
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        isolated,
        file: a.out.display().to_string(),
    };
    // A map without gravity begins with y down.
    let up = if file.snapshot.is_gravity_aligned(largest) { Vec3::z() } else { -Vec3::y() };
    Ok((Surface { mesh, up }, report))
}

/// The report as text.
pub fn text(r: &Report) -> String {
    let left_out = [
        (r.other_maps, "of other maps in the file"),
        (r.other_camera, "of another depth camera"),
        (r.lost, "without their key frame"),
    ];
    let left_out: Vec<String> =
        left_out.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}")).collect();
    let left_out =
        if left_out.is_empty() { String::new() } else { format!(" (left out: {})", left_out.join(", ")) };
    format!(
        "{} depth images of map {} fused{left_out}: {} vertices, {} triangles{} in {}",
        r.images,
        r.map,
        r.vertices,
        r.triangles,
        super::dropped(r.isolated),
        r.file
    )
}
