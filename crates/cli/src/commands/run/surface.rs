//! `--mesh` and `--dense`: surfaces from the depth of key frames with the final poses, and that depth in saved maps.

use super::arguments::Arguments;
use super::sink::Ended;
use crate::commands::map::failed;
use crate::failure::Failure;
use crate::output::warn;
use crate::outputs::Outputs;
use crate::surface::{Surface, form};
use cairn_atlas::store::MapFile;
use cairn_dense::{SubmapConfig, TsdfConfig};
use cairn_engine::{DenseMapper, DenseSetupError, Engine, SensorMode};
use cairn_sensor::Rig;
use cairn_session::Session;
use std::path::Path;

/// Whether surfaces are asked for.
pub fn is_wanted(a: &Arguments) -> bool {
    a.mesh.is_some() || a.dense
}

/// How submaps are made.
pub fn config(a: &Arguments) -> SubmapConfig {
    let submaps = SubmapConfig::default();
    SubmapConfig { tsdf: TsdfConfig { colour: a.colour, ..submaps.tsdf }, ..submaps }
}

/// A dense mapper that follows the engine, if a surface is wanted or the opened map has depth; it goes on from that
/// depth, which is taken out of the file, and looks for a lost camera in it. Depth that cannot be continued stays there, to be saved as it is.
///
/// # Errors
/// Without depth, with an ending that names no form, or with depth in the map that cannot be read.
pub fn begin(
    a: &Arguments,
    engine: &mut Engine,
    rig: &Rig,
    map_in: Option<&mut MapFile>,
) -> Result<Option<DenseMapper>, Failure> {
    a.mesh.as_deref().map(form).transpose()?;
    let asked = a.mesh.as_ref().map(|_| "--mesh").or(a.dense.then_some("--dense"));
    if a.colour && asked.is_none() {
        return Err(Failure::usage("--colour", "colours are those of surfaces", "add --mesh or --dense"));
    }
    let saved = map_in.as_ref().is_some_and(|file| file.depth_bytes() > 0);
    if asked.is_none() && !saved {
        return Ok(None);
    }
    let mut mapper = match (DenseMapper::new(engine, rig, config(a)), asked) {
        (Ok(mapper), _) => mapper,
        (Err(DenseSetupError::NoDepth), None) => return Ok(None),
        (Err(e @ DenseSetupError::NoColours), _) => {
            return Err(Failure::usage("--colour", e.to_string(), "leave it out"));
        }
        (Err(e), _) => {
            let what = asked.unwrap_or("the depth of the map");
            return Err(Failure::usage(what, e.to_string(), "give a source with depth and --sensor rgbd"));
        }
    };
    if let (Some(file), Some(path)) = (map_in, &a.map_in) {
        let (restored, others) = mapper.restore(file.take_depth().map_err(|e| failed(path, &e))?);
        file.add_depth(&others);
        let shown = path.display();
        if restored.other_camera > 0 {
            let n = restored.other_camera;
            warn(&format!("{shown}: {n} depth images are of another depth camera: kept, but not continued"));
        }
        if restored.lost > 0 {
            warn(&format!("{shown}: {} depth images belong to no key frame and are left out", restored.lost));
        }
    }
    Ok(Some(mapper))
}

/// Writes the surface, of a run that has poses.
///
/// # Errors
/// When nothing was fused or the file cannot be written.
pub fn write(outputs: &Outputs, path: &Path, ended: &mut Ended) -> Result<(), Failure> {
    match ended.outcome().report.tracked {
        0 => Ok(()),
        _ => outputs.write("--mesh", || ended.run.surface(path)),
    }
}

/// The surface in the form of the ending of this file.
///
/// # Errors
/// When nothing was fused.
pub fn bytes(mapper: &mut DenseMapper, gravity_aligned: bool, path: &Path) -> Result<Vec<u8>, Failure> {
    Surface::of(mapper, gravity_aligned)?.bytes(form(path)?, &path.display().to_string())
}

/// Watches the walker's way, if that is wanted.
///
/// # Errors
/// Without depth.
pub fn watch_way(a: &Arguments, session: &mut Session, rig: &Rig, mode: SensorMode) -> Result<(), Failure> {
    if !a.watch_way {
        return Ok(());
    }
    let watched = mode == SensorMode::Rgbd
        && session.watch_way(rig).map_err(|e| {
            Failure::new("the depth sensor of the rig", e.to_string(), "correct it with --rig")
        })?;
    match watched {
        true => Ok(()),
        false => {
            Err(Failure::usage("--watch-way", "needs depth", "give a source with depth and --sensor rgbd"))
        }
    }
}
