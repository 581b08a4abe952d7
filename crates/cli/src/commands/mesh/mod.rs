//! `cairn mesh`: the surface of a recording with depth, or of a saved map that carries depth, as a file.

mod recording;
mod saved;

use crate::failure::Failure;
use crate::output::Output;
use crate::outputs::Outputs;
use crate::surface::{Surface, form};
use cairn_dense::{DepthConfig, TsdfConfig};
use cairn_geometry::Vec3;
use std::path::{Path, PathBuf};

/// Fuses the depth images of a recording or of a saved map into a surface and writes it as PLY, glTF (.glb), OBJ, or heights along gravity (.pgm).
///
/// Poses of a recording are its own, or those of a trajectory (as `cairn run --trajectory` writes it). A map carries depth
/// when it was saved by `cairn run --dense --map-out`; its poses are those of its key frames.
#[derive(clap::Args)]
pub struct Arguments {
    /// A recording with depth, a simulated world with depth (sim:...), or a saved map.
    source: String,
    /// The file to write; its ending chooses the form: .ply, .glb or .obj, or .pgm for a heightmap.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The calibration of a recording, in place of its own or of one that would be assumed.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Poses of the body in TUM, KITTI or EuRoC form, in place of the recording's own.
    #[arg(long, value_name = "FILE")]
    poses: Option<PathBuf>,
    /// Edge of a voxel in metres.
    #[arg(long, visible_alias = "voxel-m", default_value_t = TsdfConfig::default().voxel_m, value_name = "M")]
    voxel: f64,
    /// Depths farther than this are left out, in metres.
    #[arg(long, default_value_t = DepthConfig::default().farthest_m, value_name = "M")]
    farthest: f64,
    /// Drop isolated pieces of the surface that are smaller than this across, in metres: what noise leaves floating in the air.
    #[arg(long, value_name = "M")]
    drop_isolated: Option<f64>,
    /// Only every so many frames of a recording.
    #[arg(long, default_value_t = 1, value_name = "N")]
    every: usize,
    /// Replace the file if it exists.
    #[arg(long)]
    overwrite: bool,
}

/// How many isolated pieces were dropped, in words.
fn dropped(isolated: usize) -> String {
    if isolated > 0 { format!(", {isolated} isolated pieces dropped") } else { String::new() }
}

/// Reads the source, fuses, writes.
///
/// # Errors
/// When the source cannot be used or the file cannot be written.
pub fn run(a: &Arguments, output: &Output) -> Result<(), Failure> {
    if a.drop_isolated.is_some_and(|m| m.is_nan() || m < 0.0) {
        return Err(Failure::usage("--drop-isolated", "is not a length", "give metres, such as 0.3"));
    }
    let name = a.out.display().to_string();
    let write = form(&a.out)?;
    let outputs = Outputs::new(a.overwrite)
        .input("the source", Some(Path::new(&a.source)))
        .input("--poses", a.poses.as_deref())
        .input("--rig", a.rig.as_deref())
        .output("--out", Some(&a.out))
        .checked()?;
    if saved::is_map(&a.source) {
        let (surface, report) = saved::fuse(a)?;
        outputs.write("--out", || surface.bytes(write, &name))?;
        return output.result(&report, saved::text);
    }
    let (mesh, mut report) = recording::fuse(a)?;
    // A camera's world begins with y down.
    let surface = Surface { mesh, up: -Vec3::y() };
    outputs.write("--out", || surface.bytes(write, &name))?;
    report.file = name;
    output.result(&report, |r| {
        let lost = match (r.without_pose, r.refused) {
            (0, 0) => String::new(),
            (a, b) => format!(" ({a} frames had no pose, {b} no usable depth)"),
        };
        format!(
            "{} frames fused{lost}: {} vertices, {} triangles{} in {}",
            r.frames,
            r.vertices,
            r.triangles,
            dropped(r.isolated),
            r.file
        )
    })
}
