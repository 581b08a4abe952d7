//! The ORB extractor: runs all stages on one image and owns their buffers.

use super::blur::Blurred;
use super::distribute::{self, distribute, shares};
use super::fast::{self, Corner, corners};
use super::fast_score::scores_around;
use super::{Backend, Pyramid, descriptor, orientation, subpixel};
use crate::Descriptor;
use crate::parallel::share;
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

    /// Adds all features of another image or level.
    fn append(&mut self, other: &Self) {
        self.raw.extend_from_slice(&other.raw);
        self.octave.extend_from_slice(&other.octave);
        self.angle.extend_from_slice(&other.angle);
        self.response.extend_from_slice(&other.response);
        self.descriptors.extend_from_slice(&other.descriptors);
    }
}

/// Extracts ORB features; reuse one from image to image to reuse its buffers.
#[derive(Clone, Debug)]
pub struct OrbExtractor {
    config: OrbConfig,
    backend: Backend,
    two_threads: bool,
    pyramid: Pyramid,
    levels: Vec<Level>,
    /// One for each thread.
    scratch: [Scratch; 2],
}

/// What is found on one level of the pyramid.
#[derive(Clone, Debug, Default)]
struct Level {
    /// Corners; after the selection those that become features.
    corners: Vec<Corner>,
    features: Features,
    /// Cosine and sine of the orientation of each feature, in units of 1/16384.
    directions: Vec<[i16; 2]>,
}

/// Buffers of the stages.
#[derive(Clone, Debug, Default)]
struct Scratch {
    fast: fast::Scratch,
    distribution: distribute::Scratch,
    blurred: Blurred,
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
            two_threads: false,
            pyramid,
            levels: vec![Level::default(); levels],
            scratch: Default::default(),
        }
    }

    /// The same with the levels of the pyramid divided between the calling thread and a second one; the result is the
    /// same.
    pub fn with_two_threads(self, two_threads: bool) -> Self {
        Self { two_threads, ..self }
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
        let (thresholds, backend, two) = (self.thresholds(), self.backend, self.two_threads);
        let (pyramid, scratch) = (&mut self.pyramid, &mut self.scratch);
        let mut levels = self.levels.iter_mut();
        // Corners are found in a level while the next one is made.
        share(
            two,
            scratch,
            |give| {
                pyramid.build_with(image, backend, |image| {
                    levels.next().into_iter().for_each(|level| give((image, level)));
                });
            },
            |(image, level), scratch| Level::detect(level, image, thresholds, scratch, backend),
        );
        let given = self.shares();
        let pyramid = &self.pyramid;
        each(pyramid, two, &mut self.levels, &mut self.scratch, |at, image, level, scratch| {
            level.select(image, given[at], scratch);
            level.refine(pyramid, at, image, backend);
            level.describe(image, scratch, backend);
        });
        self.collect(out);
    }

    /// One stage of [`OrbExtractor::extract`], which runs all in order; public only for benches.
    #[doc(hidden)]
    pub fn run(&mut self, stage: Stage, image: &GrayImage, out: &mut Features) {
        let given = if stage == Stage::Select { self.shares() } else { [0; MAX_LEVELS] };
        let (thresholds, backend) = (self.thresholds(), self.backend);
        let (pyramid, levels, scratch) = (&self.pyramid, &mut self.levels, &mut self.scratch);
        match stage {
            Stage::Downsample => self.pyramid.build(image, backend),
            Stage::Detect => each(pyramid, false, levels, scratch, |_, image, l, s| {
                l.detect(image, thresholds, s, backend)
            }),
            Stage::Select => {
                each(pyramid, false, levels, scratch, |at, image, l, s| l.select(image, given[at], s))
            }
            Stage::Refine => {
                each(pyramid, false, levels, scratch, |at, image, l, _| l.refine(pyramid, at, image, backend))
            }
            Stage::Describe => {
                each(pyramid, false, levels, scratch, |_, image, l, s| l.describe(image, s, backend));
                self.collect(out);
            }
        }
    }

    /// The low and the high threshold of corners.
    fn thresholds(&self) -> [u8; 2] {
        [self.config.fast_low, self.config.fast_high]
    }

    /// How many features each level gets.
    fn shares(&self) -> [usize; MAX_LEVELS] {
        let n = self.pyramid.levels().len();
        let mut available = [0usize; MAX_LEVELS];
        for (available, level) in available.iter_mut().zip(&self.levels[..n]) {
            *available = level.corners.len();
        }
        let mut given = [0usize; MAX_LEVELS];
        shares(&available[..n], self.config.features, self.config.factor, &mut given[..n]);
        given
    }

    /// Puts the features of all levels together.
    fn collect(&self, out: &mut Features) {
        out.clear();
        for level in &self.levels[..self.pyramid.levels().len()] {
            out.append(&level.features);
        }
    }
}

impl Level {
    /// Finds the corners.
    fn detect(&mut self, image: &GrayImage, thresholds: [u8; 2], scratch: &mut Scratch, backend: Backend) {
        corners(image, thresholds, &mut scratch.fast, &mut self.corners, backend);
    }

    /// Selects the corners that become features.
    fn select(&mut self, image: &GrayImage, wanted: usize, scratch: &mut Scratch) {
        distribute(&mut self.corners, image.width(), image.height(), wanted, &mut scratch.distribution);
    }

    /// Sub-pixel position, orientation and the other attributes of the features, except their descriptors.
    fn refine(&mut self, pyramid: &Pyramid, level: usize, image: &GrayImage, backend: Backend) {
        let Self { corners, features: out, directions } = self;
        out.clear();
        directions.clear();
        for c in corners.iter() {
            let (x, y) = (c.x as usize, c.y as usize);
            let offset = subpixel::peak(&scores_around(image, x, y, backend));
            let direction = orientation::direction(orientation::moments(image, x, y, backend));
            out.raw.push(pyramid.to_image(level, [x as f32 + offset[0], y as f32 + offset[1]]));
            out.octave.push(level as u8);
            out.angle.push((direction[1] as f32).atan2(direction[0] as f32));
            out.response.push(c.score as f32);
            directions.push(direction);
        }
    }

    /// Descriptors of the features.
    fn describe(&mut self, image: &GrayImage, scratch: &mut Scratch, backend: Backend) {
        if self.corners.is_empty() {
            return;
        }
        let blurred = &mut scratch.blurred;
        blurred.run(image, backend);
        let (data, stride) = (blurred.data(), blurred.stride());
        let descriptors = self.corners.iter().zip(&self.directions).map(|(c, &direction)| {
            let centre = c.y as usize * stride + c.x as usize;
            descriptor::describe(data, stride, centre, direction, backend)
        });
        self.features.descriptors.extend(descriptors);
    }
}

/// Runs `work` for each level, with its number and image; with two threads, each takes the next level when it is free.
fn each(
    pyramid: &Pyramid,
    two_threads: bool,
    levels: &mut [Level],
    scratch: &mut [Scratch; 2],
    work: impl Fn(usize, &GrayImage, &mut Level, &mut Scratch) + Sync,
) {
    let all = pyramid.levels().iter().zip(levels).enumerate();
    share(
        two_threads,
        scratch,
        |give| all.for_each(give),
        |(at, (image, level)), scratch| {
            work(at, image, level, scratch);
        },
    );
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
