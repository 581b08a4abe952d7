//! One image in, features out; owns every buffer that is needed between.

use super::blur::Blurred;
use super::distribute::{Scratch, distribute, prefer_strong, shares};
use super::fast::{Corner, Scores, corners};
use super::{Backend, Pyramid, descriptor, orientation, subpixel};
use crate::Descriptor;
use cairn_sensor::GrayImage;

/// What is asked of the extractor.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrbSetting {
    /// Features per image, at most.
    pub features: usize,
    /// Pyramid levels (1 to 16).
    pub levels: usize,
    /// Ratio between neighbouring levels (1.05 to 1.6).
    pub factor: f64,
    /// FAST threshold, in gray levels, where corners abound.
    pub fast_high: u8,
    /// FAST threshold where nothing passes the high one.
    pub fast_low: u8,
}

impl Default for OrbSetting {
    fn default() -> Self {
        Self { features: 1000, levels: 8, factor: 1.2, fast_high: 20, fast_low: 7 }
    }
}

/// Features of one image, struct of arrays: every vector has the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    /// Where, in pixels of the full image; sub-pixel, the centre of a pixel is a whole number.
    pub raw: Vec<[f32; 2]>,
    /// Pyramid level.
    pub octave: Vec<u8>,
    /// Orientation in radians, -pi to pi, from +x towards +y (clockwise on the screen).
    pub angle: Vec<f32>,
    /// Strength of the corner (FAST score, gray levels).
    pub response: Vec<f32>,
    /// Descriptors.
    pub descriptors: Vec<Descriptor>,
}

impl Features {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.raw.len()
    }

    /// True when nothing was found.
    pub fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// Forgets all features and keeps the memory.
    pub fn clear(&mut self) {
        self.raw.clear();
        self.octave.clear();
        self.angle.clear();
        self.response.clear();
        self.descriptors.clear();
    }
}

/// Finds ORB features; reuse it from image to image, for its buffers.
#[derive(Clone, Debug)]
pub struct OrbExtractor {
    setting: OrbSetting,
    backend: Backend,
    pyramid: Pyramid,
    /// Per level.
    corners: Vec<Vec<Corner>>,
    scores: Scores,
    scratch: Scratch,
    blurred: Blurred,
}

impl OrbExtractor {
    /// An extractor with the fastest loops of this machine. Values outside their range are moved to its nearest end.
    pub fn new(setting: OrbSetting) -> Self {
        Self::with_backend(setting, Backend::detect())
    }

    /// An extractor with chosen loops, for tests and benches; falls back to what this machine has.
    pub fn with_backend(setting: OrbSetting, backend: Backend) -> Self {
        let levels = setting.levels.clamp(1, 16);
        let pyramid = Pyramid::new(levels, setting.factor);
        let setting = OrbSetting {
            levels,
            factor: pyramid.factor(),
            fast_low: setting.fast_low.min(setting.fast_high),
            ..setting
        };
        Self {
            setting,
            backend: if backend.available() { backend } else { Backend::Scalar },
            pyramid,
            corners: vec![Vec::new(); levels],
            scores: Scores::default(),
            scratch: Scratch::default(),
            blurred: Blurred::default(),
        }
    }

    /// The setting in use.
    pub fn setting(&self) -> &OrbSetting {
        &self.setting
    }

    /// The levels of the last image.
    pub fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    /// Replaces `out` by the features of `image`, level after level, each in reading order.
    ///
    /// An image too small for a patch (32 pixels or less on a side) has none.
    pub fn extract(&mut self, image: &GrayImage, out: &mut Features) {
        out.clear();
        self.pyramid.build(image, self.backend);
        self.detect();
        self.select();
        for level in 0..self.pyramid.levels().len() {
            self.describe(level, out);
        }
    }

    fn detect(&mut self) {
        for (level, found) in self.pyramid.levels().iter().zip(&mut self.corners) {
            corners(level, self.setting.fast_low, &mut self.scores, found, self.backend);
            prefer_strong(found, level.width(), level.height(), self.setting.fast_high, &mut self.scratch);
        }
    }

    fn select(&mut self) {
        let levels = self.pyramid.levels();
        let mut available = [0usize; 16];
        for (n, found) in available.iter_mut().zip(&self.corners[..levels.len()]) {
            *n = found.len();
        }
        let given = shares(&available[..levels.len()], self.setting.features, self.setting.factor);
        for ((level, found), wanted) in levels.iter().zip(&mut self.corners).zip(given) {
            distribute(found, level.width(), level.height(), wanted, &mut self.scratch);
        }
    }

    fn describe(&mut self, level: usize, out: &mut Features) {
        if self.corners[level].is_empty() {
            return;
        }
        let image = &self.pyramid.levels()[level];
        self.blurred.run(image, self.backend);
        for c in &self.corners[level] {
            let (x, y) = (c.x as usize, c.y as usize);
            let offset = subpixel::refine(image, x, y);
            let direction = orientation::direction(orientation::moments(image, x, y, self.backend));
            let stride = self.blurred.stride();
            let centre = y * stride + x;
            let bits = descriptor::describe(self.blurred.data(), stride, centre, direction, self.backend);
            out.raw.push(self.pyramid.to_image(level, [x as f32 + offset[0], y as f32 + offset[1]]));
            out.octave.push(level as u8);
            out.angle.push((direction[1] as f32).atan2(direction[0] as f32));
            out.response.push(c.score as f32);
            out.descriptors.push(bits);
        }
    }
}
