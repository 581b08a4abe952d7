//! What a tracker is made for (camera, budget of features, frame rate, settings), and the numbers that follow from that alone.

use crate::config::TrackerConfig;
use cairn_vision::{Frame, RectifiedCamera};

/// The facts of a tracker that do not change.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Setup {
    pub camera: RectifiedCamera,
    /// The feature budget of the front end.
    pub features: usize,
    /// The nominal frame rate.
    pub rate_hz: f64,
    pub config: TrackerConfig,
}

impl Setup {
    /// The readout time of the camera's rows that is given; `None` where it is to be estimated.
    pub fn given_readout_s(&self) -> Option<f64> {
        (!self.config.estimate_readout).then_some(self.config.readout_s)
    }

    /// Columns and rows of the image, by the bounds of its rectified pixels.
    pub fn image_size(&self) -> [usize; 2] {
        let bounds = &self.camera.bounds;
        [0, 1].map(|i| (bounds[i + 2] - bounds[i]).round().max(1.0) as usize)
    }

    /// Inlier matches required in a frame: of the few features of a blank wall a good share is enough, where each has
    /// depth.
    pub fn need(&self, frame: &Frame) -> usize {
        let least = if self.camera.has_depth() { 10 } else { 15 };
        self.config.min_inliers.min((frame.len() / 4).max(least))
    }

    /// Inlier matches required where the place has just been found again.
    pub fn recovered_need(&self) -> usize {
        self.config.min_inliers * 3 / 2
    }

    /// Features that a key frame without landmarks needs.
    pub fn need_of_new(&self) -> usize {
        (self.features / 12).max(40)
    }

    /// Features that such a key frame can use: where there is depth, those that have it.
    pub fn usable(&self, frame: &Frame) -> usize {
        let depth = self.camera.has_depth();
        (0..frame.len()).filter(|i| !depth || frame.has_depth(*i)).count()
    }

    /// Whether a view had run out of features, as in front of a blank wall.
    pub fn is_blank(&self, frame: &Frame) -> bool {
        4 * frame.len() < self.features
    }
}
