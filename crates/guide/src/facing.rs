//! How the camera is mounted relative to the walker, and the body frame that follows from it.

use crate::ground::{Ground, direction, wrap};
use cairn_geometry::{Camera, Odom, Pose, Vec2};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// One of the three ways to walk a route back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Facing {
    /// The walker faces and moves where the camera looks.
    #[default]
    Home,
    /// The camera looks backwards: the walker faces and moves along minus the optical axis.
    Back,
    /// The walker faces along the optical axis and moves along minus it.
    Backwards,
}

/// The walker's position and heading seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// Position in metres on the ground plane.
    pub position: Vec2,
    /// Height of the camera in metres.
    pub height: f64,
    /// Direction of the walker's chest, in radians.
    pub heading: f64,
    /// Direction in which the walker moves when told to go on, in radians: the heading, or its opposite.
    pub course: f64,
}

impl Facing {
    /// The walker's heading from the pose of the camera; `None` when the pose has no heading or is not finite.
    pub fn heading(self, ground: &Ground, odom_from_camera: &Pose<Odom, Camera>) -> Option<Heading> {
        let pose = &odom_from_camera.se3;
        if !pose.is_finite() {
            return None;
        }
        let camera = ground.heading(pose)?;
        let (heading, course) = match self {
            Facing::Home => (camera, camera),
            Facing::Back => (wrap(camera + PI), wrap(camera + PI)),
            Facing::Backwards => (camera, wrap(camera + PI)),
        };
        let (position, height) = (ground.plane(&pose.translation), ground.height(&pose.translation));
        Some(Heading { position, height, heading, course })
    }
}

impl Heading {
    /// How far a point lies to the walker's own left, in metres (negative: right), whether he moves forwards or back.
    pub fn to_left(&self, point: &Vec2) -> f64 {
        let left = direction(self.heading + 0.5 * PI);
        (point - self.position).dot(&left)
    }

    /// The rotation in radians that brings the course to `heading`: positive to the walker's left.
    ///
    /// Chest and course turn together, so this also holds for a walker moving backwards.
    pub fn turn_to(&self, heading: f64) -> f64 {
        wrap(heading - self.course)
    }
}
