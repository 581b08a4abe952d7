//! RGB-D maps that were saved with another weight of depth.
//!
//! A depth camera has no second camera: its disparities are those of a virtual projector, whose distance only says how
//! much a depth weighs. A map with another distance is the same map; its disparities are stretched to the new one.

use super::MapFile;
use crate::Snapshot;
use cairn_vision::{RectifiedCamera, SensorMode};
use std::borrow::Cow;

impl MapFile {
    /// This map with the virtual baseline of `camera`, where it is an RGB-D map and has another; else itself.
    pub fn with_depth_weighed_for(&self, camera: &RectifiedCamera) -> Cow<'_, Self> {
        let mine = &self.about.camera;
        let (was_m, is_m) = (mine.baseline_fx / mine.fx, camera.baseline_fx / camera.fx);
        let both = was_m > 0.0 && is_m > 0.0;
        if self.about.sensor != SensorMode::Rgbd || !both || was_m == is_m {
            return Cow::Borrowed(self);
        }
        let mut file = self.clone();
        file.about.camera.baseline_fx = mine.fx * is_m;
        file.snapshot.stretch_disparities(is_m / was_m);
        Cow::Owned(file)
    }
}

impl Snapshot {
    /// Multiplies the disparities of all key frames.
    fn stretch_disparities(&mut self, by: f64) {
        self.right_offset *= by;
        let ids: Vec<usize> = self.key_frames.iter().map(|(k, _)| k).collect();
        for id in ids {
            let Some(key_frame) = self.key_frames.get_mut(id).filter(|k| k.other_camera.is_none()) else {
                continue;
            };
            key_frame.frame.change(|frame| {
                for (right_x, px) in frame.right_x.iter_mut().zip(&frame.px) {
                    *right_x = px[0] - ((px[0] - *right_x) as f64 * by) as f32;
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::About;
    use crate::{Change, ChangeSet, KeyFrame, KeyFrameId};
    use cairn_geometry::Se3;
    use cairn_vision::Frame;
    use std::collections::BTreeMap;
    use std::sync::Arc;

    fn camera(baseline_m: f64) -> RectifiedCamera {
        RectifiedCamera {
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            baseline_fx: 500.0 * baseline_m,
            bounds: [0.0, 0.0, 640.0, 480.0],
            close_depth: 4.0,
            body_from_camera: Se3::identity(),
        }
    }

    fn saved(sensor: SensorMode) -> MapFile {
        let px = vec![[100.0, 50.0], [300.0, 200.0]];
        let right_x = vec![100.0 - 37.5 / 2.0, f32::NAN];
        let mut frame = Frame::default();
        (frame.raw, frame.px, frame.right_x, frame.depth) = (px.clone(), px, right_x, vec![2.0, f32::NAN]);
        let key_frame = KeyFrame::new(KeyFrameId::FIRST, Arc::new(frame), Se3::identity(), None);
        let changes = vec![Change::AddKeyFrame(Box::new(key_frame))];
        let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
        let about = About { program: "a test".into(), sensor, camera: camera(0.075) };
        MapFile { snapshot, about, attached: BTreeMap::new() }
    }

    #[test]
    fn disparities_tell_the_same_depth_under_another_baseline() {
        let file = saved(SensorMode::Rgbd);
        let now = file.with_depth_weighed_for(&camera(0.3));
        assert_eq!(now.about.camera.baseline_fx, 150.0);
        let frame = &now.snapshot.key_frame(KeyFrameId::FIRST).unwrap().frame;
        let depth_m = now.about.camera.baseline_fx / (frame.px[0][0] - frame.right_x[0]) as f64;
        assert!((depth_m - 2.0).abs() < 1e-5, "{depth_m}");
        assert!(frame.right_x[1].is_nan());
        // The map that was given stays as it was.
        let before = &file.snapshot.key_frame(KeyFrameId::FIRST).unwrap().frame;
        assert_eq!(before.right_x[0], 81.25);
    }

    #[test]
    fn a_real_baseline_is_never_changed() {
        let file = saved(SensorMode::Stereo);
        assert!(matches!(file.with_depth_weighed_for(&camera(0.3)), Cow::Borrowed(_)));
        let same = saved(SensorMode::Rgbd);
        assert!(matches!(same.with_depth_weighed_for(&camera(0.075)), Cow::Borrowed(_)));
    }
}
