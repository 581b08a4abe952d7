//! Fusion of depth into fields and occupancy, and the memory that takes.

use super::Row;
use super::kitchen::{Kitchen, VOXELS_M, least};
use crate::memory::resident_mb;
use cairn_dense::{Backend, ColourImage, DenseError, OccupancyConfig, OccupancyGrid, TsdfConfig, TsdfVolume};

/// Goals in milliseconds a frame at 5, 2 and 1 cm: with AVX-512, and half of Open3D's time (3.1, 7.3 and 18.9 ms) with
/// AVX2.
const GOALS_MS: [(Backend, [f64; 3]); 2] =
    [(Backend::Avx512, [1.0, 1.5, 3.0]), (Backend::Avx2, [1.55, 3.65, 9.45])];
/// Repetitions; the least counts.
const TIMES: usize = 5;

/// Times a frame, each prepared and fused at once.
pub fn fusion(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let n = kitchen.fused.len() as f64;
    let mut rows = Vec::new();
    for (backend, goals) in GOALS_MS.into_iter().filter(|(b, _)| b.available()) {
        let mut preparer = kitchen.preparer(backend)?;
        let (prepare_ms, ()) = least(TIMES, || {
            for image in kitchen.raw() {
                std::hint::black_box(preparer.prepare(image)?);
            }
            Ok(())
        })?;
        rows.push(Row::told(format!("preparing depth, {backend:?}"), prepare_ms / n, "ms a frame"));
        for (voxel_m, goal) in VOXELS_M.into_iter().zip(goals) {
            let cm = voxel_m * 100.0;
            let config = TsdfConfig { voxel_m, ..TsdfConfig::default() };
            let plain_ms = least(TIMES, || fused(kitchen, config, backend))?.0 / n;
            rows.push(Row::at_most(format!("TSDF {cm:.0} cm, {backend:?}"), plain_ms, "ms a frame", goal));
            let config = TsdfConfig { colour: true, ..config };
            let colour_ms = least(TIMES, || fused(kitchen, config, backend))?.0 / n;
            let what = format!("TSDF {cm:.0} cm with colour, {backend:?}");
            rows.push(Row::at_most(what, colour_ms, "ms a frame", 2.0 * plain_ms));
        }
    }
    for voxel_m in [0.05, 0.02] {
        let (ms, _) = least(TIMES, || occupancy(kitchen, voxel_m))?;
        rows.push(Row::told(format!("occupancy {:.0} cm", voxel_m * 100.0), ms / n, "ms a frame"));
    }
    let mut preparer = kitchen.preparer(Backend::best())?;
    let (ms, _) = least(TIMES, || {
        let mut both = Both::new()?;
        for (image, (_, _, pose)) in kitchen.raw().zip(&kitchen.fused) {
            let frame = preparer.prepare(image)?;
            both.tsdf.integrate(frame, None, pose)?;
            both.occupancy.integrate(frame, pose)?;
        }
        Ok(both)
    })?;
    rows.push(Row::at_most("TSDF and occupancy together, 2 cm", ms / n, "ms a frame", 3.0));
    Ok(rows)
}

/// The field of all images, each prepared just before.
fn fused(kitchen: &Kitchen, config: TsdfConfig, backend: Backend) -> Result<TsdfVolume, DenseError> {
    let mut preparer = kitchen.preparer(backend)?;
    let mut volume = TsdfVolume::new(config)?.with_backend(backend);
    for (image, (_, colour, pose)) in kitchen.raw().zip(&kitchen.fused) {
        let colour = config.colour.then(|| ColourImage::from_rgb(colour));
        volume.integrate(preparer.prepare(image)?, colour.as_ref(), pose)?;
    }
    Ok(volume)
}

fn occupancy(kitchen: &Kitchen, voxel_m: f64) -> Result<OccupancyGrid, DenseError> {
    let mut grid = OccupancyGrid::new(OccupancyConfig { voxel_m, ..OccupancyConfig::default() })?;
    for (frame, _, pose) in &kitchen.fused {
        grid.integrate(frame, pose)?;
    }
    Ok(grid)
}

/// Field and occupancy at 2 cm.
struct Both {
    tsdf: TsdfVolume,
    occupancy: OccupancyGrid,
}

impl Both {
    fn new() -> Result<Self, DenseError> {
        let config = OccupancyConfig { voxel_m: 0.02, ..OccupancyConfig::default() };
        Ok(Self { tsdf: TsdfVolume::new(TsdfConfig::default())?, occupancy: OccupancyGrid::new(config)? })
    }
}

/// How much the process grows for field and occupancy of the whole recording at 2 cm, preparer and scratch included.
pub fn memory(kitchen: &Kitchen) -> Result<Vec<Row>, DenseError> {
    let before = resident_mb();
    let mut preparer = kitchen.preparer(Backend::best())?;
    let mut both = Both::new()?;
    for (image, (_, _, pose)) in kitchen.raw().zip(&kitchen.fused) {
        let frame = preparer.prepare(image)?;
        both.tsdf.integrate(frame, None, pose)?;
        both.occupancy.integrate(frame, pose)?;
    }
    let mut rows = Vec::new();
    match before.zip(resident_mb()) {
        Some((before, after)) => {
            let what = "growth of the process, TSDF and occupancy at 2 cm";
            rows.push(Row::at_most(what, after - before, "MB", 20.0));
        }
        None => eprintln!("skipped: resident memory is not told here"),
    }
    rows.push(Row::told("of it the field", both.tsdf.bytes() as f64 / 1e6, "MB"));
    rows.push(Row::told("of it the occupancy", both.occupancy.bytes() as f64 / 1e6, "MB"));
    Ok(rows)
}
