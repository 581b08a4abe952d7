//! Scale of a monocular camera from frame to frame: whether it is still supported by landmarks with parallax, and the
//! walker's speed.
//!
//! While the camera turns on the spot there is no parallax. New landmarks then have an assumed depth, and a map that
//! continues from them alone takes its unit of length from that assumption. So scale counts as supported only while
//! enough of the tracked landmarks have parallax between earlier key frames.

use cairn_adjust::has_parallax;
use cairn_atlas::{KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::Vec3;
use std::collections::VecDeque;

/// Scale is unsupported when fewer tracked landmarks than this have parallax,
const FEW: usize = 12;
/// and they are also fewer than this share of all,
const FEW_SHARE: f64 = 0.25;
/// for this many consecutive frames.
const FEW_FRAMES: usize = 3;
/// From this many on it is supported, and again.
const ENOUGH: usize = 25;

/// Tracks whether scale is supported. Only for maps whose unit of length is given neither by depth nor by an IMU.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ScaleSupport {
    /// The id of the next key frame when fewer than enough landmarks had parallax, until enough have it again.
    low_parallax_since: Option<KeyFrameId>,
    /// Number of consecutive frames with too few.
    few: usize,
}

impl ScaleSupport {
    /// Takes the landmarks that agree with the pose of a frame. Once they are not enough, only parallax between earlier
    /// key frames counts, since the positions of later ones depend on assumed depths, or on the few there were.
    pub fn update(&mut self, snapshot: &Snapshot, landmarks: &[Option<LandmarkId>]) {
        let next = snapshot.next_key_frame_id();
        let before = self.low_parallax_since.unwrap_or(next);
        let tracked = landmarks.iter().flatten().filter_map(|id| snapshot.landmark(*id));
        let (mut all, mut supporting) = (0, 0);
        for landmark in tracked {
            all += 1;
            supporting += usize::from(has_parallax(snapshot, landmark, Some(before)));
            if supporting >= ENOUGH {
                *self = Self::default();
                return;
            }
        }
        self.low_parallax_since = Some(before);
        let few = supporting < FEW && (supporting as f64) < FEW_SHARE * all as f64;
        self.few = if few || self.is_lost() { self.few + 1 } else { 0 };
    }

    /// Once scale is no longer supported: the first key frame that rests on assumed depths.
    pub fn assumed_since(&self) -> Option<KeyFrameId> {
        self.low_parallax_since.filter(|_| self.is_lost())
    }

    /// Whether scale is no longer supported.
    pub fn is_lost(&self) -> bool {
        self.few >= FEW_FRAMES
    }
}

/// Number of frames whose speeds are stored: half a minute at 20 Hz.
const KEPT: usize = 600;
/// Number of frames over which a walker must get on: the pose of somebody who stands trembles to and fro, and goes nowhere.
const OVER: usize = 5;
/// The walking speed is not estimated from fewer frames than this,
pub(crate) const LEAST: usize = 10;
/// but a map whose unit was guessed is corrected after these first few.
const FIRST_FEW: usize = 5;

/// The walker's usual speed while walking, in the map's unit per second.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pace {
    speeds: VecDeque<f64>,
    /// The speeds at which the walker got on over the last few frames, as many.
    net_speeds: VecDeque<f64>,
    /// The last motions from frame to frame, and the seconds that each took.
    moved: VecDeque<(Vec3, f64)>,
}

impl Pace {
    /// Adds a frame: how far the camera has moved since the one before it, in the map's unit and axes, and in which time.
    pub fn moved(&mut self, moved: Vec3, elapsed_s: f64) {
        if self.moved.len() == OVER {
            self.moved.pop_front();
        }
        self.moved.push_back((moved, elapsed_s));
        let far: Vec3 = self.moved.iter().map(|(moved, _)| moved).sum();
        let in_s: f64 = self.moved.iter().map(|(_, elapsed_s)| elapsed_s).sum();
        self.add(moved.norm() / elapsed_s, far.norm() / in_s);
    }

    /// The next frame does not follow the last one: what was between them is not known.
    pub fn interrupt(&mut self) {
        self.moved.clear();
    }

    fn add(&mut self, speed: f64, net_speed: f64) {
        if self.speeds.len() == KEPT {
            self.speeds.pop_front();
            self.net_speeds.pop_front();
        }
        self.speeds.push_back(speed);
        self.net_speeds.push_back(net_speed);
    }

    /// Adds the speed of a frame in which the walker gets on at that speed.
    #[cfg(test)]
    pub fn push(&mut self, speed: f64) {
        self.add(speed, speed);
    }

    /// Converts to a new unit: all lengths were multiplied by this factor.
    pub fn rescale(&mut self, factor: f64) {
        self.speeds.iter_mut().chain(&mut self.net_speeds).for_each(|s| *s *= factor);
        self.moved.iter_mut().for_each(|(moved, _)| *moved *= factor);
    }

