//! From the eye's data to the solver's.

use cairn_atlas::Map;
use cairn_solve::{Pinhole, Pixel};
use cairn_vision::{EyeModel, Frame, Octaves};

/// The solver's camera of an eye.
pub fn pinhole(eye: &EyeModel) -> Pinhole {
    Pinhole { fx: eye.fx, fy: eye.fy, cx: eye.cx, cy: eye.cy, baseline_fx: eye.baseline_fx }
}

/// The solver's pixel of a feature, its right x as the map has calibrated it.
pub fn pixel(map: &Map, frame: &Frame, feature: usize) -> Pixel {
    let [u, v] = frame.px[feature];
    [u as f64, v as f64, frame.right_x[feature] as f64 + map.right_offset()]
}

/// Depth of a feature in metres, as the map has calibrated it; NaN where there is none or it is beyond all measure.
pub fn depth(map: &Map, eye: &EyeModel, frame: &Frame, feature: usize) -> f64 {
    let disparity = eye.baseline_fx / frame.depth[feature] as f64 - map.right_offset();
    if disparity > 0.0 { eye.baseline_fx / disparity } else { f64::NAN }
}

/// Inverse variance of a feature: one pixel at its own level.
pub fn weight(frame: &Frame, feature: usize, octaves: &Octaves) -> f64 {
    octaves.scale(frame.octave[feature]).powi(-2)
}
