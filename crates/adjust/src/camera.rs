//! From the camera and features of the front end to those of the solver.

use cairn_atlas::Snapshot;
use cairn_solve::{Pinhole, Pixel};
use cairn_vision::{Frame, Octaves, RectifiedCamera};

/// The solver's camera.
pub fn pinhole(camera: &RectifiedCamera) -> Pinhole {
    Pinhole { fx: camera.fx, fy: camera.fy, cx: camera.cx, cy: camera.cy, baseline_fx: camera.baseline_fx }
}

/// The solver's pixel of a feature, its right x as the map has calibrated it.
pub fn pixel(snapshot: &Snapshot, frame: &Frame, feature: usize) -> Pixel {
    let [u, v] = frame.px[feature];
    [u as f64, v as f64, frame.right_x[feature] as f64 + snapshot.right_offset()]
}

/// Depth of a feature in metres, as the map has calibrated it; NaN where there is none or it is beyond all measure.
pub fn depth(snapshot: &Snapshot, camera: &RectifiedCamera, frame: &Frame, feature: usize) -> f64 {
    let disparity = camera.baseline_fx / frame.depth[feature] as f64 - snapshot.right_offset();
    if disparity > 0.0 { camera.baseline_fx / disparity } else { f64::NAN }
}

/// Inverse variance of a feature: one pixel at its own level.
pub fn weight(frame: &Frame, feature: usize, octaves: &Octaves) -> f64 {
    octaves.scale(frame.octave[feature]).powi(-2)
}
