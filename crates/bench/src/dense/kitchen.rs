//! The kitchen recording in memory, and what all sections share.

use crate::MeasureError;
use crate::processor::now_ms;
use cairn_dense::{Backend, DenseError, DepthConfig, DepthFrame, DepthPreparer, TsdfConfig, TsdfVolume};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthImage, Image};
use cairn_sources::{OpenOptions, open};
use std::path::Path;
use std::sync::Arc;

/// Frames of the recording.
const FRAMES: usize = 300;
/// Every how many of them are fused.
const EVERY: usize = 5;

/// Edges of voxels that are measured, in metres.
pub const VOXELS_M: [f64; 3] = [0.05, 0.02, 0.01];

/// All frames with their poses.
pub struct Kitchen {
    pub camera: Camera,
    metres_per_unit: f64,
    /// Depth and `world_from_camera` of each frame.
    pub all: Vec<(Arc<DepthImage>, Se3)>,
    /// Those that are fused: prepared, with a colour image.
    pub fused: Vec<(DepthFrame, Image<[u8; 3]>, Se3)>,
}

impl Kitchen {
    /// Reads the recording.
    ///
    /// # Errors
    /// When it is missing, short, or has frames without depth or pose.
    pub fn read(data: &Path) -> Result<Self, MeasureError> {
        let folder = data.join("7scenes-kitchen");
        let mut source = open(&folder.to_string_lossy(), OpenOptions::default())?;
        let sensor = source.rig().depth.clone().ok_or("the recording has no depth sensor")?;
        let truth = source.info().truth.clone();
        let mut kitchen = Self {
            camera: sensor.camera,
            metres_per_unit: sensor.metres_per_unit,
            all: Vec::new(),
            fused: Vec::new(),
        };
        let mut preparer = kitchen.preparer(Backend::best())?;
        while let Some(packet) = source.next_packet()? {
            let number = kitchen.all.len();
            if number == FRAMES {
                break;
            }
            let pose = truth.iter().find(|(stamp, _)| *stamp == packet.stamp);
            let (_, pose) = pose.ok_or_else(|| format!("frame {number} has no pose"))?;
            let depth = packet.depth.clone().ok_or_else(|| format!("frame {number} has no depth"))?;
            if number.is_multiple_of(EVERY) {
                let frame = preparer.prepare(&depth)?.clone();
                let gray = packet.images.first().ok_or_else(|| format!("frame {number} has no image"))?;
                let colour = gray.data().iter().map(|&v| [v; 3]).collect();
                let colour = Image::from_vec(gray.width(), gray.height(), colour);
                kitchen.fused.push((frame, colour.ok_or("a short image")?, *pose));
            }
            kitchen.all.push((depth, *pose));
        }
        if kitchen.all.len() < FRAMES {
            return Err(format!("{} has {} of {FRAMES} frames", folder.display(), kitchen.all.len()).into());
        }
        Ok(kitchen)
    }

    /// A preparer of the recording's depth.
    pub fn preparer(&self, backend: Backend) -> Result<DepthPreparer, DenseError> {
        Ok(DepthPreparer::new(DepthConfig::default(), self.camera, self.metres_per_unit)?
            .with_backend(backend))
    }

    /// Metres of a unit of depth.
    pub fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    /// Depth images of the fused frames, as recorded.
    pub fn raw(&self) -> impl Iterator<Item = &DepthImage> + Clone {
        self.all.iter().step_by(EVERY).map(|(depth, _)| &**depth)
    }

    /// Twelve frames that are not fused.
    pub fn held_out(&self) -> impl Iterator<Item = &(Arc<DepthImage>, Se3)> {
        self.all.iter().skip(12).step_by(25)
    }

    /// The field of all fused frames at one size of voxels, with the best instructions and without colour.
    pub fn plain(&self, voxel_m: f64) -> Result<TsdfVolume, DenseError> {
        let mut volume = TsdfVolume::new(TsdfConfig { voxel_m, ..TsdfConfig::default() })?;
        for (frame, _, pose) in &self.fused {
            volume.integrate(frame, None, pose)?;
        }
        Ok(volume)
    }
}

/// The least time of several repetitions in milliseconds, and the last result.
pub fn least<T>(
    repetitions: usize,
    mut work: impl FnMut() -> Result<T, DenseError>,
) -> Result<(f64, T), DenseError> {
    let mut timed = || {
        let start = now_ms();
        let out = std::hint::black_box(work()?);
        Ok((now_ms() - start, out))
    };
    let mut best = timed()?;
    for _ in 1..repetitions {
        let (ms, out) = timed()?;
        best = (ms.min(best.0), out);
    }
    Ok(best)
}

/// The median; NaN of nothing.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