    /// The median speed over the frames in which the walker was walking, and the number of these frames. Standing and
    /// turning on the spot do not count: only speeds above half of the ninth decile do, or of the `least`-th greatest
    /// where that is more, so that a few steps and a long stop after them do not make the stop the walk. `None` for
    /// fewer than `least` frames.
    pub fn walking(&self, least: usize) -> Option<(f64, usize)> {
        usual(&self.speeds, least)
    }

    /// The same of the speeds at which the walker got on.
    pub fn getting_on(&self, least: usize) -> Option<(f64, usize)> {
        usual(&self.net_speeds, least)
    }
}

fn usual(speeds: &VecDeque<f64>, least: usize) -> Option<(f64, usize)> {
    let mut sorted: Vec<f64> = speeds.iter().copied().filter(|s| s.is_finite()).collect();
    if sorted.len() < least {
        return None;
    }
    sorted.sort_unstable_by(f64::total_cmp);
    let fast = sorted[(sorted.len() * 9 / 10).max(sorted.len() - least)];
    let walked = &sorted[sorted.partition_point(|s| *s <= 0.5 * fast)..];
    let median = walked.get(walked.len() / 2).copied()?;
    (walked.len() >= least && median > 0.0).then_some((median, walked.len()))
}

/// Seconds of walking in a map after which its unit of length is set from the walking speed, and set again: first
/// soon, so that no place is reported farther away than the walker can have gone, and again later, when the walker
/// has reached the usual speed.
const COMPARED_S: [f64; 5] = [0.25, 0.5, 1.0, 3.0, 10.0];
/// Standard deviation of the logarithm of scale before the first comparison, and after each: an assumption of how
/// well a walker keeps the same speed from one stretch to the next. A walker who sets off after a stop is slower.
pub(crate) const PACE_SIGMA: [f64; 6] = [2.0, 0.7, 0.5, 0.3, 0.2, 0.15];

/// Logarithm of the ratio of the pace to a speed that is standing still in any case: a twentieth of the pace.
const STANDING_LOG: f64 = 3.0;

/// A map whose unit of length was guessed from the walking speed in the previous map, to be compared as the walk goes
/// on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PaceComparison {
    /// The map's id when it had just begun.
    pub map: MapId,
    /// The walking speed in the previous map, in the unit that this map took over.
    pub pace: f64,
    /// Number of comparisons done.
    pub done: usize,
}

impl PaceComparison {
    /// The factor by which lengths in the map have to change, and the standard deviation of the logarithm of scale
    /// after that; `None` until the walk was long enough. One that gets on far more slowly than believed is no walk: there the
    /// poses of somebody who stands still tremble.
    pub fn due(&mut self, pace: &Pace, rate_hz: f64) -> Option<(f64, f64)> {
        let (now, frames) = pace.walking(FIRST_FEW)?;
        if (frames as f64) < COMPARED_S.get(self.done)? * rate_hz {
            return None;
        }
        let (net, _) = pace.getting_on(FIRST_FEW)?;
        if (self.pace / net.min(now)).ln() > (3.0 * PACE_SIGMA[self.done]).min(STANDING_LOG) {
            return None;
        }
        let factor = self.pace / now;
        self.done += 1;
        Some((factor, PACE_SIGMA[self.done]))
    }

    /// Whether the walk in the map was too short for a speed of its own: the speed taken over is used instead.
    pub fn is_early(&self) -> bool {
        self.done < 3
    }
}

