//! From the eye's data to the solver's.

use cairn_solve::{Pinhole, Pixel};
use cairn_vision::{EyeModel, Frame, Octaves};

/// The solver's camera of an eye.
pub fn pinhole(eye: &EyeModel) -> Pinhole {
    Pinhole { fx: eye.fx, fy: eye.fy, cx: eye.cx, cy: eye.cy, baseline_fx: eye.baseline_fx }
}

/// The solver's pixel of a feature.
pub fn pixel(frame: &Frame, feature: usize) -> Pixel {
    let [u, v] = frame.px[feature];
    [u as f64, v as f64, frame.right_x[feature] as f64]
}

/// Inverse variance of a feature: one pixel at its own level.
pub fn weight(frame: &Frame, feature: usize, octaves: &Octaves) -> f64 {
    octaves.scale(frame.octave[feature]).powi(-2)
}
