//! Where a frame was taken, from the landmarks its features show.

use crate::{pinhole, pixel, weight};
use cairn_atlas::{LandmarkId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_solve::{PointMatch, PoseOnly, PoseOnlyConfig, PosePrior, Report};
use cairn_vision::{Frame, RectifiedCamera};
use nalgebra::SMatrix;

/// A pose with what speaks for it.
#[derive(Clone, Debug)]
pub struct Located {
    /// Where the eye is.
    pub world_from_camera: Se3,
    /// Features whose match does not fit.
    pub outliers: Vec<usize>,
    /// Matches that fit.
    pub inliers: usize,
    /// Information over (translation, rotation) of the eye, that of a prior included.
    pub information: SMatrix<f64, 6, 6>,
    /// How the solve went.
    pub report: Report,
}

/// Solves for the pose of a frame; `matches` holds a landmark per feature, `extra` further features with a
/// point that is not in the map, `prior` what is believed of the pose without them.
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
