//! The frames of REP 105: from a tracked pose to `odom -> base_link` and `map -> odom`.
//!
//! In: the camera's pose in the odometry frame of tracking, which no correction of the map moves, and its pose in the
//! map. Out: `odom_from_base`, the sum of the motions from frame to frame, which never jumps; and `map_from_odom`, which
//! takes what the map corrects. Both frames have x ahead and z up (REP 103), as far as that is known: the odometry frame
//! begins at the robot with the robot's axes, made level by the accelerometer where there is one; a map aligned with
//! gravity is level.
//!
//! A transform of tf has no scale. Where the map's unit of length has changed since the odometry began, motions are
//! scaled to the map's unit, from then on.
//!
//! Covariances. Two things are wrong with a pose. The matches are noisy, anew in each image: tracking states that. And it
//! takes the landmarks as exact: what they, the lens and the rig are off by is the same in the images that share landmarks,
//! so that errors of successive motions have the same sign and add up before they cancel. That part grows with translation
//! and rotation (the odometry motion model of Thrun, Burgard & Fox, "Probabilistic Robotics", 5.4), correlated over
//! `CORRELATED_S` as a Gauss-Markov process; `OF_TRANSLATION` and `OF_ROTATION` are those of recordings with truth. A
//! motion has both parts, of the noise that of its two ends; the odometry has the sum of the second, and the noise of its
//! last pose alone, for what the poses between are off by cancels. To the pose in the map is added what a map is usually off
//! by. What is not known at all is [`UNKNOWN`].

use crate::planar::{planar, planar_covariance};
use cairn::Stamp;
use cairn::geometry::{Se3, So3, Vec3};
use nalgebra::{Matrix6, Vector6};

/// What a map is off by near where it was seen, standard deviations in metres and radians: recordings with truth are tracked to
/// 4 to 16 mm.
const MAP_SIGMAS: [f64; 2] = [0.01, 0.005];

/// What a motion is off by beside the noise of the matches, standard deviations along an axis: metres and radians for a metre.
const OF_TRANSLATION: [f64; 2] = [0.005, 0.0003];

/// The same for a radian.
const OF_ROTATION: [f64; 2] = [0.025, 0.0065];

/// How long that keeps its sign, the time constant.
const CORRELATED_S: f64 = 0.5;

/// Variance of what is not known, m^2 and rad^2.
pub const UNKNOWN: f64 = 1e6;

/// A pose as tracking gives it.
#[derive(Clone, Copy, Debug)]
pub struct Tracked {
    /// When.
    pub stamp: Stamp,
    /// Number of the stretch of odometry: the motion between two of them is not known.
    pub segment: u32,
    /// The camera in the odometry frame of tracking.
    pub odom_from_camera: Se3,
    /// The camera in the map.
    pub world_from_camera: Se3,
    /// Units of length of the map in one of the odometry.
    pub scale: f64,
    /// Lengths of the map are metres, so that lever arms can be added.
    pub metric: bool,
    /// The map's z axis is up.
    pub gravity_aligned: bool,
    /// Covariance of `world_from_camera`, of its right perturbation: translation, rotation.
    pub covariance: Matrix6<f64>,
}

/// The two transforms to publish.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transforms {
    /// Maps the odometry frame to the map; `None` where the place in the map is not known.
    pub map_from_odom: Option<Se3>,
    /// Maps the robot to the odometry frame.
    pub odom_from_base: Se3,
    /// The motion of the robot since the pose before, in its own frame; `None` where it is not known, and taken to be none.
    pub motion: Option<Se3>,
    /// Covariance of `odom_from_base` about the axes of the odometry frame: translation, rotation.
    pub odom_covariance: Matrix6<f64>,
    /// Covariance of the robot in the map about the axes of the map.
    pub map_covariance: Matrix6<f64>,
    /// Covariance of the motion about the axes of the robot.
    pub motion_covariance: Matrix6<f64>,
}

impl Transforms {
    /// The robot in the map; `None` where the place in the map is not known.
    pub fn map_from_base(&self) -> Option<Se3> {
        Some(self.map_from_odom? * self.odom_from_base)
    }
}

/// The pose before.
#[derive(Clone, Copy, Debug)]
struct Last {
    stamp: Stamp,
    segment: u32,
    odom_from_camera: Se3,
    /// Of the robot.
    covariance: Matrix6<f64>,
}

/// What the motions so far are off by together beside the noise of the matches.
#[derive(Clone, Debug, Default)]
struct Drift {
    /// Covariance of `odom_from_base`, of its right perturbation.
    sum: Matrix6<f64>,
    /// Its covariance with what the last motion was off by, for a motion of standard deviation 1.
    with_last: Matrix6<f64>,
}

