//! The front end: from a packet of images to a [`Frame`] of features, with depth for stereo and RGB-D.

use crate::depth::{DepthConfig, DepthLookup};
use crate::orb::{Features, OrbConfig, OrbExtractor};
use crate::parallel::{both, in_halves};
use crate::rectify::{Rectifier, rectify_pair};
use crate::stereo::{Side, StereoConfig, StereoMatcher};
use crate::{Frame, Octaves, RectifiedCamera};
use cairn_geometry::{So3, Vec2, Vec3};
use cairn_sensor::{DepthImage, FramePacket, GrayImage, Rig, RigError};
use cairn_settings::Settings;

/// Maximum number of features of one frame: the limit of the lookup grid of a [`Frame`].
const MAX_FEATURES: usize = 65_535;

/// Which sensors the front end uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorMode {
    /// The first camera.
    Mono,
    /// The first two cameras.
    Stereo,
    /// The first camera and the depth sensor.
    Rgbd,
}

/// Configuration of the front end.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, Settings)]
pub struct FrontEndConfig {
    /// Feature extraction.
    #[setting(section)]
    pub orb: OrbConfig,
    /// Stereo matching.
    #[setting(section)]
    pub stereo: StereoConfig,
    /// Depth lookup.
    #[setting(section)]
    pub depth: DepthConfig,
    /// True to divide the work on an image or a pair between two threads; the result is the same.
    #[setting(default = true)]
    pub two_threads: bool,
}

/// Why a packet cannot be processed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrontEndError {
    /// The packet has too few images.
    #[error("the packet has {have} images, the front end needs {need}")]
    MissingImage {
        /// Images in the packet.
        have: usize,
        /// Images that the sensor mode needs.
        need: usize,
    },
    /// An image has another size than its calibration.
    #[error("{name}: the image is {have:?} pixels, its calibration is for {need:?}")]
    WrongSize {
        /// Name of the camera, or "depth".
        name: String,
        /// Width and height of the image.
        have: [usize; 2],
        /// Width and height of the calibration.
        need: [usize; 2],
    },
}

/// Extracts features and depth from packets; owns the extractors and all buffers.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    model: RectifiedCamera,
    octaves: Octaves,
    config: FrontEndConfig,
    /// Name, width and height of each camera in use.
    cameras: Vec<(String, [usize; 2])>,
    left: CameraFeatures,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Mono(Rectifier),
    Rgbd { map: Rectifier, lookup: Box<DepthLookup>, size: [usize; 2] },
    Stereo(Box<Pair>),
}

/// State that only stereo needs.
#[derive(Clone, Debug)]
struct Pair {
    matcher: StereoMatcher,
    right: CameraFeatures,
}

/// One camera's extractor and the features of its last image.
#[derive(Clone, Debug)]
struct CameraFeatures {
    extractor: OrbExtractor,
    features: Features,
    px: Vec<[f32; 2]>,
}

impl CameraFeatures {
    fn new(config: OrbConfig, two_threads: bool) -> Self {
        let extractor = OrbExtractor::new(config).with_two_threads(two_threads);
        Self { extractor, features: Features::default(), px: Vec::new() }
    }

    /// Extracts and rectifies; features outside the view of the rectified camera get NaN.
    fn run(&mut self, image: &GrayImage, map: &Rectifier) {
        self.extractor.extract(image, &mut self.features);
        self.px.clear();
        self.px.extend(self.features.raw.iter().map(|&raw| map.rectify(raw).unwrap_or([f32::NAN; 2])));
    }

    /// Drops the features without a rectified pixel.
    fn drop_unrectified(&mut self) {
        if self.px.iter().all(|p| p[0].is_finite()) {
            return;
        }
        let visible: Vec<bool> = self.px.iter().map(|p| p[0].is_finite()).collect();
        let f = &mut self.features;
        retain(&mut self.px, &visible);
        retain(&mut f.raw, &visible);
        retain(&mut f.octave, &visible);
        retain(&mut f.angle, &visible);
        retain(&mut f.response, &visible);
        retain(&mut f.descriptors, &visible);
    }

