//! What a single camera knows of scale from frame to frame: whether it still rests on landmarks with parallax, and how
//! fast the walker goes.
//!
//! While the camera turns on the spot there is no parallax. New landmarks then have a depth that was only assumed, and a
//! map that goes on from them alone takes its unit of length from that assumption. So scale counts as supported only
//! while enough of the tracked landmarks have parallax between key frames from before.

use crate::match_last::Matches;
use crate::parallax::ParallaxWatch;
use crate::state::{AnchoredPose, KeyFrameRequest, RelocationPrior};
use crate::tracker::{Tracker, anchored_at};
use cairn_adjust::has_parallax;
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::collections::VecDeque;
use std::sync::Arc;

/// Fewer tracked landmarks with parallax than this do not support scale,
const FEW: usize = 12;
/// when they are also fewer than this share of all,
const FEW_SHARE: f64 = 0.25;
/// for so many frames running.
const FEW_FRAMES: usize = 3;
/// So many support it again.
const ENOUGH: usize = 25;

/// Watches what scale rests on. Only for maps whose unit of length neither depth nor an inertial sensor gives.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ScaleSupport {
    /// Frames running with too few landmarks with parallax, and the key frame that was next when they began.
    few: Option<(usize, KeyFrameId)>,
}

impl ScaleSupport {
    /// Takes the landmarks that agree with the pose of a frame. Once too few of them have parallax, only key frames from
    /// before count, since later ones stand where an assumed depth puts them.
    pub fn update(&mut self, snapshot: &Snapshot, landmarks: &[Option<LandmarkId>]) {
        let next = snapshot.next_key_frame_id();
        let before = self.few.map_or(next, |(_, before)| before);
        let tracked = landmarks.iter().flatten().filter_map(|id| snapshot.landmark(*id));
        let (mut all, mut supporting) = (0, 0);
        for landmark in tracked {
            all += 1;
            supporting += usize::from(has_parallax(snapshot, landmark, Some(before)));
        }
        let few = supporting < FEW && (supporting as f64) < FEW_SHARE * all as f64;
        self.few = match self.few {
            Some((frames, before)) if self.is_lost() && supporting < ENOUGH => Some((frames + 1, before)),
            Some((frames, before)) if few => Some((frames + 1, before)),
            None if few => Some((1, next)),
            _ => None,
        };
    }

    /// Whether scale rests on nothing any more.
    pub fn is_lost(&self) -> bool {
        self.few.is_some_and(|(frames, _)| frames >= FEW_FRAMES)
    }
}

/// Poses kept while scale has no support.
const UNSUPPORTED: usize = 600;

/// Frames whose speeds are kept: half a minute at 20 Hz.
const KEPT: usize = 600;
/// Fewer frames of walking say nothing of the pace,
const LEAST: usize = 10;
/// but a map whose unit was guessed is put right by a first few.
const FIRST_FEW: usize = 5;

/// How fast the walker goes when he walks, in the map's unit a second.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pace {
    speeds: VecDeque<f64>,
}

impl Pace {
    /// The speed of one more frame.
    pub fn push(&mut self, speed: f64) {
        if self.speeds.len() == KEPT {
            self.speeds.pop_front();
        }
        self.speeds.push_back(speed);
    }

    /// Lengths are so many times what they were.
    pub fn rescale(&mut self, factor: f64) {
        self.speeds.iter_mut().for_each(|s| *s *= factor);
    }

    /// The median speed of the frames in which he walked, and how many these are. Standing and turning on the spot do not
    /// count: only speeds above half of the fast ones (the ninth decile) do. None below `least` frames.
    fn walking(&self, least: usize) -> Option<(f64, usize)> {
        let mut sorted: Vec<f64> = self.speeds.iter().copied().filter(|s| s.is_finite()).collect();
        if sorted.len() < least {
            return None;
        }
        sorted.sort_unstable_by(f64::total_cmp);
        let fast = sorted[sorted.len() * 9 / 10];
        let walked = &sorted[sorted.partition_point(|s| *s <= 0.5 * fast)..];
        let median = walked.get(walked.len() / 2).copied()?;
        (walked.len() >= least && median > 0.0).then_some((median, walked.len()))
    }
}

