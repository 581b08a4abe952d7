//! A wall with a step in it, as a depth camera sees it: the scene of the tests on histories of a map, here and in the
//! engine. The file that takes it in as a module imports what it names from `super`.

#![allow(dead_code)]

use super::{Camera, DepthImage, OccupancyConfig, Se3, So3, SubmapConfig, TsdfConfig, Vec3};

/// Edge of the field's voxels in metres.
pub const VOXEL_M: f64 = 0.05;
/// The wall is [`BACK_M`] away left of here, and [`FRONT_M`] right of it, in metres along x.
pub const STEP_X_M: f64 = 0.5;
/// Distance of the left part along z, in metres.
pub const BACK_M: f64 = 2.0;
/// Distance of the right part.
pub const FRONT_M: f64 = 1.7;

/// A small camera.
pub fn camera() -> Camera {
    Camera::pinhole(80, 60, 70.0, 70.0, 39.5, 29.5)
}

/// Submaps of 5 cm, which a walk along the wall fills quickly.
pub fn config() -> SubmapConfig {
    SubmapConfig {
        tsdf: TsdfConfig { voxel_m: VOXEL_M, ..TsdfConfig::default() },
        occupancy: OccupancyConfig { voxel_m: 0.1, ..OccupancyConfig::default() },
        reach_m: 1.5,
        ..SubmapConfig::default()
    }
}

/// Depth in millimetres as a camera at `x` metres sees it that looks along z.
pub fn wall(x: f64) -> DepthImage {
    let at = |i: usize| {
        let slope = ((i % 80) as f64 - 39.5) / 70.0;
        let side = (STEP_X_M - x) / slope;
        let z = if x + slope * FRONT_M > STEP_X_M {
            FRONT_M
        } else if x < STEP_X_M && (FRONT_M..BACK_M).contains(&side) {
            side
        } else {
            BACK_M
        };
        (z * 1000.0 + 0.5) as u16
    };
    DepthImage::from_vec(80, 60, (0..80 * 60).map(at).collect()).expect("all pixels")
}

/// A camera at `x`, turned by the first two numbers and raised by the third.
pub fn pose(x: f64, wobble: [f64; 3]) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, wobble[0], wobble[1])), Vec3::new(x, wobble[2], 0.0))
}