    fn side(&self) -> Side<'_> {
        Side {
            raw: &self.features.raw,
            px: &self.px,
            octave: &self.features.octave,
            descriptors: &self.features.descriptors,
            levels: self.extractor.pyramid().levels(),
        }
    }
}

fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut i = 0;
    items.retain(|_| {
        i += 1;
        keep[i - 1]
    });
}

impl FrontEnd {
    /// A front end for the sensors of a rig.
    ///
    /// # Errors
    /// When the rig is invalid, lacks a sensor of the mode, or its cameras cannot be rectified.
    pub fn new(rig: &Rig, sensor: SensorMode, config: FrontEndConfig) -> Result<Self, RigError> {
        rig.validate()?;
        let config = FrontEndConfig {
            orb: OrbConfig { features: config.orb.features.min(MAX_FEATURES), ..config.orb },
            ..config
        };
        // The two images of a pair are the two parts of its work.
        let two_parts = config.two_threads && sensor != SensorMode::Stereo;
        let left = CameraFeatures::new(config.orb, two_parts);
        let used = *left.extractor.config();
        let octaves = Octaves { levels: used.levels, factor: used.factor };
        let first = rig.cameras.first().ok_or_else(|| RigError("the rig has no camera".into()))?;
        let mut cameras = vec![(first.name.clone(), [first.camera.width, first.camera.height])];
        let (model, kind) = match sensor {
            SensorMode::Mono => {
                let (model, map) = single_camera(rig)?;
                (model, Kind::Mono(map))
            }
            SensorMode::Rgbd => {
                let (mut model, map) = single_camera(rig)?;
                let depth =
                    rig.depth.as_ref().ok_or_else(|| RigError("the rig has no depth sensor".into()))?;
                model.baseline_fx = config.depth.virtual_baseline * model.fx;
                model.close_depth = config.depth.close_depth;
                let lookup =
                    Box::new(DepthLookup::new(config.depth, depth, &first.camera, &first.body_from_camera));
                (model, Kind::Rgbd { map, lookup, size: [depth.camera.width, depth.camera.height] })
            }
            SensorMode::Stereo => {
                let second = rig
                    .cameras
                    .get(1)
                    .ok_or_else(|| RigError("stereo needs two cameras, the rig has one".into()))?;
                cameras.push((second.name.clone(), [second.camera.width, second.camera.height]));
                let pair = rectify_pair(first, second)?;
                let close_depth = config.stereo.close_baselines * pair.baseline;
                let model = RectifiedCamera { close_depth, ..pair.camera };
                let matcher =
                    StereoMatcher::new(config.stereo, pair.left, pair.right, octaves, model.baseline_fx);
                (
                    model,
                    Kind::Stereo(Box::new(Pair { matcher, right: CameraFeatures::new(config.orb, false) })),
                )
            }
        };
        Ok(Self { model, octaves, config, cameras, left, kind })
    }

    /// The ideal camera that frames are expressed in.
    pub fn model(&self) -> &RectifiedCamera {
        &self.model
    }

    /// Parameters of the scale pyramid.
    pub fn octaves(&self) -> Octaves {
        self.octaves
    }

