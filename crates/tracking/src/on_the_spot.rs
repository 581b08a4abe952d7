//! Whether a camera that sees no landmarks turns on the spot, by its images alone.
//!
//! In a metric map the motion sensors carry the pose while a walker turns towards what the map does not show. They know
//! orientation well, but their velocity drifts, and views that differ by a rotation alone (the infinite homography; Hartley &
//! Zisserman, section 13.4) tell no depth: landmarks triangulated between them take it from that drift, and a pose that is
//! tracked by such landmarks runs away. But those views tell that the camera has not moved.

use crate::rotation::{Between, Conclusion, rotation_between};
use cairn_geometry::So3;
use cairn_sensor::Stamp;
use cairn_vision::{Frame, RectifiedCamera};
use std::collections::VecDeque;
use std::sync::Arc;

/// Seconds between the two views that are compared: a person who walks on moves a third of a metre in this time.
const APART_S: [f64; 2] = [0.3, 0.7];
/// What two views told holds for so many seconds.
const HOLDS_S: f64 = 0.5;

/// The views of the last moments.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpotWatch {
    frames: VecDeque<(Arc<Frame>, So3)>,
    /// When two views were compared last, and whether they differed by a rotation alone.
    told: Option<(Stamp, bool)>,
}

/// What is known of a camera that may turn on the spot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PureRotation {
    /// Two views have just been compared, and differ by a rotation alone.
    New,
    /// Those compared last did.
    Holds,
    /// It moves, or nothing is known.
    No,
}

impl SpotWatch {
    /// Takes a view with its orientation by the motion sensors.
    pub fn step(
        &mut self,
        camera: &RectifiedCamera,
        frame: &Arc<Frame>,
        world_from_camera: &So3,
    ) -> PureRotation {
        let age = |f: &Arc<Frame>| frame.stamp - f.stamp;
        if self.frames.back().is_some_and(|(f, _)| age(f) > APART_S[1] || age(f) <= 0.0) {
            *self = Self::default();
        }
        while self.frames.front().is_some_and(|(f, _)| age(f) > APART_S[1]) {
            self.frames.pop_front();
        }
        self.frames.push_back((frame.clone(), *world_from_camera));
        let is_due = self.told.is_none_or(|(at, _)| frame.stamp - at >= APART_S[0]);
        let before = self.frames.iter().rev().find(|(f, _)| age(f) >= APART_S[0]).filter(|_| is_due);
        if let Some((before, then)) = before {
            let guess = then.inverse() * *world_from_camera;
            let between = rotation_between(camera, before, frame, &guess, Conclusion::Stood);
            let is_rotation = matches!(between, Between::Rotation { .. });
            self.told = Some((frame.stamp, is_rotation));
            return if is_rotation { PureRotation::New } else { PureRotation::No };
        }
        match self.told {
            Some((at, true)) if frame.stamp - at <= HOLDS_S => PureRotation::Holds,
            _ => PureRotation::No,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, pose, stereo};
    use cairn_geometry::{Se3, Vec3};

    /// What is told of ten views, 0.1 s apart, of a camera that goes sideways and turns, per second.
    fn told(speed: f64, turn_rate: f64) -> Vec<PureRotation> {
        let world = World::around(stereo(), 31);
        let mut watch = SpotWatch::default();
        let mut view = |n: i32| {
            let t = 0.1 * f64::from(n);
            let turn = So3::exp(&(Vec3::y() * (turn_rate * t)));
            let at = pose(speed * t, 0.0, 0.0) * Se3::new(turn, Vec3::zeros());
            watch.step(&world.camera, &world.see(&at, t).frame, &at.rotation)
        };
        (0..10).map(&mut view).collect()
    }

    #[test]
    fn a_turn_on_the_spot_is_told_and_holds_a_walk_is_not() {
        let turning = told(0.0, 0.5);
        let new = turning.iter().filter(|s| **s == PureRotation::New).count();
        assert!((2..=3).contains(&new), "{turning:?}");
        assert!(turning[3..].iter().all(|s| *s != PureRotation::No), "{turning:?}");
        assert!(turning[..3].iter().all(|s| *s == PureRotation::No), "nothing is known yet: {turning:?}");
        for (speed, turn_rate) in [(1.0, 0.0), (0.8, 0.5)] {
            let walking = told(speed, turn_rate);
            assert!(
                walking.iter().all(|s| *s == PureRotation::No),
                "{speed} m/s, {turn_rate} rad/s: {walking:?}"
            );
        }
    }
}