impl Drift {
    /// Adds a motion that took `dt_s`; the covariance of what it is off by.
    fn add(&mut self, motion: &Se3, dt_s: f64) -> Matrix6<f64> {
        let (metres, rad) = (motion.translation.norm(), motion.rotation.log().norm());
        let sigmas = Vector6::from_fn(|i, _| OF_TRANSLATION[i / 3] * metres + OF_ROTATION[i / 3] * rad);
        let sigma = Matrix6::from_diagonal(&sigmas);
        let back = motion.inverse().adjoint();
        let kept = back * self.with_last * (-dt_s.max(0.0) / CORRELATED_S).exp();
        let both = kept * sigma;
        self.sum = back * self.sum * back.transpose() + both + both.transpose() + sigma * sigma;
        self.with_last = kept + sigma;
        sigma * sigma
    }
}

/// Turns tracked poses into transforms.
#[derive(Clone, Debug)]
pub struct FrameTree {
    base_from_camera: Se3,
    odom_from_base: Se3,
    drift: Drift,
    last: Option<Last>,
    /// From the map of tracking to the published one, and whether it was made for a map aligned with gravity.
    map_from_world: Option<(Se3, bool)>,
    /// The last pose of the robot in the published map.
    map_from_base: Se3,
    /// Whether the robot has had a place in the published map.
    is_placed: bool,
    /// Whether the robot moves on a plane.
    is_planar: bool,
    restarts: usize,
}

impl FrameTree {
    /// For a camera (optical frame: z ahead, x right) at this place of the robot. `up` is the upward direction in the
    /// robot's frame as the accelerometer saw it at the start, not normalised; `None` where the robot stands level.
    pub fn new(base_from_camera: Se3, up: Option<Vec3>) -> Self {
        let level = up.and_then(|up| level_from_base(&up)).unwrap_or_else(So3::identity);
        let start = Se3::new(level, Vec3::zeros());
        Self {
            base_from_camera,
            odom_from_base: start,
            drift: Drift::default(),
            last: None,
            map_from_world: None,
            map_from_base: start,
            is_placed: false,
            is_planar: false,
            restarts: 0,
        }
    }

    /// The robot moves on a plane, that of its start: what is published has no height, roll and pitch.
    pub fn on_a_plane(self) -> Self {
        Self { odom_from_base: planar(&self.odom_from_base), is_planar: true, ..self }
    }

    /// The published map is a saved one, which lies so in it; the robot has no place in it yet.
    pub fn in_saved_map(&mut self, map_from_world: Se3, gravity_aligned: bool) {
        (self.map_from_world, self.is_placed) = (Some((map_from_world, gravity_aligned)), false);
    }

    /// How often the odometry began anew after motion that was not observed.
    pub fn restarts(&self) -> usize {
        self.restarts
    }

    /// The motion up to the next pose is not known: the odometry goes on where it is.
    pub fn break_off(&mut self) {
        self.restarts += usize::from(self.last.take().is_some());
    }

    /// Tracking begins anew, in another map: the odometry goes on where it is.
    pub fn begin_anew(&mut self) {
        self.break_off();
        (self.map_from_world, self.is_placed) = (None, false);
    }

    /// The transforms at a pose in the published map.
    pub fn step(&mut self, tracked: &Tracked) -> Transforms {
        let transforms = self.step_elsewhere(tracked);
        let base_from_camera = self.base_from_camera(tracked.metric);
        let world_from_base = tracked.world_from_camera * base_from_camera.inverse();
        let (map_from_world, aligned) = match self.map_from_world {
            Some((map, aligned)) if aligned || !tracked.gravity_aligned => (map, aligned),
            Some(_) | None if tracked.gravity_aligned => {
                (self.level_map(&world_from_base, &transforms.motion), true)
            }
            _ => (self.odom_from_base * world_from_base.inverse(), false),
        };
        self.map_from_world = Some((map_from_world, aligned));
        (self.map_from_base, self.is_placed) = (map_from_world * world_from_base, true);
        let covariance = seen_from(&base_from_camera, &tracked.covariance);
        let map_covariance = about_parent(&self.map_from_base, &covariance) + of_map();
        let (map_from_base, map_covariance) = match self.is_planar {
            true => (planar(&self.map_from_base), planar_covariance(&map_covariance)),
            false => (self.map_from_base, map_covariance),
        };
        Transforms {
            map_from_odom: Some(map_from_base * self.odom_from_base.inverse()),
            map_covariance,
            ..transforms
        }
    }