/// Seconds of walking in a map after which its unit of length is set by the pace, and set again: soon, so that no place is
/// told far from where he can have walked, and later, when he walks as he does.
const COMPARED_S: [f64; 5] = [0.25, 0.5, 1.0, 3.0, 10.0];
/// Standard deviation of the logarithm of scale before the first comparison, and after each: an assumption of how well a
/// walker keeps his pace from one stretch to the next. While he sets off after a stop he is slower.
pub(crate) const PACE_SIGMA: [f64; 6] = [2.0, 0.7, 0.5, 0.3, 0.2, 0.15];

/// The least share of the time between two frames with parallax in which he must have walked.
const LEAST_WALKED: f64 = 0.05;

/// A map whose unit of length was guessed from the walker's pace in the map before, to be compared as he walks on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PaceComparison {
    /// The map, named when it had just begun.
    pub map: MapId,
    /// The pace that he had before, in the unit that the map took over.
    pub pace: f64,
    /// Comparisons done.
    pub done: usize,
}

impl PaceComparison {
    /// By how much lengths in the map have to change, and the standard deviation of the logarithm of scale after that; once
    /// enough was walked.
    pub fn due(&mut self, pace: &Pace, rate_hz: f64) -> Option<(f64, f64)> {
        let (now, frames) = pace.walking(FIRST_FEW)?;
        if (frames as f64) < COMPARED_S.get(self.done)? * rate_hz {
            return None;
        }
        self.done += 1;
        Some((self.pace / now, PACE_SIGMA[self.done]))
    }

    /// Whether too little was walked in the map for a pace of its own: the one it took over holds.
    fn is_early(&self) -> bool {
        self.done < 3
    }
}

/// Place of a walker who turns on the spot: standard deviation in metres, and metres more for each second.
const ON_THE_SPOT_M: [f64; 2] = [0.3, 0.2];
/// Standard deviation of a direction carried on by rotation alone, radians.
const TURNED_RAD: f64 = 0.1;

impl Tracker {
    /// Typical walking speed, in the map's unit per second.
    pub(crate) fn typical_speed(&self) -> Option<f64> {
        match &self.pace_comparison {
            Some(comparison) if comparison.is_early() => Some(comparison.pace),
            _ => self.pace.walking(LEAST).map(|(speed, _)| speed),
        }
    }

    /// The mean speed between the two frames with which a map begins, when he walks at his usual pace except while the
    /// camera was seen to turn on the spot.
    pub(crate) fn assumed_speed(&self, first: Stamp, second: Stamp) -> Option<f64> {
        let walked_s = second - self.turned_until.map_or(first, |turned| turned.clamp(first, second));
        self.typical_speed().map(|pace| pace * (walked_s / (second - first)).max(LEAST_WALKED))
    }

    /// A map has just been created: nothing is known of the pace in it, and where its unit of length was guessed from the
    /// pace before, that pace is kept for comparison.
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

    /// Whether lengths in the map mean something: the landmarks in view have parallax, and a unit that was guessed when
    /// the map began was compared with the pace.
    pub(crate) fn is_scale_supported(&self) -> bool {
        !self.scale_support.is_lost() && self.pace_comparison.as_ref().is_none_or(|c| c.done > 0)
    }

    /// Looks what scale rests on at a frame whose pose is known.
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

    /// Keeps a pose without support of scale.
    pub(crate) fn keep_unsupported(&mut self, stamp: Stamp, anchored: AnchoredPose) {
        if self.unsupported.len() == UNSUPPORTED {
            self.unsupported.pop_front();
        }
        self.unsupported.push_back((stamp, anchored));
    }

    /// Standard deviation of the position of a walker who has turned on the spot for so long, in the map's unit.
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
        })
    }

    /// A new map with a unit of length of its own, once two views since scale lost its support have parallax: the way on
    /// is not measured by the assumed depths that carried orientation through the turn.
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

    /// Once enough was walked in a map whose unit was guessed: by how much its lengths have to change.
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

