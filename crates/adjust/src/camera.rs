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
    let [u, v, right_x] = frame.pixel_with(feature, snapshot.readout().seconds);
    [u, v, right_x + snapshot.right_offset()]
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

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Atlas, Change};
    use cairn_geometry::Se3;

    #[test]
    fn pixel_depth_and_weight_of_a_feature_are_as_the_map_has_calibrated_it() {
        let camera = RectifiedCamera {
            fx: 400.0,
            fy: 400.0,
            cx: 320.0,
            cy: 240.0,
            baseline_fx: 40.0,
            bounds: [0.0, 0.0, 640.0, 480.0],
            close_depth: 5.0,
            body_from_camera: Se3::identity(),
        };
        let mut frame = Frame::default();
        (frame.px, frame.right_x, frame.depth) = (vec![[100.0, 50.0]], vec![90.0], vec![4.0]);
        frame.octave = vec![2];
        let mut atlas = Atlas::new(Snapshot::new());
        assert!((depth(atlas.latest(), &camera, &frame, 0) - 4.0).abs() < 1e-6);
        // The right x that was measured is too small: the disparity of 10 px is one of 8.
        atlas.commit(vec![Change::Calibrate(2.0)]);
        assert_eq!(pixel(atlas.latest(), &frame, 0), [100.0, 50.0, 92.0]);
        assert!((depth(atlas.latest(), &camera, &frame, 0) - 5.0).abs() < 1e-6);
        frame.depth[0] = 40.0;
        assert!(depth(atlas.latest(), &camera, &frame, 0).is_nan(), "beyond all measure");
        assert!((weight(&frame, 0, &Octaves { levels: 8, factor: 2.0 }) - 1.0 / 16.0).abs() < 1e-12);
    }
}
