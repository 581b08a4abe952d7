//! `--mesh`: surfaces from the depth of key frames, with the final poses.

use super::arguments::Arguments;
use crate::failure::Failure;
use crate::outputs::Outputs;
use crate::surface::{Surface, form};
use cairn_dense::SubmapConfig;
use cairn_engine::{DenseMapper, Engine, SensorMode};
use cairn_sensor::Rig;
use cairn_session::Session;

/// A dense mapper that follows the engine, if a surface is wanted.
///
/// # Errors
/// Without depth, or with an ending that names no form.
pub fn begin(a: &Arguments, engine: &mut Engine, rig: &Rig) -> Result<Option<DenseMapper>, Failure> {
    let Some(path) = &a.mesh else { return Ok(None) };
    form(path)?;
    DenseMapper::new(engine, rig, SubmapConfig::default())
        .map(Some)
        .map_err(|e| Failure::usage("--mesh", e.to_string(), "give a source with depth and --sensor rgbd"))
}

/// Writes the surface.
///
/// # Errors
/// When nothing was fused or the file cannot be written.
pub fn write(
    mapper: Option<&mut DenseMapper>,
    outputs: &Outputs,
    a: &Arguments,
    engine: &Engine,
) -> Result<(), Failure> {
    let (Some(mapper), Some(path)) = (mapper, &a.mesh) else { return Ok(()) };
    outputs.write("--mesh", || {
        let surface = Surface::of(mapper, engine.snapshot().is_gravity_aligned_throughout())?;
        surface.bytes(form(path)?, &path.display().to_string())
    })
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
