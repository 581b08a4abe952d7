//! The ORB extractor: runs all stages on one image and owns their buffers.

use super::blur::Blurred;
use super::distribute::{self, distribute, shares};
use super::fast::{self, Corner, corners};
use super::fast_score::scores_around;
use super::{Backend, Pyramid, descriptor, orientation, subpixel};
use crate::Descriptor;
use cairn_sensor::GrayImage;
use cairn_settings::Settings;

/// Configuration of the extractor.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct OrbConfig {
    /// Features per image, at most; 0: one for every 300 pixels of the image, 500 to 2000.
    #[setting(default = 1000, range = 0..=16000)]
    pub features: usize,
    /// Levels of the image pyramid.
    #[setting(default = 8, range = 1..=16)]
    pub levels: usize,
    /// Scale ratio between neighbouring levels.
    #[setting(default = 1.2, range = 1.05..=1.6)]
    pub factor: f64,
    /// FAST threshold in gray levels, used in cells with strong corners.
    #[setting(default = 20, range = 1..=255)]
    pub fast_high: u8,
    /// FAST threshold in gray levels for cells where nothing passes the high one.
    #[setting(default = 7, range = 1..=255)]
    pub fast_low: u8,
}

/// Features of one image, struct of arrays: every vector has the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    /// Sub-pixel positions in pixels of the full image; pixel centres are at integer coordinates.
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

    /// Removes all features and keeps the allocated memory.
    pub fn clear(&mut self) {
        self.raw.clear();
        self.octave.clear();
        self.angle.clear();
        self.response.clear();
        self.descriptors.clear();
    }
}

/// Extracts ORB features; reuse one from image to image to reuse its buffers.
#[derive(Clone, Debug)]
pub struct OrbExtractor {
    config: OrbConfig,
    backend: Backend,
    pyramid: Pyramid,
    /// Corners of each level.
    corners: Vec<Vec<Corner>>,
    fast: fast::Scratch,
    distribution: distribute::Scratch,
    blurred: Blurred,
    /// Cosine and sine of the orientation of each feature, in units of 1/16384.
    directions: Vec<[i16; 2]>,
}

/// Maximum number of levels.
const MAX_LEVELS: usize = 16;

impl OrbExtractor {
    /// An extractor with the fastest backend of this machine. Values out of range are clamped.
    pub fn new(config: OrbConfig) -> Self {
        Self::with_backend(config, Backend::detect())
    }

    /// An extractor with a given backend, for tests and benches; falls back to scalar if it is not available.
    pub fn with_backend(config: OrbConfig, backend: Backend) -> Self {
        let levels = config.levels.clamp(1, MAX_LEVELS);
        let pyramid = Pyramid::new(levels, config.factor);
        let config = OrbConfig {
            levels,
            factor: pyramid.factor(),
            fast_low: config.fast_low.min(config.fast_high),
            ..config
        };
        Self {
            config,
            backend: if backend.available() { backend } else { Backend::Scalar },
            pyramid,
            corners: vec![Vec::new(); levels],
            fast: fast::Scratch::default(),
            distribution: distribute::Scratch::default(),
            blurred: Blurred::default(),
            directions: Vec::new(),
        }
    }

    /// The configuration in use, after clamping.
    pub fn config(&self) -> &OrbConfig {
        &self.config
    }

    /// The levels of the last image.
    pub fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    /// Replaces `out` by the features of `image`, level by level, in reading order within a level.
    ///
    /// An image too small for a patch (32 pixels or less on a side) gives no features.
    pub fn extract(&mut self, image: &GrayImage, out: &mut Features) {
        for stage in Stage::ALL {
            self.run(stage, image, out);
        }
    }

    /// One stage of [`OrbExtractor::extract`], which runs all in order; public only for benches.
    #[doc(hidden)]
    pub fn run(&mut self, stage: Stage, image: &GrayImage, out: &mut Features) {
        match stage {
            Stage::Downsample => self.pyramid.build(image, self.backend),
            Stage::Detect => self.detect(),
            Stage::Select => self.select(),
            Stage::Refine => self.refine(out),
            Stage::Describe => self.describe(out),
        }
    }

    /// Detects the corners of all levels.
    fn detect(&mut self) {
        let thresholds = [self.config.fast_low, self.config.fast_high];
        for (level, found) in self.pyramid.levels().iter().zip(&mut self.corners) {
            corners(level, thresholds, &mut self.fast, found, self.backend);
        }
    }

    /// Selects the corners that become features.
    fn select(&mut self) {
        let levels = self.pyramid.levels();
        let mut available = [0usize; MAX_LEVELS];
        for (n, found) in available.iter_mut().zip(&self.corners[..levels.len()]) {
            *n = found.len();
        }
        let mut given = [0usize; MAX_LEVELS];
        let n = levels.len();
        shares(&available[..n], self.config.features, self.config.factor, &mut given[..n]);
        for ((level, found), wanted) in levels.iter().zip(&mut self.corners).zip(given) {
            distribute(found, level.width(), level.height(), wanted, &mut self.distribution);
        }
    }

    /// Sub-pixel position, orientation and the other attributes of the features, except their descriptors.
    fn refine(&mut self, out: &mut Features) {
        out.clear();
        self.directions.clear();
        for (level, (image, corners)) in self.pyramid.levels().iter().zip(&self.corners).enumerate() {
            for c in corners {
                let (x, y) = (c.x as usize, c.y as usize);
                let offset = subpixel::peak(&scores_around(image, x, y, self.backend));
                let direction = orientation::direction(orientation::moments(image, x, y, self.backend));
                out.raw.push(self.pyramid.to_image(level, [x as f32 + offset[0], y as f32 + offset[1]]));
                out.octave.push(level as u8);
                out.angle.push((direction[1] as f32).atan2(direction[0] as f32));
                out.response.push(c.score as f32);
                self.directions.push(direction);
            }
        }
    }

    /// Descriptors of the features.
    fn describe(&mut self, out: &mut Features) {
        out.descriptors.clear();
        let mut directions = self.directions.iter();
        for (image, corners) in self.pyramid.levels().iter().zip(&self.corners) {
            if corners.is_empty() {
                continue;
            }
            self.blurred.run(image, self.backend);
            let (data, stride) = (self.blurred.data(), self.blurred.stride());
            for (c, &direction) in corners.iter().zip(&mut directions) {
                let centre = c.y as usize * stride + c.x as usize;
                out.descriptors.push(descriptor::describe(data, stride, centre, direction, self.backend));
            }
        }
    }
}

/// The stages of the extraction.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Scale pyramid.
    Downsample,
    /// FAST corners.
    Detect,
    /// Spatial distribution.
    Select,
    /// Sub-pixel position and orientation.
    Refine,
    /// Blur and descriptors.
    Describe,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 5] = [Self::Downsample, Self::Detect, Self::Select, Self::Refine, Self::Describe];
}
