//! The pose of a frame from the landmarks matched to its features.

use crate::{pinhole, pixel, weight};
use cairn_atlas::{LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_solve::{PointMatch, PoseOnly, PoseOnlyConfig, PosePrior, Report};
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SMatrix;

/// A pose with its evidence.
#[derive(Clone, Debug)]
pub struct Located {
    /// Pose of the camera.
    pub world_from_camera: Se3,
    /// Features whose match is an outlier.
    pub outliers: Vec<usize>,
    /// Number of inlier matches.
    pub inliers: usize,
    /// Information over (translation, rotation) of the camera, that of a prior included.
    pub information: SMatrix<f64, 6, 6>,
    /// How the solve went.
    pub report: Report,
}

/// Solves for the pose of a frame. `matches` has a landmark or none per feature, `extra` further features with points that
/// are not in the map; `prior` is what is known of the pose without them.
pub fn locate(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    frame: &Frame,
    guess: &Se3,
    matches: &[Option<LandmarkId>],
    extra: &[(usize, Vec3)],
    prior: Option<&PosePrior>,
) -> Located {
    let known =
        matches.iter().enumerate().filter_map(|(i, id)| Some((i, snapshot.landmark((*id)?)?.position)));
    let (features, points): (Vec<usize>, Vec<PointMatch>) = known
        .chain(extra.iter().copied())
        .map(|(i, point)| {
            (
                i,
                PointMatch {
                    point,
                    pixel: pixel(snapshot, frame, i),
                    weight: weight(frame, i, &snapshot.octaves()),
                },
            )
        })
        .unzip();
    let found = PoseOnly::solve(&pinhole(camera), guess, &points, prior, &PoseOnlyConfig::default());
    let outliers = features.iter().zip(&found.inlier).filter(|(_, ok)| !**ok).map(|(i, _)| *i).collect();
    Located {
        world_from_camera: found.world_from_camera,
        outliers,
        inliers: found.report.inliers,
        information: found.information,
        report: found.report,
    }
}
