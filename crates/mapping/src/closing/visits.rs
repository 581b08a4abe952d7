//! Two visits of what may be one place: whether scale, gravity, the drift between them and the motion measured meanwhile allow it.

use super::relax::Freedom;
use super::scales::{DepthRatio, FusedScales, ScaleMatch, fuse_scales};
use super::verdict::Refusal;
use crate::triangulation::median_depth;
use cairn_adjust::{MotionLinks, Recognised, has_parallax};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3, YawPose};
use cairn_vision::RectifiedCamera;

/// Largest logarithm of the scale change between two visits of one map, and between two maps.
const MAX_LOG_SCALE: [f64; 2] = [0.7, 2.5];

/// Largest angle between the gravity directions of two visits, radians.
const MAX_TILT_RAD: f64 = 0.09;

/// Plausible drift of the orientation in radians: a constant part, and its growth for each key frame in between.
const TURNED_RAD: [f64; 2] = [0.35, 5e-4];

/// A key frame, and an earlier one that may show the same place.
pub(super) struct Visits<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) camera: &'a RectifiedCamera,
    pub(super) here: &'a KeyFrame,
    pub(super) old: KeyFrameId,
}

impl Visits<'_> {
    /// The degrees of freedom that may have drifted between two visits.
    pub(super) fn freedom(&self) -> Freedom {
        let maps = [Some(self.here.map), self.snapshot.key_frame(self.old).map(|k| k.map)];
        let both = |has: &dyn Fn(MapId) -> bool| maps.iter().all(|map| map.is_some_and(has));
        let metric = both(&|map| self.snapshot.is_metric_in(map, self.camera));
        match (both(&|map| self.snapshot.is_gravity_aligned(map)), metric) {
            (true, _) => Freedom::AlignGravity,
            (false, true) => Freedom::Metric,
            (false, false) => Freedom::Similar,
        }
    }

    /// What the depths of the points known in both say of the scale.
    pub(super) fn depth_ratio(&self, place: &Recognised) -> DepthRatio {
        let (snapshot, here) = (self.snapshot, self.here);
        let (camera_from_here, camera_from_there) =
            (here.world_from_camera.inverse(), place.world_from_camera.inverse());
        let metric = self.freedom() != Freedom::Similar;
        // A depth that was assumed while a monocular camera turned on the spot gives no information on scale.
        let seen = |id: &Option<LandmarkId>| {
            snapshot.landmark((*id)?).filter(|l| metric || has_parallax(snapshot, l, None))
        };
        let both = here.landmarks.iter().zip(&place.landmarks).filter_map(|(mine, theirs)| {
            let mine = camera_from_here * seen(mine)?.position;
            let theirs = camera_from_there * seen(theirs)?.position;
            (mine.z > 0.0 && theirs.z > 0.0).then(|| (theirs.z / mine.z).ln())
        });
        DepthRatio::of(both.collect())
    }

    /// The scales of two maps that have metres, weighed by what a place recognised between them tells; `None` for visits of one map, or
    /// where one has no metres. `need` as for [`Self::scale`].
    pub(super) fn fused_scales(
        &self,
        ratio: &DepthRatio,
        need: usize,
    ) -> Result<Option<FusedScales>, Refusal> {
        let there = self.snapshot.key_frame(self.old).map(|k| k.map);
        let Some(there) = there.filter(|there| *there != self.here.map) else { return Ok(None) };
        if self.freedom() == Freedom::Similar {
            return Ok(None);
        }
        let known = [there, self.here.map].map(|map| self.snapshot.scale_of(map, self.camera));
        let measured = ScaleMatch::of_place(ratio, need / 4);
        fuse_scales(known, measured).map(Some).map_err(Refusal::MetricScale)
    }

    /// Scale (length in the earlier map for each length here), by the depths of the points known in both
    /// ([`Self::depth_ratio`]); `need`: inlier matches needed to accept a place.
    pub(super) fn scale(&self, ratio: &DepthRatio, need: usize) -> Result<f64, Refusal> {
        let (snapshot, here, metric) = (self.snapshot, self.here, self.freedom() != Freedom::Similar);
        let DepthRatio { log: median, spread, points } = *ratio;
        let merging = snapshot.key_frame(self.old).is_some_and(|k| k.map != here.map);
        let most = MAX_LOG_SCALE[usize::from(merging)];
        let refusal = Refusal::Scale { points, median: median.exp(), spread };
        if points < need / 4 {
            // With depth, the scale is known even for a view that shares no points yet.
            return if metric { Ok(1.0) } else { Err(refusal) };
        }
        // A scale estimated with the IMU is accurate to a few percent.
        let there = snapshot.key_frame(self.old).unwrap_or(here);
        let depth = [here, there].iter().all(|k| k.camera(self.camera).has_depth());
        let most_metric = if depth { 0.1 } else { 0.2 };
        match metric {
            true if median.abs() < most_metric => Ok(1.0),
            false if spread < 0.15 && median.abs() < most => Ok(median.exp()),
            _ => Err(refusal),
        }
    }

    /// The plausible drift of a key frame over the distance travelled since an earlier one; shares of it with metric
    /// scale and without.
    pub(super) fn plausible_drift(&self, [with, without]: [f64; 2]) -> f64 {
        let (here, old) = (self.here, self.old);
        // In order of creation: a map prior relates each map to the previous one.
        let since: Vec<Se3> = self
            .snapshot
            .key_frames()
            .filter(|k| k.id >= old.min(here.id) && k.id <= here.id.max(old))
            .map(|k| k.world_from_camera)
            .collect();
        let travelled: f64 = since.windows(2).map(|w| (w[1].translation - w[0].translation).norm()).sum();
        match self.freedom() != Freedom::Similar {
            true => 0.5 + with * travelled,
            false => 0.3 * median_depth(self.snapshot, here).unwrap_or(0.0) + without * travelled,
        }
    }

    /// The plausible drift of the orientation between the two visits, radians.
    pub(super) fn plausible_turn_rad(&self) -> f64 {
        TURNED_RAD[0] + TURNED_RAD[1] * self.here.id.index().abs_diff(self.old.index()) as f64
    }

    /// Whether the motion measured since an earlier key frame contradicts a pose relative to it. A person who was seen there and is seen
    /// here looks the same.
    pub(super) fn contradicts_motion(&self, links: &MotionLinks, world_from_here: &Se3) -> bool {
        let measured = links.between(self.old, self.here.id).zip(self.snapshot.key_frame(self.old));
        measured.is_some_and(|(motion, old)| {
            !motion.agrees(&(old.world_from_camera.inverse() * *world_from_here))
        })
    }
}

/// The recognised pose of a key frame, with roll and pitch taken from its own gravity-aligned map.
pub(super) fn with_gravity_of(here: &KeyFrame, world_from_here: &Sim3) -> Result<Sim3, Refusal> {
    let turn = world_from_here.rotation * here.world_from_camera.rotation.inverse();
    let tilt_rad = (turn * Vec3::z()).angle(&Vec3::z());
    if tilt_rad > MAX_TILT_RAD {
        return Err(Refusal::Tilt { tilt_rad });
    }
    let heading = YawPose::split(&Se3::new(turn, Vec3::zeros())).0.rotation();
    let rotation = heading * here.world_from_camera.rotation;
    Ok(Sim3::new(rotation, world_from_here.translation, world_from_here.scale))
}

/// A metre in units of the map of a key frame; where these are unknown, a fourth of the median depth stands for it.
pub(super) fn metre_in_map_units(snapshot: &Snapshot, here: &KeyFrame, freedom: Freedom) -> f64 {
    match freedom {
        Freedom::Similar => 0.25 * median_depth(snapshot, here).unwrap_or(0.0),
        _ => 1.0,
    }
}
