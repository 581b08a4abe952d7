//! The pose of a depth image by the shape of the surface alone, where features do not give it: a bare wall, dark texture.
//!
//! In: the depth image of each frame, and the poses that tracking found. Out: a pose with its covariance ([`Reckoned`]),
//! used as that of any other measured motion: first guess, prior of the pose by features, gate, and the pose itself while
//! too little is seen. The image is aligned with a field fused from those before it (`cairn_dense::track`). Directions
//! that the surface leaves free (along a bare corridor, in the plane of a single wall) are found by the shades on it
//! (`cairn_dense::track_photometric`), where the camera sees the depth's pixels and there is a texture; else they are those of the
//! prediction: of the IMU, of a measured motion, else of constant velocity; and as uncertain.
//!
//! While features suffice nothing is aligned: depth images are remembered, and that is all.

mod disagreement;
mod surface;
mod texture;

use crate::reckoned::{Reckoned, TRACKED_SIGMA_M, TRACKED_SIGMA_RAD};
use crate::state::AnchoredPose;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_dense::{DenseTracked, DepthConfig, DepthPreparer, TrackConfig, track_from};
use cairn_geometry::{Manifold, Se3};
use cairn_sensor::{DepthImage, DepthSensor, GrayImage, Stamp};
use disagreement::{Both, Disagreement, Wrong, spread};
use nalgebra::{Matrix6, Vector6};
use std::sync::Arc;
use surface::Surface;
use texture::Texture;

/// Share of the points that must be near the surface. A camera that sees mostly what it has not seen before is not aligned.
const LEAST_SHARE: f64 = 0.5;
/// Greatest root mean square distance of these points to the surface, metres.
const MOST_RMS_M: f64 = 0.03;
/// Chi-square of six degrees of freedom, 99.9 %: how far the pose may be from the prediction.
const GATE: f64 = 22.46;
/// By how much the camera may be elsewhere than constant velocity takes it: variances per second, of the position (m^2/s) and the
/// orientation (rad^2/s). A walker's speed varies by 0.3 m/s and his turning by 0.5 rad/s, with a memory of a second and of half
/// a second.
const MOTION_VARIANCE: [f64; 2] = [0.09, 0.125];
/// Seconds after the last pose up to which constant velocity predicts the next one.
pub(crate) const PREDICTED_S: f64 = 0.6;
/// Standard deviations up to which the alignment is the pose by itself: that of the position is the tracker's setting, this is that of the orientation.
const CARRY_SIGMA_RAD: f64 = 0.35;
/// A direction is taken from the surface where it gives it with this standard deviation, metres or radians: the prediction is worse.
const FIXED_M: f64 = 0.02;
/// Frames in a row that features must locate by themselves before alignment ends.
const LOCATED: usize = 5;

/// What is known of the pose of a frame before its depth is looked at.
#[derive(Clone, Debug)]
pub(crate) struct Prediction {
    pub world_from_camera: Se3,
    pub covariance: Matrix6<f64>,
}

/// A frame with a pose.
struct PosedFrame {
    stamp: Stamp,
    anchored: AnchoredPose,
    /// Of the right perturbation, since features located the camera last.
    covariance: Matrix6<f64>,
    /// Along the camera's axes, per second.
    velocity: Vector6<f64>,
}

/// A frame that was aligned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aligned {
    pub reckoned: Reckoned,
    /// The camera's motion since the frame before.
    pub last_from_now: Se3,
    /// Projects a perturbation of the pose onto the directions that the surface leaves free.
    free: Matrix6<f64>,
}

/// Aligns the depth of frames while features do not suffice.
pub(crate) struct DenseAligner {
    preparer: DepthPreparer,
    camera_from_depth: Se3,
    config: TrackConfig,
    /// The depth image of the frame that is tracked.
    image: Option<Arc<DepthImage>>,
    texture: Texture,
    surface: Surface,
    /// Whether the pose of each frame is that of its depth.
    is_front_end: bool,
    /// Whether frames are aligned before their features are looked at.
    is_active: bool,
    /// Frames in a row that features located by themselves.
    located: usize,
    /// Frames aligned since then.
    carried: usize,
    last: Option<PosedFrame>,
    aligned: Option<Aligned>,
    /// How features and depth have differed, where each frame's pose is that of its depth.
    disagreement: Disagreement,
    was_tried: bool,
    limit_m: f64,
}

