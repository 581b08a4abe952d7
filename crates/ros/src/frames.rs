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
    /// Maps the odometry frame to the map.
    pub map_from_odom: Se3,
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
            restarts: 0,
        }
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
        self.map_from_world = None;
    }

    /// The transforms at a pose.
    pub fn step(&mut self, tracked: &Tracked) -> Transforms {
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
        let world_from_base = tracked.world_from_camera * base_from_camera.inverse();
        let (map_from_world, aligned) = match self.map_from_world {
            Some((map, aligned)) if aligned || !tracked.gravity_aligned => (map, aligned),
            Some(_) | None if tracked.gravity_aligned => (self.level_map(&world_from_base, &motion), true),
            _ => (self.odom_from_base * world_from_base.inverse(), false),
        };
        self.map_from_world = Some((map_from_world, aligned));
        self.map_from_base = map_from_world * world_from_base;
        Transforms {
            map_from_odom: self.map_from_base * self.odom_from_base.inverse(),
            odom_from_base: self.odom_from_base,
            motion,
            odom_covariance: about_parent(&self.odom_from_base, &(self.drift.sum + of_pose)),
            map_covariance: about_parent(&self.map_from_base, &covariance) + of_map(),
            motion_covariance,
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
        self.map_from_world.map(|_| self.map_from_base)
    }

    /// The last pose in the odometry frame.
    pub fn odom_from_base(&self) -> Se3 {
        self.odom_from_base
    }

    /// From the map of tracking to the published one; `None` before the first pose.
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
mod tests {
    use super::*;

    fn turned(x: f64, y: f64, yaw: f64) -> Se3 {
        Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)), Vec3::new(x, y, 0.0))
    }

    /// A robot that drives a curve; its camera looks ahead from 0.3 m before its origin, 0.2 m up.
    fn robot(k: usize) -> Se3 {
        let s = k as f64 * 0.05;
        turned(s, 0.3 * s * s, 0.6 * s)
    }

    fn base_from_camera() -> Se3 {
        Se3::new(So3::identity(), Vec3::new(0.3, 0.0, 0.2)) * looking_ahead()
    }

    fn tracked(k: usize) -> Tracked {
        // The frame of tracking is that of its first camera.
        let camera = |k| robot(k) * base_from_camera();
        let pose = camera(0).inverse() * camera(k);
        Tracked {
            stamp: Stamp(k as i64 * 100_000_000),
            segment: 0,
            odom_from_camera: pose,
            world_from_camera: pose,
            scale: 1.0,
            metric: true,
            gravity_aligned: false,
            covariance: Matrix6::from_diagonal(&[1e-6, 4e-6, 9e-6, 1e-8, 1e-8, 1e-8].into()),
        }
    }

    fn near(a: &Se3, b: &Se3) -> bool {
        (a.matrix() - b.matrix()).norm() < 1e-9
    }

    #[test]
    fn the_robot_drives_in_its_own_axes() {
        let mut tree = FrameTree::new(base_from_camera(), None);
        for k in 0..20 {
            let out = tree.step(&tracked(k));
            assert!(near(&out.odom_from_base, &robot(k)), "{k}: {:?}", out.odom_from_base);
            assert!(near(&out.map_from_odom, &Se3::identity()));
        }
    }

    #[test]
    fn corrections_of_the_map_move_the_map_alone() {
        let mut tree = FrameTree::new(base_from_camera(), None);
        let correction = turned(0.4, -0.2, 0.1);
        for k in 0..20 {
            let mut t = tracked(k);
            if k >= 10 {
                // In the frame of the first camera, as tracking gives it.
                let about = base_from_camera().inverse() * correction * base_from_camera();
                t.world_from_camera = about * t.world_from_camera;
            }
            let out = tree.step(&t);
            assert!(near(&out.odom_from_base, &robot(k)));
            let expected = if k >= 10 { correction } else { Se3::identity() };
            assert!(near(&out.map_from_odom, &expected), "{k}");
        }
    }

    #[test]
    fn odometry_never_jumps_when_it_begins_anew() {
        let mut tree = FrameTree::new(base_from_camera(), None);
        let mut before: Option<Se3> = None;
        for k in 0..20 {
            let mut t = tracked(k);
            if k >= 10 {
                t.segment = 1;
                t.odom_from_camera = turned(50.0, 3.0, 2.0) * t.odom_from_camera;
            }
            let out = tree.step(&t);
            if let Some(before) = before {
                let step = (before.inverse() * out.odom_from_base).translation.norm();
                assert!(step < 0.06, "{k}: {step} m");
            }
            assert_eq!(out.motion.is_none(), k == 0 || k == 10);
            // The map still has the robot where it is.
            assert!(near(&(out.map_from_odom * out.odom_from_base), &robot(k)), "{k}");
            before = Some(out.odom_from_base);
        }
        assert_eq!(tree.restarts(), 1);
        // Nor when its clock was set back meanwhile.
        tree.break_off();
        let there = tree.step(&Tracked { segment: 1, ..tracked(3) });
        assert!(near(&there.odom_from_base, &before.unwrap()) && there.motion.is_none());
        assert!(near(&(there.map_from_odom * there.odom_from_base), &robot(3)));
        assert_eq!(tree.restarts(), 2);
    }

    #[test]
    fn a_change_of_the_unit_scales_motions_from_then_on() {
        let mut tree = FrameTree::new(looking_ahead(), None);
        let mut path = Vec::new();
        for k in 0..21 {
            let along = |metres: f64| Se3::new(So3::identity(), Vec3::new(0.0, 0.0, metres));
            // The odometry began in a unit of two metres; the map is metric from frame 10.
            let metric = k >= 10;
            let metres = 0.1 * k as f64;
            let out = tree.step(&Tracked {
                segment: 0,
                odom_from_camera: along(0.5 * metres),
                world_from_camera: along(if metric { metres } else { 0.5 * metres }),
                scale: if metric { 2.0 } else { 1.0 },
                metric,
                ..tracked(k)
            });
            path.push(out.odom_from_base.translation.x);
        }
        assert!((path[9] - 0.45).abs() < 1e-9 && (path[20] - path[9] - 1.1).abs() < 1e-9, "{path:?}");
    }

    #[test]
    fn covariances_are_those_of_the_robot_about_the_axes_of_the_messages() {
        // The camera 0.3 m before the robot's origin; it knows its pose to 1, 2, 3 mm right, down, ahead, and 1 mrad about down.
        let arm = Se3::new(So3::identity(), Vec3::new(0.3, 0.0, 0.0)) * looking_ahead();
        let of_camera = Matrix6::from_diagonal(&[1e-6, 4e-6, 9e-6, 0.0, 1e-6, 0.0].into());
        // Of the robot: ahead, left (where it is farther from what turns it), up, and about up.
        let of_robot = [9e-6, 1e-6 + 0.09e-6, 4e-6, 0.0, 0.0, 1e-6];
        let mut tree = FrameTree::new(arm, None);
        let mut out = None;
        for k in 0..5 {
            // It drives left of where it began, 0.1 m each time.
            let robot = turned(0.0, 0.1 * k as f64, std::f64::consts::FRAC_PI_2);
            let pose = arm.inverse() * turned(0.0, 0.0, -std::f64::consts::FRAC_PI_2) * robot * arm;
            let tracked = Tracked {
                odom_from_camera: pose,
                world_from_camera: turned(0.0, 0.0, std::f64::consts::FRAC_PI_2) * pose,
                covariance: of_camera,
                ..tracked(k)
            };
            let now = tree.step(&tracked);
            if k == 0 {
                assert_eq!(now.odom_covariance, Matrix6::zeros());
                assert_eq!(now.motion_covariance, Matrix6::identity() * UNKNOWN);
            }
            out = Some(now);
        }
        let out = out.unwrap();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        for (i, expected) in of_robot.into_iter().enumerate() {
            let expected = expected + MAP_SIGMAS[i / 3].powi(2);
            assert!(near(out.map_covariance[(i, i)], expected), "{i}: {}", out.map_covariance);
        }
        // A motion lies between two poses. Each turns about its camera: the first one's was 0.2 m from where the motion ended.
        // And it is off by a share of its 0.1 m, along each axis.
        let off = OF_TRANSLATION.map(|share| (0.1 * share).powi(2));
        let motion = &out.motion_covariance;
        assert!(near(motion[(0, 0)], 18e-6 + off[0]) && near(motion[(5, 5)], 2e-6 + off[1]), "{motion}");
        assert!(near(motion[(1, 1)], (2.0 + 0.04 + 0.09) * 1e-6 + off[0]), "{motion}");
        // The noise of the last pose alone; and what each of four motions straight on is off by keeps its sign for a while.
        let odom = &out.odom_covariance;
        let rho = (-0.1f64 / CORRELATED_S).exp();
        let sum = 4.0 + 2.0 * (3.0 * rho + 2.0 * rho.powi(2) + rho.powi(3));
        assert!(near(odom[(5, 5)], 1e-6 + sum * off[1]), "{odom}");
        // Up: what it pitches by goes with the way since.
        assert!(odom[(2, 2)] > 4e-6 + sum * off[0] && odom[(2, 2)] < 4e-6 + 1.1 * sum * off[0], "{odom}");
        // After motion that was not observed nobody knows where it is in the odometry, but in the map.
        let lost = tree.step(&Tracked { segment: 1, covariance: of_camera, ..tracked(0) });
        assert!(lost.odom_covariance[(0, 0)] >= UNKNOWN && lost.map_covariance[(0, 0)] < 2e-4);
    }

    #[test]
    fn a_tilted_start_is_made_level_and_alignment_keeps_the_heading() {
        // The robot's nose is 0.2 rad down at the start: up, as it sees it, leans backwards.
        let pitch = So3::exp(&Vec3::new(0.0, 0.2, 0.0));
        let up = pitch.inverse() * Vec3::new(0.0, 0.0, 9.81);
        let mut tree = FrameTree::new(looking_ahead(), Some(up));
        let mut t = tracked(0);
        (t.odom_from_camera, t.world_from_camera) = (Se3::identity(), Se3::identity());
        let out = tree.step(&t);
        assert!((out.odom_from_base.rotation.inverse() * pitch).angle() < 1e-9);
        // The map is aligned with gravity, with a heading of its own, 1 rad off.
        let level = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, 1.0)) * pitch, Vec3::new(5.0, 6.0, 7.0));
        t.world_from_camera = level * looking_ahead();
        t.gravity_aligned = true;
        let out = tree.step(&t);
        let map_from_base = out.map_from_odom * out.odom_from_base;
        assert!(near(&map_from_base, &Se3::new(pitch, Vec3::zeros())), "{map_from_base:?}");
        // Corrections after that stay in the map.
        t.world_from_camera.translation += Vec3::new(0.1, 0.0, 0.0);
        let moved = tree.step(&t).map_from_odom.translation;
        assert!((moved.norm() - 0.1).abs() < 1e-9);
        assert!(
            FrameTree::new(looking_ahead(), Some(Vec3::new(0.0, 0.0, 0.3))).odom_from_base == Se3::identity()
        );
    }
}