    /// Extracts the frame of one packet. An RGB-D packet without a depth image gives a frame without depth.
    ///
    /// # Errors
    /// When an image is missing or its size differs from the calibration; the front end is left unchanged.
    pub fn extract(&mut self, packet: &FramePacket) -> Result<Frame, FrontEndError> {
        self.check(packet)?;
        let mut frame = Frame::default();
        match &mut self.kind {
            Kind::Mono(map) => {
                self.left.run(&packet.images[0], map);
                self.left.drop_unrectified();
            }
            Kind::Rgbd { map, lookup, .. } => {
                self.left.run(&packet.images[0], map);
                self.left.drop_unrectified();
                if let Some(depth) = &packet.depth {
                    let (left, two_threads) = (&self.left, self.config.two_threads);
                    add_depth(&mut frame, depth, left, lookup, &self.model, &self.octaves, two_threads);
                }
            }
            Kind::Stereo(pair) => {
                let Pair { matcher, right } = pair.as_mut();
                let (first, second) = (&packet.images[0], &packet.images[1]);
                let two = self.config.two_threads;
                both(two, || self.left.run(first, matcher.left()), || right.run(second, matcher.right()));
                self.left.drop_unrectified();
                matcher.run(self.left.side(), right.side(), two, &mut frame.right_x, &mut frame.depth);
            }
        }
        let n = self.left.px.len();
        frame.right_x.resize(n, f32::NAN);
        frame.depth.resize(n, f32::NAN);
        frame.stamp = packet.stamp;
        frame.raw.clone_from(&self.left.features.raw);
        frame.px.clone_from(&self.left.px);
        frame.octave.clone_from(&self.left.features.octave);
        frame.angle.clone_from(&self.left.features.angle);
        frame.descriptors.clone_from(&self.left.features.descriptors);
        frame.index(&self.model);
        Ok(frame)
    }

    fn check(&self, packet: &FramePacket) -> Result<(), FrontEndError> {
        if packet.images.len() < self.cameras.len() {
            return Err(FrontEndError::MissingImage { have: packet.images.len(), need: self.cameras.len() });
        }
        for (image, (name, need)) in packet.images.iter().zip(&self.cameras) {
            let have = [image.width(), image.height()];
            if have != *need {
                return Err(FrontEndError::WrongSize { name: name.clone(), have, need: *need });
            }
        }
        if let (Kind::Rgbd { size, .. }, Some(depth)) = (&self.kind, &packet.depth) {
            let have = [depth.width(), depth.height()];
            if have != *size {
                return Err(FrontEndError::WrongSize { name: "depth".into(), have, need: *size });
            }
        }
        Ok(())
    }
}

/// The rectified camera of a single camera (mono, RGB-D): its own focal lengths and principal point, without
/// distortion.
fn single_camera(rig: &Rig) -> Result<(RectifiedCamera, Rectifier), RigError> {
    let first = rig.cameras.first().ok_or_else(|| RigError("the rig has no camera".into()))?;
    let c = &first.camera;
    let map = Rectifier::new(c, &So3::identity(), Vec2::new(c.fx, c.fy), Vec2::new(c.cx, c.cy));
    let bounds = map
        .bounds()
        .ok_or_else(|| RigError(format!("{}: no pixel has a ray within 75 degrees", first.name)))?;
    let model = RectifiedCamera {
        fx: c.fx,
        fy: c.fy,
        cx: c.cx,
        cy: c.cy,
        baseline_fx: 0.0,
        bounds,
        close_depth: 0.0,
        body_from_camera: first.body_from_camera,
    };
    Ok((model, map))
}

/// Sets the depth and the virtual right x of each feature from a depth image.
fn add_depth(
    frame: &mut Frame,
    image: &DepthImage,
    camera: &CameraFeatures,
    lookup: &DepthLookup,
    model: &RectifiedCamera,
    octaves: &Octaves,
    two_threads: bool,
) {
    let depth_of = |i: usize| {
        let ray: Vec3 = model.unproject(camera.px[i], 1.0);
        let scale = octaves.scale(camera.features.octave[i]);
        lookup.find(image, camera.features.raw[i], &ray, scale).unwrap_or(f32::NAN)
    };
    frame.depth = in_halves(camera.px.len(), two_threads, |range| range.map(depth_of).collect());
    let right_x = |(px, depth): (&[f32; 2], &f32)| px[0] - (model.baseline_fx / *depth as f64) as f32;
    frame.right_x = camera.px.iter().zip(&frame.depth).map(right_x).collect();
}