/// The map that a key frame is in, or what became of it.
fn map_of(snapshot: &Snapshot, id: KeyFrameId) -> Option<MapId> {
    snapshot.surviving_ancestor(id).and_then(|(id, _)| Some(snapshot.key_frame(id)?.map))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Change, ChangeSet};
    use cairn_geometry::{So3, Vec3};

    /// Key frames at these places, all of which see 30 points 4 m ahead.
    fn seen_from(places: &[f64]) -> (Snapshot, Vec<Option<LandmarkId>>) {
        let count = 30;
        let mut changes = Vec::new();
        let id = |n: usize| KeyFrameId::from_index(n).unwrap();
        let landmark = |n: usize| LandmarkId::from_index(n).unwrap();
        let mut frame = Frame::default();
        frame.px = vec![[0.0; 2]; count];
        frame.descriptors = vec![[0; 32]; count];
        frame.octave = vec![0; count];
        frame.angle = vec![0.0; count];
        frame.depth = vec![f32::NAN; count];
        frame.right_x = vec![f32::NAN; count];
        for (n, x) in places.iter().enumerate() {
            let at = Se3::new(So3::identity(), Vec3::new(*x, 0.0, 0.0));
            let parent = (n > 0).then(|| id(n - 1));
            changes.push(Change::AddKeyFrame(Box::new(KeyFrame::new(
                id(n),
                Arc::new(frame.clone()),
                at,
                parent,
            ))));
        }
        for l in 0..count {
            changes.push(Change::AddLandmark(landmark(l), Vec3::new(0.1 * l as f64, 0.0, 4.0)));
            changes.extend((0..places.len()).map(|n| Change::Observe(landmark(l), id(n), l as u16)));
        }
        let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
        (snapshot, (0..count).map(|l| Some(landmark(l))).collect())
    }

    #[test]
    fn scale_is_supported_by_parallax_alone() {
        let mut support = ScaleSupport::default();
        let (snapshot, landmarks) = seen_from(&[0.0, 0.3]);
        (0..5).for_each(|_| support.update(&snapshot, &landmarks));
        assert!(!support.is_lost());
        // Turned on the spot: the camera moves by a centimetre at 4 m.
        let (snapshot, landmarks) = seen_from(&[0.0, 0.01, 0.0]);
        support.update(&snapshot, &landmarks);
        assert!(!support.is_lost(), "one frame is no reason");
        (0..3).for_each(|_| support.update(&snapshot, &landmarks));
        assert!(support.is_lost());
    }

    #[test]
    fn key_frames_placed_by_assumed_depth_do_not_support_scale() {
        let mut support = ScaleSupport::default();
        let (turned, landmarks) = seen_from(&[0.0, 0.01]);
        (0..3).for_each(|_| support.update(&turned, &landmarks));
        // He walks on, and a third key frame sees the same points with parallax.
        let (walked, landmarks) = seen_from(&[0.0, 0.01, 0.5]);
        support.update(&walked, &landmarks);
        assert!(support.is_lost());
        // Landmarks with parallax from before come into view again.
        let (back, landmarks) = seen_from(&[0.0, 0.5]);
        support.update(&back, &landmarks);
        assert!(!support.is_lost());
    }

    #[test]
    fn pace_leaves_out_standing_turning_and_jumps() {
        let mut pace = Pace::default();
        (0..200).for_each(|k| pace.push(0.9 + 0.2 * f64::from(k % 3)));
        (0..150).for_each(|_| pace.push(0.05));
        // The pose jumps once, when the map is corrected.
        pace.push(20.0);
        let (speed, frames) = pace.walking(LEAST).unwrap();
        assert!((speed - 1.1).abs() < 0.02 && frames == 201, "{speed} {frames}");
        pace.rescale(2.0);
        assert!((pace.walking(LEAST).unwrap().0 - 2.2).abs() < 0.04);
    }

    #[test]
    fn a_map_is_rescaled_soon_and_again_by_the_pace() {
        let map = MapId(KeyFrameId::FIRST);
        let mut comparison = PaceComparison { map, pace: 1.2, done: 0 };
        let mut pace = Pace::default();
        let mut found = Vec::new();
        for _ in 0..400 {
            pace.push(0.4);
            if let Some((factor, sigma)) = comparison.due(&pace, 20.0) {
                pace.rescale(factor);
                found.push((factor, sigma));
            }
            // In the new unit he goes on as he did.
            let factor: f64 = found.iter().map(|(f, _)| f).product();
            let last = pace.speeds.back_mut().unwrap();
            *last = 0.4 * factor;
        }
        assert_eq!(found.len(), COMPARED_S.len(), "{found:?}");
        assert!((found[0].0 - 3.0).abs() < 1e-9, "{found:?}");
        assert!(found[1..].iter().all(|(factor, _)| (factor - 1.0).abs() < 1e-9), "{found:?}");
        assert!(found.windows(2).all(|w| w[0].1 > w[1].1), "{found:?}");
    }
}