/// What images that follow each other differ by, metres. With the 3 mm of maps what is near holds the pose less, and two of six walks along
/// a bare wall were 0.09 m off in place of 0.02 m.
const BETWEEN_M: f64 = 0.001;

impl std::fmt::Debug for DenseAligner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DenseAligner").field("is_active", &self.is_active).finish_non_exhaustive()
    }
}

impl DenseAligner {
    /// For a depth sensor mounted at `camera_from_depth`; `None` for one that cannot be used. The pose is carried until the
    /// standard deviation of its position is `limit_m`.
    pub fn new(
        sensor: &DepthSensor,
        camera_from_depth: Se3,
        limit_m: f64,
        is_front_end: bool,
    ) -> Option<Self> {
        let config = DepthConfig { between_m: BETWEEN_M, ..DepthConfig::default() };
        Some(Self {
            preparer: DepthPreparer::new(config, sensor.camera, sensor.metres_per_unit).ok()?,
            camera_from_depth,
            config: TrackConfig { fixed_m: FIXED_M, ..TrackConfig::default() },
            image: None,
            texture: Texture::default(),
            surface: Surface::default(),
            is_front_end,
            is_active: is_front_end,
            located: 0,
            carried: 0,
            last: None,
            aligned: None,
            disagreement: Disagreement::default(),
            was_tried: false,
            limit_m,
        })
    }

    /// The next frame comes, with this depth image and the gray image of its pixels.
    pub fn next(&mut self, image: Option<Arc<DepthImage>>, gray: Option<Arc<GrayImage>>) {
        self.image = image;
        self.texture.next(gray);
        self.aligned = None;
        self.disagreement.next();
        self.was_tried = false;
    }

    /// Whether frames are aligned before their features are looked at.
    pub fn is_active(&self) -> bool {
        self.is_active
    }

    /// Whether the present frame was looked at.
    pub fn was_tried(&self) -> bool {
        self.was_tried
    }

    /// The pose of the present frame, where it was aligned.
    pub fn aligned(&self) -> Option<&Aligned> {
        self.aligned.as_ref()
    }

    /// The pose of the present frame where features give one too: theirs, or where each frame's pose is that of its depth, theirs
    /// along what the surface leaves free. Depth that has slid counts for nothing, and its surface is made anew of the images before. Where
    /// features have located the camera elsewhere for some frames, their pose is the camera's, and depth begins anew there.
    pub fn chosen(&mut self, by_features: Se3, covariance: &Matrix6<f64>) -> Se3 {
        if !self.is_front_end {
            return by_features;
        }
        let Some(aligned) = &mut self.aligned else {
            return self.disagreement.alone(&by_features);
        };
        let (pose, free) = (aligned.reckoned.world_from_camera, aligned.free);
        let last_from_now = &aligned.last_from_now;
        let both =
            Both { by_features: &by_features, covariance, by_depth: &pose, last_from_now, free: &free };
        match self.disagreement.compare(&both) {
            Wrong::None => {
                let off = pose.local(&by_features);
                aligned.reckoned.covariance += spread(&(off - free * off));
                pose.retract(&(free * off))
            }
            Wrong::Slid => {
                self.aligned = None;
                self.surface.forget_field();
                self.disagreement.corrected(&by_features)
            }
            Wrong::Elsewhere => {
                self.moved_elsewhere();
                by_features
            }
        }
    }

    /// Whether the pose of each frame is that of its depth.
    pub fn is_front_end(&self) -> bool {
        self.is_front_end
    }

    /// The pose of each frame is that of its depth from now on.
    pub fn become_front_end(&mut self) {
        (self.is_front_end, self.is_active) = (true, true);
    }

    /// Features contradict the alignment: it counts for nothing.
    pub fn refuse(&mut self) {
        self.aligned = None;
        self.surface.clear();
        self.is_active = self.is_front_end;
    }

