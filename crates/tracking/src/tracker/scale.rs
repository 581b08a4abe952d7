//! The unit of length of a monocular map while it is tracked: watched, assumed from the walking speed, corrected; and how far a
//! walker can get in it.

use crate::match_last::Matches;
use crate::parallax::ParallaxWatch;
use crate::scale::{LEAST, PACE_SIGMA, Pace, PaceComparison, ScaleSupport};
use crate::setup::Setup;
use crate::state::{AnchoredPose, Last, RelocationPrior, anchored_at, map_of};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::collections::VecDeque;
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

/// How far apart two observations of one place may be in a map that has drifted, metres.
const DRIFT_M: f64 = 2.0;
/// Standard deviation of the logarithm of a new map's scale where not even a walking speed is known.
const NO_PACE_SIGMA: f64 = 2.0;

/// What is known of the unit of length, where neither depth nor an IMU gives it.
#[derive(Debug)]
pub(crate) struct UnitOfLength {
    pub(super) setup: Setup,
    /// Speeds of the last frames, map units per second.
    pub pace: Pace,
    /// Whether scale is supported.
    pub support: ScaleSupport,
    /// Whether there is parallax to observe depth.
    pub parallax: ParallaxWatch,
    /// A map whose unit of length was guessed from the walking speed.
    pub comparison: Option<PaceComparison>,
    /// When the camera was last seen to turn on the spot.
    pub turned_until: Option<Stamp>,
    /// Poses since scale lost its support, for the frame with which a new map begins.
    pub unsupported: VecDeque<(Stamp, AnchoredPose)>,
    /// When the places from before that were last looked for.
    pub(super) looked_for: Option<Stamp>,
    /// The key frame to which the last pose was anchored, and its unit of length at that time.
    unit: Option<(KeyFrameId, f64)>,
}

