//! Place recognition, verified by geometry: the pose of a frame among the landmarks around an earlier key frame, matched by
//! appearance first. Nothing is accepted that geometry does not confirm.
//!
//! In: a frame and a key frame that may show the same place. Out: the pose with its inlier landmarks, or the number
//! that was too small. Stages: descriptors of the landmarks around the key frame against all features; P3P in RANSAC;
//! pose-only adjustment; the same landmarks and their neighbours' projected and searched for; adjustment again.

use crate::locate;
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, Snapshot, Viewpoint};
use cairn_geometry::{Se3, Vec3};
use cairn_vision::{
    DescriptorQuery, Frame, PnpConfig, RectifiedCamera, Target, match_descriptors, pnp_ransac, search,
};
use std::collections::BTreeSet;
use std::fmt;

/// Largest descriptor distance in bits for a match by appearance alone.
const MATCHING: u32 = 60;
/// Ratio test: the distance of the best match over that of the second best, at most.
const RATIO: f64 = 0.85;
/// Largest descriptor distance in bits for a match near its projection.
const PROJECTED_DISTANCE: u32 = 80;
/// Key frames around the old one whose landmarks are compared by appearance, and those projected.
const COMPARED: usize = 4;
const PROJECTED: usize = 12;

/// What it takes to accept a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecogniseConfig {
    /// Matches by appearance that must agree on a pose before more are searched for.
    pub seed: usize,
    /// Inliers needed in the end.
    pub need: usize,
    /// Share of all matches found that must be inliers.
    pub share: f64,
}

/// Of all landmarks that should be in view, the share that must agree: where walls and doors repeat, some always do
/// (measured in corridors: 0.07 and 0.08 in wrong places, 0.3 and more in right ones).
const IN_VIEW: f64 = 0.15;

/// A recognised place.
#[derive(Clone, Debug)]
pub struct Recognised {
    /// The earlier key frame.
    pub old: KeyFrameId,
    /// Pose of the camera in the map of `old`.
    pub world_from_camera: Se3,
    /// For each feature its landmark, outliers left out.
    pub landmarks: Vec<Option<LandmarkId>>,
    /// How many of them.
    pub inliers: usize,
    /// Number of landmarks of the place expected in view.
    pub expected: usize,
}

/// Why a place was not recognised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MatchFailure {
    /// Too few matches by appearance.
    Appearance {
        /// Matches by appearance.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// Too few of them agree on a pose.
    Posed {
        /// Agree.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// Too few landmarks are where that pose expects them.
    Agree {
        /// Agree.
        have: usize,
        /// Found at all.
        of: usize,
        /// Needed.
        need: usize,
    },
    /// Too many landmarks that should be in view are not there.
    Missing {
        /// Agree.
        have: usize,
        /// Should be in view.
        expected: usize,
        /// Needed.
        need: usize,
    },
}

impl MatchFailure {
    /// How many matches agreed.
    pub fn agreed(&self) -> usize {
        match self {
            Self::Appearance { .. } => 0,
            Self::Posed { have, .. } | Self::Agree { have, .. } | Self::Missing { have, .. } => *have,
        }
    }
}

impl fmt::Display for MatchFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Appearance { have, need } => {
                write!(f, "{have} features match by appearance, {need} needed")
            }
            Self::Posed { have, need } => write!(f, "{have} agree on a pose, {need} needed"),
            Self::Agree { have, of, need } => write!(f, "{have} of {of} landmarks agree, {need} needed"),
            Self::Missing { have, expected, need } => {
                write!(f, "{have} of {expected} landmarks in view are there, {need} needed")
            }
        }
    }
}

impl std::error::Error for MatchFailure {}

/// A frame with the camera that it was taken with.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// Its camera.
    pub camera: &'a RectifiedCamera,
    /// Focal length of its camera over that of the atlas's.
    pub focal_ratio: f64,
}

impl<'a> View<'a> {
    /// A frame of the atlas's camera.
    pub fn new(camera: &'a RectifiedCamera, frame: &'a Frame) -> Self {
        Self { frame, camera, focal_ratio: 1.0 }
    }

    /// That of a key frame, where `atlas` is the camera of the atlas.
    pub fn of(atlas: &'a RectifiedCamera, k: &'a KeyFrame) -> Self {
        Self { frame: &k.frame, camera: k.camera(atlas), focal_ratio: k.focal_ratio() }
    }
}