    /// The transforms at a pose whose place in the published map is not known: the odometry alone.
    pub fn step_elsewhere(&mut self, tracked: &Tracked) -> Transforms {
        let base_from_camera = self.base_from_camera(tracked.metric);
        let motion = match self.last {
            Some(before) if before.segment == tracked.segment => {
                let mut motion = before.odom_from_camera.inverse() * tracked.odom_from_camera;
                if tracked.metric {
                    motion.translation *= tracked.scale;
                }
                Some(base_from_camera * motion * base_from_camera.inverse())
            }
            Some(_) => {
                self.restarts += 1;
                None
            }
            None => None,
        };
        // Each motion by itself: what tilt adds up is left out.
        let motion = if self.is_planar { motion.as_ref().map(planar) } else { motion };
        let covariance = seen_from(&base_from_camera, &tracked.covariance);
        let begins = self.last.is_none() && self.restarts == 0;
        let motion_covariance = self.moved(motion.as_ref(), tracked.stamp, &covariance);
        // Where the odometry begins is exact.
        let of_pose = if begins { Matrix6::zeros() } else { covariance };
        self.last = Some(Last {
            stamp: tracked.stamp,
            segment: tracked.segment,
            odom_from_camera: tracked.odom_from_camera,
            covariance,
        });
        self.odom_from_base = self.odom_from_base * motion.unwrap_or_else(Se3::identity);
        let odom_covariance = about_parent(&self.odom_from_base, &(self.drift.sum + of_pose));
        let flat = |c: Matrix6<f64>| if self.is_planar { planar_covariance(&c) } else { c };
        Transforms {
            map_from_odom: None,
            odom_from_base: self.odom_from_base,
            motion,
            odom_covariance: flat(odom_covariance),
            map_covariance: Matrix6::identity() * UNKNOWN,
            motion_covariance: flat(motion_covariance),
        }
    }

    /// Adds a motion to a pose of this covariance to the drift; its covariance.
    fn moved(&mut self, motion: Option<&Se3>, stamp: Stamp, now: &Matrix6<f64>) -> Matrix6<f64> {
        let unknown = Matrix6::identity() * UNKNOWN;
        match (motion, &self.last) {
            (Some(motion), Some(last)) => {
                let off = self.drift.add(motion, stamp - last.stamp);
                seen_from(&motion.inverse(), &last.covariance) + now + off
            }
            // The odometry begins here.
            (_, None) if self.restarts == 0 => unknown,
            _ => {
                self.drift = Drift { sum: self.drift.sum + unknown, ..Drift::default() };
                unknown
            }
        }
    }

    /// The published map for a map aligned with gravity: level, and the robot keeps heading and place.
    fn level_map(&self, world_from_base: &Se3, motion: &Option<Se3>) -> Se3 {
        let expected = self.map_from_base * motion.unwrap_or_else(Se3::identity);
        let heading = |pose: &Se3| {
            let ahead = pose.rotation * Vec3::x();
            ahead.y.atan2(ahead.x)
        };
        let rotation = So3::exp(&(Vec3::z() * (heading(&expected) - heading(world_from_base))));
        Se3::new(rotation, expected.translation - rotation * world_from_base.translation)
    }

    /// The robot in the published map at the last pose; `None` before the first.
    pub fn map_from_base(&self) -> Option<Se3> {
        self.is_placed.then_some(self.map_from_base)
    }

    /// The last pose in the odometry frame.
    pub fn odom_from_base(&self) -> Se3 {
        self.odom_from_base
    }

    /// A pose of the robot in the published map as it is published.
    pub fn published(&self, map_from_base: Se3) -> Se3 {
        if self.is_planar { planar(&map_from_base) } else { map_from_base }
    }

    /// From the map of tracking to the published one; `None` before the first pose in a map that is not a saved one.
    pub fn map_from_world(&self) -> Option<Se3> {
        self.map_from_world.map(|(map, _)| map)
    }

    /// The camera on the robot; only its direction where lengths are not metres.
    pub fn base_from_camera(&self, metric: bool) -> Se3 {
        let arm = if metric { self.base_from_camera.translation } else { Vec3::zeros() };
        Se3::new(self.base_from_camera.rotation, arm)
    }
}

/// The covariance of `x_from_a` seen from another frame of the same body: that of `x_from_b`, for `b_from_a`. Both of right
/// perturbations.
fn seen_from(b_from_a: &Se3, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let adjoint = b_from_a.adjoint();
    adjoint * covariance * adjoint.transpose()
}

/// Covariance of what a map is off by.
fn of_map() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::from_fn(|i, _| MAP_SIGMAS[i / 3].powi(2)))
}

/// From the axes of a frame to those of its parent, about which messages state covariances.
fn about_parent(parent_from_frame: &Se3, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    seen_from(&Se3::new(parent_from_frame.rotation, Vec3::zeros()), covariance)
}

/// The optical frame of a camera (z ahead, x right, y down) that looks ahead, at the robot's origin (x ahead, y left, z up).
pub fn looking_ahead() -> Se3 {
    let rotation = cairn::geometry::Mat3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    Se3::new(So3::from_matrix(&rotation), Vec3::zeros())
}

/// The smallest rotation that takes `up` to z; `None` for a vector that is no gravity.
fn level_from_base(up: &Vec3) -> Option<So3> {
    let length = up.norm();
    if !(5.0..15.0).contains(&length) {
        return None;
    }
    let up = up / length;
    let axis = up.cross(&Vec3::z());
    let angle = axis.norm().atan2(up.z);
    let axis = axis.try_normalize(1e-9)?;
    Some(So3::exp(&(axis * angle)))
}

#[cfg(test)]
mod tests;