    /// Aligns the present frame. `prediction` is that of the IMU; `step` a measured motion since the frame before, with the
    /// variances of its translation and rotation. Without either, constant velocity.
    pub fn align(
        &mut self,
        snapshot: &Snapshot,
        stamp: Stamp,
        prediction: Option<Prediction>,
        step: Option<(Se3, [f64; 2])>,
    ) -> Option<&Aligned> {
        self.was_tried = true;
        let image = self.image.clone()?;
        let last = self.last.as_ref()?;
        let before = snapshot.resolve(last.anchored.reference, &last.anchored.reference_from_camera)?;
        let prediction = match prediction {
            Some(prediction) => prediction,
            None => predict(last, &before, stamp, step)?,
        };
        let Prediction { world_from_camera: guess, covariance } = prediction;
        let reference = self.surface.ready(snapshot, &before, &mut self.preparer, &self.camera_from_depth)?;
        let frame = self.preparer.prepare(&image).ok()?;
        let in_field = snapshot.anchor(reference, &guess)? * self.camera_from_depth;
        let turn = self.camera_from_depth.inverse().adjoint();
        let in_depth = turn * covariance * turn.transpose();
        let tracked = track_from(self.surface.volume()?, frame, &in_field, &in_depth, &self.config).ok()?;
        let tracked = match self.by_texture(snapshot, reference, &image, &tracked, &in_depth) {
            Some(found) => found,
            None => tracked,
        };
        let found = tracked.volume_from_camera * self.camera_from_depth.inverse();
        let found = snapshot.resolve(reference, &found)?;
        let measured = self.measured(&tracked);
        let off = guess.local(&found);
        let is_far = off.dot(&((covariance + measured).try_inverse()? * off)) > GATE;
        if !is_sound(&tracked) || is_far || !found.is_finite() {
            return None;
        }
        let turn = self.camera_from_depth.adjoint();
        let free = tracked.free.iter().map(|d| d * d.transpose()).sum::<Matrix6<f64>>();
        let free = turn * free * turn.try_inverse()?;
        let covariance = (covariance.try_inverse()? + measured.try_inverse()?).try_inverse()?;
        let limit = [self.limit_m, CARRY_SIGMA_RAD];
        let reckoned = Reckoned { world_from_camera: found, covariance, limit };
        self.aligned = Some(Aligned { reckoned, last_from_now: before.inverse() * found, free });
        self.aligned.as_ref()
    }

    /// Where the texture of the surface puts the camera along what its shape leaves free.
    fn by_texture(
        &mut self,
        snapshot: &Snapshot,
        reference: KeyFrameId,
        image: &DepthImage,
        tracked: &DenseTracked,
        known: &Matrix6<f64>,
    ) -> Option<DenseTracked> {
        if tracked.free.is_empty() || !is_sound(tracked) {
            return None;
        }
        let here = tracked.volume_from_camera * self.camera_from_depth.inverse();
        let (before, pose) = self.surface.view_of(snapshot, reference, &here)?;
        let pose = pose * self.camera_from_depth;
        self.texture.find((&before, &pose), image, &mut self.preparer, tracked, known, &self.config)
    }

    /// The frame has a pose: by features, which suffice by themselves or not (`is_sure`), or only by what carries it.
    pub fn placed(&mut self, snapshot: &Snapshot, stamp: Stamp, anchored: AnchoredPose, by: Placement) {
        self.located = if by == Placement::Sure { self.located + 1 } else { 0 };
        self.carried = if by == Placement::Carried { self.carried + 1 } else { 0 };
        let tracked = Matrix6::from_diagonal(&sigmas(TRACKED_SIGMA_M, TRACKED_SIGMA_RAD).map(|s| s * s));
        let aligned = self.aligned.as_ref().map(|a| a.reckoned.covariance);
        let before = self.last.take();
        let covariance = match (by, aligned, &before) {
            (Placement::Carried, Some(aligned), _) => aligned,
            (Placement::Carried, None, Some(before)) => before.covariance,
            _ => tracked,
        };
        let moved = before.and_then(|l| {
            let seconds = Some(stamp - l.stamp).filter(|s| *s > 0.0 && *s < PREDICTED_S)?;
            let pose = snapshot.resolve(l.anchored.reference, &l.anchored.reference_from_camera)?;
            Some(pose.local(&anchored.world_from_camera) / seconds)
        });
        self.last = Some(PosedFrame { stamp, anchored, covariance, velocity: moved.unwrap_or_default() });
        let is_needed = self.located < LOCATED && (self.is_active || by != Placement::Sure);
        self.is_active = self.is_front_end || is_needed;
        if !self.is_active {
            self.surface.forget_field();
        }
        let gray = self.texture.take_gray();
        let Some(image) = self.image.take() else { return };
        if self.is_active && self.aligned.is_some() {
            // Its image is the one that was prepared last.
            let world_from_depth = anchored.world_from_camera * self.camera_from_depth;
            self.surface.fuse(snapshot, self.preparer.frame(), &world_from_depth);
        }
        self.surface.take(image, gray, anchored);
    }

