//! What is made of a field: meshes, ray casts, and their depth in images that were not fused.

use super::Row;
use super::kitchen::{Kitchen, VOXELS_M, least, median};
use crate::processor::now_ms;
use cairn_dense::{Backend, DenseError, MeshConfig, Mesher, TsdfConfig, TsdfVolume, raycast};

/// Greatest depth of a ray in metres, and of a measured depth that counts.
const FARTHEST_M: [f64; 2] = [6.0, 5.0];

/// Depth of the surface against measured depth in frames that were not fused.
pub fn quality(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let mut rows = Vec::new();
    for voxel_m in VOXELS_M {
        let volume = kitchen.plain(voxel_m)?;
        let (mut errors, mut measured) = (Vec::new(), 0usize);
        for (image, pose) in kitchen.held_out() {
            let cast = raycast(&volume, &kitchen.camera, pose, FARTHEST_M[0])?;
            for (&raw, &z) in image.data().iter().zip(cast.depth_m.data()) {
                let truth = f64::from(raw) * kitchen.metres_per_unit();
                if raw == 0 || truth > FARTHEST_M[1] {
                    continue;
                }
                measured += 1;
                if z > 0.0 {
                    errors.push((f64::from(z) - truth).abs());
                }
            }
        }
        let share = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
        let within = share(errors.iter().filter(|e| **e < 0.05).count(), errors.len());
        let seen = share(errors.len(), measured);
        let what = |s: &str| format!("held-out depth {:.0} cm, {s}", voxel_m * 100.0);
        let goal = |row: Row| if voxel_m == 0.02 { row } else { Row { goal: None, ..row } };
        rows.push(goal(Row::at_most(what("median error"), median(errors) * 1e3, "mm", 8.6)));
        rows.push(goal(Row::at_least(what("within 5 cm"), within, "%", 94.0)));
        rows.push(Row::told(what("of the measured pixels"), seen, "%"));
    }
    Ok(rows)
}

/// Meshes, whole and by the blocks that an image changes.
pub fn mesh(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let mut rows = Vec::new();
    for (voxel_m, goal) in VOXELS_M.into_iter().zip([3.0, 20.0, 110.0]) {
        let volume = kitchen.plain(voxel_m)?;
        let mut mesher = Mesher::new(MeshConfig::default());
        let (ms, mesh) = least(5, || Ok(mesher.whole(&volume)))?;
        let what = format!("mesh {:.0} cm, {} triangles", voxel_m * 100.0, mesh.triangles.len());
        rows.push(Row::at_most(what, ms, "ms", goal));
    }
    let backends = Backend::ALL.into_iter().rev().filter(|backend| backend.available());
    for (backend, voxel_m) in backends.flat_map(|backend| VOXELS_M.map(|voxel_m| (backend, voxel_m))) {
        let mut volume = TsdfVolume::new(TsdfConfig { voxel_m, ..TsdfConfig::default() })?;
        let mut mesher = Mesher::new(MeshConfig::default()).with_backend(backend);
        let mut times = Vec::new();
        for (frame, _, pose) in &kitchen.fused {
            let revision = volume.revision();
            volume.integrate(frame, None, pose)?;
            let start = now_ms();
            mesher.changed(&volume, revision).for_each(|piece| drop(std::hint::black_box(piece)));
            times.push(now_ms() - start);
        }
        let what = format!("mesh {:.0} cm, changed blocks, {backend:?}, median", voxel_m * 100.0);
        rows.push(match backend == Backend::best() {
            true => Row::at_most(what, median(times), "ms a frame", 2.0),
            false => Row::told(what, median(times), "ms a frame"),
        });
    }
    Ok(rows)
}

/// Depth and normals of a view, by rays.
pub fn casts(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    const VIEWS: usize = 4;
    let mut rows = Vec::new();
    for voxel_m in VOXELS_M {
        let volume = kitchen.plain(voxel_m)?;
        let (ms, ()) = least(5, || {
            for (_, pose) in kitchen.held_out().take(VIEWS) {
                std::hint::black_box(raycast(&volume, &kitchen.camera, pose, FARTHEST_M[0])?);
            }
            Ok(())
        })?;
        let what = format!("ray cast 640x480, {:.0} cm", voxel_m * 100.0);
        rows.push(Row::at_most(what, ms / VIEWS as f64, "ms", 40.0));
    }
    Ok(rows)
}