impl UnitOfLength {
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            pace: Pace::default(),
            support: ScaleSupport::default(),
            parallax: ParallaxWatch::default(),
            comparison: None,
            turned_until: None,
            unsupported: VecDeque::new(),
            looked_for: None,
            unit: None,
        }
    }

    /// Typical walking speed, in the map's unit per second.
    pub fn typical_speed(&self) -> Option<f64> {
        match &self.comparison {
            Some(comparison) if comparison.is_early() => Some(comparison.pace),
            _ => self.pace.walking(LEAST).map(|(speed, _)| speed),
        }
    }

    /// The mean speed between the two frames with which a map begins, assuming the usual walking speed except while
    /// the camera was seen to turn on the spot.
    pub fn assumed_speed(&self, first: Stamp, second: Stamp) -> Option<f64> {
        let walked_s = second - self.turned_until.map_or(first, |turned| turned.clamp(first, second));
        self.typical_speed().map(|pace| pace * (walked_s / (second - first)).max(LEAST_WALKED))
    }

    /// When a loop closure or a map merge has changed the unit of length, speeds are converted to the new one; returns by which
    /// factor.
    pub fn refresh(&mut self, snapshot: &Snapshot) -> Option<f64> {
        let (id, before) = self.unit?;
        let now = snapshot.world_from_here(id).map(|here| here.scale).filter(|now| *now != before)?;
        self.pace.rescale(now / before);
        self.unit = Some((id, now));
        Some(now / before)
    }

    /// A map has just been created: no speed in it is known, and where its unit of length was guessed from the
    /// previous walking speed, that speed is stored for comparison.
    pub fn map_created(&mut self, snapshot: &Snapshot, root: &KeyFrame) {
        self.support = ScaleSupport::default();
        self.parallax = ParallaxWatch::default();
        self.unsupported.clear();
        let guessed = !self.setup.camera.has_depth() && !snapshot.is_gravity_aligned(root.map);
        let prior = snapshot.maps().find(|(id, _)| *id == root.map).is_some_and(|(_, prior)| prior.is_some());
        self.comparison = (self.typical_speed().filter(|_| guessed && prior)).map(|pace| PaceComparison {
            map: root.map,
            pace,
            done: 0,
        });
        self.pace = Pace::default();
    }

    /// Whether lengths in the map are meaningful: the landmarks in view have parallax, and a unit that was guessed
    /// when the map began was compared with the walking speed.
    pub fn is_supported(&self) -> bool {
        !self.support.is_lost() && self.comparison.as_ref().is_none_or(|c| c.done > 0)
    }

    /// Whether nothing supports scale, so that a map with a unit of its own is to begin.
    pub fn is_lost(&self) -> bool {
        self.support.is_lost()
    }

    /// Whether the views tell no depth at present.
    pub fn is_depthless(&self) -> bool {
        self.support.is_lost() || self.parallax.is_turning()
    }

    /// Features have located a frame; `before` is the last pose and the seconds since then, where that was a moment ago.
    pub fn located(
        &mut self,
        frame: &Arc<Frame>,
        snapshot: &Snapshot,
        matches: &Matches,
        anchored: AnchoredPose,
        before: Option<(Se3, f64)>,
    ) {
        match before.filter(|_| !self.support.is_lost()) {
            Some((before, elapsed_s)) => {
                self.pace.moved(anchored.world_from_camera.translation - before.translation, elapsed_s);
            }
            None => self.pace.interrupt(),
        }
        self.unit = snapshot.world_from_here(anchored.reference).map(|here| (anchored.reference, here.scale));
        self.watch(frame, snapshot, matches, anchored);
    }

    /// Checks whether scale is supported at a frame whose pose is known.
    pub fn watch(
        &mut self,
        frame: &Arc<Frame>,
        snapshot: &Snapshot,
        matches: &Matches,
        anchored: AnchoredPose,
    ) {
        let map = map_of(snapshot, anchored.reference);
        if self.setup.camera.has_depth() || map.is_some_and(|map| snapshot.is_gravity_aligned(map)) {
            self.support = ScaleSupport::default();
            self.parallax = ParallaxWatch::default();
        } else {
            self.support.update(snapshot, &matches.landmarks);
            let depth = median_depth(snapshot, &matches.landmarks, &anchored.world_from_camera);
            if let Some(depth) = depth {
                self.parallax.update(&self.setup.camera, snapshot, frame, &anchored, depth);
            }
            if self.parallax.is_turning() {
                self.turned_until = Some(frame.stamp);
            }
        }
        if !self.support.is_lost() {
            self.unsupported.clear();
            return;
        }
        self.keep_unsupported(frame.stamp, anchored);
    }

    /// The camera has turned on the spot up to a frame whose orientation was carried by that alone.
    pub fn turned_on_the_spot(&mut self, stamp: Stamp, anchored: AnchoredPose) {
        self.turned_until = Some(stamp);
        self.keep_unsupported(stamp, anchored);
    }

    /// Stores a pose without support of scale.
    pub fn keep_unsupported(&mut self, stamp: Stamp, anchored: AnchoredPose) {
        if self.unsupported.len() == UNSUPPORTED {
            self.unsupported.pop_front();
        }
        self.unsupported.push_back((stamp, anchored));
    }

    /// Standard deviation of the position of a walker who has turned on the spot for this long, in the map's unit.
    pub fn on_the_spot_sigma(&self, seconds: f64) -> f64 {
        (ON_THE_SPOT_M[0] + ON_THE_SPOT_M[1] * seconds) * self.metre()
    }

    /// The prior of a map that begins with a frame whose orientation was carried through a turn by rotation alone.
    pub fn rotation_prior(&self, stamp: Stamp, snapshot: &Snapshot) -> Option<RelocationPrior> {
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
            assumed_since: self.support.assumed_since(),
        })
    }

    /// Once the walk in a map with a guessed unit is long enough: the factor by which its lengths have to change.
    pub fn due_rescale(&mut self, snapshot: &Snapshot, reference: KeyFrameId) -> Option<(f64, f64)> {
        let comparison = self.comparison.as_mut()?;
        if map_of(snapshot, reference) != Some(comparison.map) || snapshot.is_gravity_aligned(comparison.map)
        {
            self.comparison = None;
            return None;
        }
        comparison.due(&self.pace, self.setup.rate_hz)
    }

    /// Assumed greatest speed while not tracked, m/s.
    fn fastest_m_s(&self) -> f64 {
        self.setup.config.motion.fastest_m_s
    }

    /// About one metre in the map's unit: without metric scale it is estimated from the speed so far.
    pub fn metre(&self) -> f64 {
        match self.setup.camera.has_depth() {
            true => 1.0,
            false => self.typical_speed().unwrap_or(1.0) / self.fastest_m_s(),
        }
    }

    /// The greatest plausible speed without tracking, in the map's unit per second: that of what carries it,
    /// or the speed so far if that was greater.
    pub fn max_plausible_speed(&self) -> f64 {
        (self.fastest_m_s() * self.metre()).max(self.typical_speed().unwrap_or(0.0))
    }

    /// Whether the camera can have reached a pose in a key frame's map since its last known pose: this rejects rooms
    /// that only look the same. For another map, or a loaded one, appearance alone decides.
    pub fn reaches(
        &self,
        snapshot: &Snapshot,
        last: Option<&Last>,
        key_frame: KeyFrameId,
        place: &Se3,
        stamp: Stamp,
    ) -> bool {
        let Some(last) = last else { return true };
        if map_of(snapshot, key_frame) != map_of(snapshot, last.anchored.reference) {
            return true;
        }
        let moved = (place.translation - last.anchored.world_from_camera.translation).norm();
        moved <= 2.0 * self.max_plausible_speed() * (stamp - last.frame.stamp) + DRIFT_M * self.metre()
    }

    /// Uncertainty of the scale of a map that begins now against the previous one: the standard deviation of its
    /// logarithm.
    pub fn sigma_log_scale(&self) -> f64 {
        match (self.setup.camera.has_depth(), self.typical_speed()) {
            (true, _) => 0.0,
            (false, Some(_)) => PACE_SIGMA[0],
            (false, None) => NO_PACE_SIGMA,
        }
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