    /// The camera is in another map, or was found elsewhere: what was seen before is not what is around it.
    pub fn moved_elsewhere(&mut self) {
        self.surface.clear();
        (self.last, self.aligned, self.is_active) = (None, None, self.is_front_end);
        self.disagreement = Disagreement::default();
    }

    /// Goes on where a search has found the camera: images that were aligned there, oldest first, and the covariance of the last
    /// pose.
    pub fn begin_at(&mut self, frames: &[(Stamp, Arc<DepthImage>, AnchoredPose)], covariance: Matrix6<f64>) {
        self.moved_elsewhere();
        for (stamp, image, anchored) in frames {
            let velocity =
                self.last.as_ref().filter(|last| *stamp > last.stamp).map_or(Vector6::zeros(), |last| {
                    let moved = last.anchored.world_from_camera.local(&anchored.world_from_camera);
                    moved / (*stamp - last.stamp)
                });
            self.last = Some(PosedFrame { stamp: *stamp, anchored: *anchored, covariance, velocity });
            self.surface.take(image.clone(), None, *anchored);
        }
        (self.is_active, self.located, self.carried) = (true, 0, 0);
    }

    /// Covariance of an aligned pose: that of the alignment, which adds up from frame to frame as the field is fused with the poses
    /// found in it, and that of the map around. Of the camera's right perturbation.
    fn measured(&self, tracked: &DenseTracked) -> Matrix6<f64> {
        let turn = self.camera_from_depth.adjoint();
        let own = tracked.covariance * (self.carried + 1) as f64;
        let floor = sigmas(TRACKED_SIGMA_M, TRACKED_SIGMA_RAD).map(|s| s * s);
        turn * own * turn.transpose() + Matrix6::from_diagonal(&floor)
    }
}

/// How a frame got its pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// By features, as many as the tracker's setting wants.
    Sure,
    /// By few features.
    Weak,
    /// By the depth or what else carries it.
    Carried,
}

fn sigmas(m: f64, rad: f64) -> Vector6<f64> {
    Vector6::new(m, m, m, rad, rad, rad)
}

fn is_sound(tracked: &DenseTracked) -> bool {
    let [near, all] = tracked.points;
    tracked.converged && near as f64 >= LEAST_SHARE * all as f64 && tracked.rms_m <= MOST_RMS_M
}

/// The pose that a measured motion, else constant velocity, predicts.
fn predict(
    last: &PosedFrame,
    before: &Se3,
    stamp: Stamp,
    step: Option<(Se3, [f64; 2])>,
) -> Option<Prediction> {
    let seconds = stamp - last.stamp;
    if !(seconds > 0.0 && seconds < PREDICTED_S) {
        return None;
    }
    let (moved, [m, rad]) =
        step.unwrap_or_else(|| (Se3::exp(&(last.velocity * seconds)), MOTION_VARIANCE.map(|v| v * seconds)));
    let back = moved.inverse().adjoint();
    let covariance = back * last.covariance * back.transpose()
        + Matrix6::from_diagonal(&Vector6::new(m, m, m, rad, rad, rad));
    Some(Prediction { world_from_camera: *before * moved, covariance })
}
