//! The unit of length of a monocular map while it is tracked: watched, assumed from the walking speed, corrected.

use super::Tracker;
use crate::match_last::Matches;
use crate::parallax::ParallaxWatch;
use crate::scale::{LEAST, Pace, PaceComparison, ScaleSupport};
use crate::state::{AnchoredPose, KeyFrameRequest, RelocationPrior, anchored_at};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// The least share of the time between two frames with parallax in which the walker must have been walking.
const LEAST_WALKED: f64 = 0.05;
/// Maximum number of poses stored while scale is not supported.
const UNSUPPORTED: usize = 600;

/// Position uncertainty of a walker who turns on the spot: standard deviation in metres, and its growth in metres per
/// second.
const ON_THE_SPOT_M: [f64; 2] = [0.3, 0.2];
/// Standard deviation of an orientation carried forward by rotation alone, radians.
pub(super) const TURNED_RAD: f64 = 0.1;

impl Tracker {
    /// Typical walking speed, in the map's unit per second.
    pub(crate) fn typical_speed(&self) -> Option<f64> {
        match &self.pace_comparison {
            Some(comparison) if comparison.is_early() => Some(comparison.pace),
            _ => self.pace.walking(LEAST).map(|(speed, _)| speed),
        }
    }

    /// The mean speed between the two frames with which a map begins, assuming the usual walking speed except while
    /// the camera was seen to turn on the spot.
    pub(crate) fn assumed_speed(&self, first: Stamp, second: Stamp) -> Option<f64> {
        let walked_s = second - self.turned_until.map_or(first, |turned| turned.clamp(first, second));
        self.typical_speed().map(|pace| pace * (walked_s / (second - first)).max(LEAST_WALKED))
    }

    /// A map has just been created: no speed in it is known, and where its unit of length was guessed from the
    /// previous walking speed, that speed is stored for comparison.
    pub(crate) fn start_pace(&mut self, snapshot: &Snapshot, root: &KeyFrame) {
        self.scale_support = ScaleSupport::default();
        self.parallax = ParallaxWatch::default();
        self.unsupported.clear();
        let guessed = !self.camera.has_depth() && !snapshot.is_gravity_aligned(root.map);
        let prior = snapshot.maps().find(|(id, _)| *id == root.map).is_some_and(|(_, prior)| prior.is_some());
        self.pace_comparison = (self.typical_speed().filter(|_| guessed && prior))
            .map(|pace| PaceComparison { map: root.map, pace, done: 0 });
        self.pace = Pace::default();
    }

    /// Whether lengths in the map are meaningful: the landmarks in view have parallax, and a unit that was guessed
    /// when the map began was compared with the walking speed.
    pub(crate) fn is_scale_supported(&self) -> bool {
        !self.scale_support.is_lost() && self.pace_comparison.as_ref().is_none_or(|c| c.done > 0)
    }

    /// Checks whether scale is supported at a frame whose pose is known.
    pub(crate) fn watch_scale(
        &mut self,
        frame: &Arc<Frame>,
        snapshot: &Snapshot,
        matches: &Matches,
        anchored: AnchoredPose,
    ) {
        let map = map_of(snapshot, anchored.reference);
        if self.camera.has_depth() || map.is_some_and(|map| snapshot.is_gravity_aligned(map)) {
            self.scale_support = ScaleSupport::default();
            self.parallax = ParallaxWatch::default();
        } else {
            self.scale_support.update(snapshot, &matches.landmarks);
            let depth = median_depth(snapshot, &matches.landmarks, &anchored.world_from_camera);
            if let Some(depth) = depth {
                self.parallax.update(&self.camera, snapshot, frame, &anchored, depth);
            }
            if self.parallax.is_turning() {
                self.turned_until = Some(frame.stamp);
            }
        }
        if !self.scale_support.is_lost() {
            self.unsupported.clear();
            return;
        }
        self.keep_unsupported(frame.stamp, anchored);
    }

    /// Stores a pose without support of scale.
    pub(crate) fn keep_unsupported(&mut self, stamp: Stamp, anchored: AnchoredPose) {
        if self.unsupported.len() == UNSUPPORTED {
            self.unsupported.pop_front();
        }
        self.unsupported.push_back((stamp, anchored));
    }

    /// Standard deviation of the position of a walker who has turned on the spot for this long, in the map's unit.
    pub(crate) fn on_the_spot_sigma(&self, seconds: f64) -> f64 {
        (ON_THE_SPOT_M[0] + ON_THE_SPOT_M[1] * seconds) * self.metre_in_map_units()
    }

    /// The prior of a map that begins with a frame whose orientation was carried through a turn by rotation alone.
    pub(crate) fn rotation_prior(&self, stamp: Stamp, snapshot: &Snapshot) -> Option<RelocationPrior> {
        let (since, _) = *self.unsupported.front()?;
        let (_, placed) = *self.unsupported.iter().find(|(at, _)| *at == stamp)?;
        let (reference, _) = snapshot.surviving_ancestor(placed.reference)?;
        let world_from_camera = snapshot.resolve(placed.reference, &placed.reference_from_camera)?;
        Some(RelocationPrior {
            anchored: anchored_at(snapshot, reference, world_from_camera)?,
            sigma: self.on_the_spot_sigma(stamp - since),
            sigma_rad: TURNED_RAD,
            speed: None,
            sigma_log_scale: self.sigma_log_scale(),
            gravity_aligned: false,
            assumed_since: self.scale_support.assumed_since(),
        })
    }

    /// Begins a new map with its own unit of length, once two views since the loss of scale support have parallax:
    /// the further route is then not measured with the assumed depths that carried the orientation through the turn.
    pub(crate) fn begin_with_own_scale(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
    ) -> Option<KeyFrameRequest> {
        let request = self.starter.step(&self.camera, &frame, self.features).ok()?;
        let mut request = self.with_imu_segment(request);
        if let KeyFrameRequest::Pair { first, second, relocation_prior, .. } = &mut request {
            let speed = self.assumed_speed(first.stamp, second.stamp);
            let prior = self.rotation_prior(first.stamp, snapshot)?;
            *relocation_prior = Some(RelocationPrior { speed, ..prior });
        }
        Some(request)
    }

    /// Once the walk in a map with a guessed unit is long enough: the factor by which its lengths have to change.
    pub(crate) fn due_rescale(&mut self, snapshot: &Snapshot, reference: KeyFrameId) -> Option<(f64, f64)> {
        let comparison = self.pace_comparison.as_mut()?;
        if map_of(snapshot, reference) != Some(comparison.map) || snapshot.is_gravity_aligned(comparison.map)
        {
            self.pace_comparison = None;
            return None;
        }
        comparison.due(&self.pace, self.rate_hz)
    }
}

/// The median depth of the landmarks that agree with a pose, in the map's unit.
fn median_depth(
    snapshot: &Snapshot,
    landmarks: &[Option<LandmarkId>],
    world_from_camera: &Se3,
) -> Option<f64> {
    let camera_from_world = world_from_camera.inverse();
    let mut depths: Vec<f64> = (landmarks.iter().flatten())
        .filter_map(|id| Some((camera_from_world * snapshot.landmark(*id)?.position).z))
        .filter(|z| z.is_finite() && *z > 0.0)
        .collect();
    let middle = depths.len() / 2;
    (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The map that a key frame is in, or the map it was merged into.
fn map_of(snapshot: &Snapshot, id: KeyFrameId) -> Option<MapId> {
    snapshot.surviving_ancestor(id).and_then(|(id, _)| Some(snapshot.key_frame(id)?.map))
}