/// Tests whether a frame shows the place around the key frame `old`. Landmarks in `known` are left out. The same `seed`
/// gives the same result.
///
/// # Errors
/// [`MatchFailure`] with the stage that failed and its numbers.
pub fn recognise(
    snapshot: &Snapshot,
    view: &View,
    old: KeyFrameId,
    known: &BTreeSet<LandmarkId>,
    config: &RecogniseConfig,
    seed: u64,
) -> Result<Recognised, MatchFailure> {
    let View { frame, camera, .. } = *view;
    let near = landmarks_around(snapshot, old, COMPARED, known);
    let mut landmarks = matching(snapshot, frame, &near);
    let have = landmarks.iter().flatten().count();
    if have < config.seed {
        return Err(MatchFailure::Appearance { have, need: config.seed });
    }
    let posed = |have| MatchFailure::Posed { have, need: config.seed };
    let guess = pose_from_points(snapshot, camera, frame, &landmarks, config.seed, seed).map_err(posed)?;
    let first = locate(snapshot, camera, frame, &guess, &landmarks, &[], None);
    if first.inliers < config.seed {
        return Err(posed(first.inliers));
    }
    let mut pose = first.world_from_camera;
    first.outliers.iter().for_each(|i| landmarks[*i] = None);
    let wide = landmarks_around(snapshot, old, PROJECTED, known);
    let (mut of, mut inliers, mut expected) = (0, 0, 0);
    for radius in [8.0, 4.0] {
        expected = project(snapshot, view, &wide, &pose, radius, &mut landmarks);
        of = landmarks.iter().flatten().count();
        let found = locate(snapshot, camera, frame, &pose, &landmarks, &[], None);
        found.outliers.iter().for_each(|i| landmarks[*i] = None);
        (pose, inliers) = (found.world_from_camera, found.inliers);
    }
    if inliers < config.need || (inliers as f64) < config.share * of as f64 {
        let need = config.need.max((config.share * of as f64).ceil() as usize);
        return Err(MatchFailure::Agree { have: inliers, of, need });
    }
    let need = (IN_VIEW * expected as f64).ceil() as usize;
    if inliers < need {
        return Err(MatchFailure::Missing { have: inliers, expected, need });
    }
    Ok(Recognised { old, world_from_camera: pose, landmarks, inliers, expected })
}

/// Landmarks observed by a key frame and its most covisible neighbours.
fn landmarks_around(
    snapshot: &Snapshot,
    centre: KeyFrameId,
    neighbours: usize,
    known: &BTreeSet<LandmarkId>,
) -> Vec<LandmarkId> {
    let Some(k) = snapshot.key_frame(centre) else { return Vec::new() };
    let near = k.covisible.iter().take(neighbours).filter_map(|(id, _)| snapshot.key_frame(*id));
    let mut all: Vec<LandmarkId> =
        std::iter::once(k).chain(near).flat_map(|k| k.landmarks.iter().flatten().copied()).collect();
    all.sort_unstable();
    all.dedup();
    all.retain(|id| !known.contains(id));
    all
}

/// For each feature the landmark matched by appearance alone.
fn matching(snapshot: &Snapshot, frame: &Frame, landmarks: &[LandmarkId]) -> Vec<Option<LandmarkId>> {
    // Orientation as the latest observer saw it.
    let known = landmarks.iter().filter_map(|id| snapshot.landmark(*id));
    let looks = known.map(|l| DescriptorQuery { item: l.id, descriptor: &l.descriptor, angle: l.angle });
    let mut matches = vec![None; frame.len()];
    for (feature, id) in match_descriptors(looks, frame, MATCHING, RATIO) {
        matches[feature] = Some(id);
    }
    matches
}

/// The pose that most matches agree on, or how many agreed at best.
fn pose_from_points(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    frame: &Frame,
    matches: &[Option<LandmarkId>],
    need: usize,
    seed: u64,
) -> Result<Se3, usize> {
    let pairs = matches.iter().enumerate().filter_map(|(i, id)| {
        let landmark = snapshot.landmark((*id)?)?;
        Some((landmark.position, camera.unproject(frame.px[i], 1.0).normalize()))
    });
    let (points, bearings): (Vec<Vec3>, Vec<Vec3>) = pairs.unzip();
    let config =
        PnpConfig { threshold_rad: 2.45 * 2.0 / camera.fx, min_inliers: need, ..PnpConfig::default() };
    match pnp_ransac(&points, &bearings, &config, seed) {
        Ok(found) => Ok(found.camera_from_world.inverse()),
        Err(rejected) => Err(rejected.inliers),
    }
}

/// Adds the landmarks found near their projections; returns how many are expected in view.
fn project(
    snapshot: &Snapshot,
    view: &View,
    landmarks: &[LandmarkId],
    world_from_camera: &Se3,
    radius: f64,
    matches: &mut [Option<LandmarkId>],
) -> usize {
    let View { frame, camera, focal_ratio } = *view;
    let mut expected = 0;
    let mut taken: BTreeSet<LandmarkId> = matches.iter().flatten().copied().collect();
    let octaves = snapshot.octaves();
    let viewpoint = Viewpoint::of_camera(camera, world_from_camera, focal_ratio);
    for l in landmarks.iter().filter_map(|id| snapshot.landmark(*id)) {
        let Some(seen) = viewpoint.sees(l) else { continue };
        expected += 1;
        if taken.contains(&l.id) {
            continue;
        }
        let [u, v, right] = seen.pixel;
        let level = octaves.predict(seen.farthest, seen.distance);
        let target = Target {
            pixel: [u as f32, v as f32],
            right_x: if camera.has_depth() { right as f32 } else { f32::NAN },
            radius: (radius * octaves.scale(level)) as f32,
            octaves: [level.saturating_sub(1), level],
            descriptor: &l.descriptor,
        };
        let Some(found) = search(frame, &target, |i| matches[i].is_none()) else { continue };
        if found.distance <= PROJECTED_DISTANCE {
            matches[found.feature] = Some(l.id);
            taken.insert(l.id);
        }
    }
    expected
}