#[cfg(test)]
impl ScaleSupport {
    /// Unsupported since the key frame with this id was the next one.
    pub fn lost_since(id: KeyFrameId) -> Self {
        Self { low_parallax_since: Some(id), few: FEW_FRAMES }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_atlas::{Change, ChangeSet, KeyFrame};
    use cairn_geometry::{Se3, So3, Vec3};
    use cairn_vision::Frame;
    use std::sync::Arc;

    /// Key frames at these positions, all of which observe 30 points 4 m ahead.
    fn seen_from(places: &[f64]) -> (Snapshot, Vec<Option<LandmarkId>>) {
        points_seen_from(places, &[(30, 0)])
    }

    /// Key frames at these positions, and so many points 4 m ahead that they observe from the one with this number on.
    fn points_seen_from(places: &[f64], points: &[(usize, usize)]) -> (Snapshot, Vec<Option<LandmarkId>>) {
        let count = points.iter().map(|(count, _)| count).sum();
        let first: Vec<usize> = points.iter().flat_map(|(count, first)| vec![*first; *count]).collect();
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
            changes.extend((first[l]..places.len()).map(|n| Change::Observe(landmark(l), id(n), l as u16)));
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
        // A turn on the spot: the camera moves by a centimetre at a depth of 4 m.
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
        // The walker goes on, and a third key frame observes the same points with parallax.
        let (walked, landmarks) = seen_from(&[0.0, 0.01, 0.5]);
        support.update(&walked, &landmarks);
        assert!(support.is_lost());
        // Landmarks with parallax from before come into view again.
        let (back, landmarks) = seen_from(&[0.0, 0.5]);
        support.update(&back, &landmarks);
        assert!(!support.is_lost());
    }

    #[test]
    fn few_landmarks_hand_on_no_scale_to_those_that_come_after_them() {
        let mut support = ScaleSupport::default();
        // A turn past a bare wall: 14 points are left, with parallax from before.
        let (thin, landmarks) = points_seen_from(&[0.0, 0.3], &[(14, 0)]);
        (0..3).for_each(|_| support.update(&thin, &landmarks));
        assert!(!support.is_lost(), "14 of 14 support it");
        // Behind it a room with many points, with parallax between the key frames that the 14 have placed.
        let (rich, landmarks) = points_seen_from(&[0.0, 0.3, 0.6, 0.9], &[(8, 0), (100, 2)]);
        (0..3).for_each(|_| support.update(&rich, &landmarks));
        assert!(support.is_lost());
        // The same points where enough were in view all the time.
        let mut support = ScaleSupport::default();
        let (enough, landmarks) = points_seen_from(&[0.0, 0.3], &[(30, 0)]);
        (0..3).for_each(|_| support.update(&enough, &landmarks));
        let (rich, landmarks) = points_seen_from(&[0.0, 0.3, 0.6, 0.9], &[(8, 0), (100, 2)]);
        (0..3).for_each(|_| support.update(&rich, &landmarks));
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
    fn a_few_steps_and_a_long_stop_are_no_slow_walk() {
        let map = MapId(KeyFrameId::FIRST);
        let tremble = |k: i32| 1e-3 * f64::from(1 + k % 7);
        for (steps, compared) in [(24, 3), (0, 0)] {
            let mut comparison = PaceComparison { map, pace: 1.0, done: 0 };
            let mut pace = Pace::default();
            let mut found = Vec::new();
            for k in 0..steps + 500 {
                pace.push(if k < steps { 0.8 } else { tremble(k) });
                found.extend(comparison.due(&pace, 20.0));
            }
            // After 0.25, 0.5 and 1 s of walking where there were 1.2 s of it, and never because of the stop.
            assert_eq!(found.len(), compared, "{found:?}");
            assert!(found.iter().all(|(factor, _)| (factor - 1.25).abs() < 1e-9), "{found:?}");
        }
    }

    #[test]
    fn who_trembles_on_the_spot_does_not_get_on() {
        let paces = |walks: bool| {
            let mut pace = Pace::default();
            // A centimetre from frame to frame, on and on or to and fro.
            let step = |k: i32| Vec3::x() * if walks || k % 2 == 0 { 0.01 } else { -0.01 };
            (0..40).for_each(|k| pace.moved(step(k), 0.05));
            pace.rescale(2.0);
            (0..40).for_each(|k| pace.moved(2.0 * step(k), 0.05));
            pace
        };
        for walks in [true, false] {
            let speed = paces(walks).walking(LEAST).unwrap().0;
            assert!((speed - 0.4).abs() < 1e-9, "{speed}");
            let net = paces(walks).getting_on(LEAST).unwrap().0;
            assert!(if walks { (net - 0.4).abs() < 1e-9 } else { net < 0.09 }, "{net}");
            // The unit of a map that was begun with a pace ten times as fast is put right by a walk alone.
            let map = MapId(KeyFrameId::FIRST);
            let mut comparison = PaceComparison { map, pace: 4.0, done: 0 };
            assert_eq!(comparison.due(&paces(walks), 20.0).is_some(), walks);
        }
        // Over a gap nothing is known.
        let mut pace = Pace::default();
        (0..4).for_each(|_| pace.moved(Vec3::x() * 0.05, 0.05));
        pace.interrupt();
        pace.moved(Vec3::y() * 0.02, 0.05);
        assert!((pace.net_speeds[4] - 0.4).abs() < 1e-12 && (pace.net_speeds[3] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn is_early_for_the_first_second_of_walking() {
        let mut comparison = PaceComparison { map: MapId(KeyFrameId::FIRST), pace: 1.0, done: 0 };
        let mut pace = Pace::default();
        for k in 1..=60 {
            pace.push(0.8);
            comparison.due(&pace, 20.0);
            assert_eq!(comparison.is_early(), k < 20, "after {k} frames of a twentieth of a second");
        }
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
            // In the new unit the walker continues at the same speed.
            let factor: f64 = found.iter().map(|(f, _)| f).product();
            for last in [&mut pace.speeds, &mut pace.net_speeds] {
                *last.back_mut().unwrap() = 0.4 * factor;
            }
        }
        assert_eq!(found.len(), COMPARED_S.len(), "{found:?}");
        assert!((found[0].0 - 3.0).abs() < 1e-9, "{found:?}");
        assert!(found[1..].iter().all(|(factor, _)| (factor - 1.0).abs() < 1e-9), "{found:?}");
        assert!(found.windows(2).all(|w| w[0].1 > w[1].1), "{found:?}");
    }
}
