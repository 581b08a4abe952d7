//! Notes along a route: what the walker said about a place while recording it, told in passing in either direction.
//!
//! A note is anchored to a key frame like a point of the route. Its side is relative to the view of the camera at that
//! moment. In passing, the landmark's direction follows from the walker's own heading there: on the way back, left becomes
//! right; for a walker who moves backwards and still faces as on the way out, it stays left.

use crate::anchor::{Anchor, seven, stamp_ns};
use crate::direction::Side;
use crate::facing::Heading;
use crate::ground::{Ground, wrap};
use cairn_geometry::Se3;
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// A walker who is nearer to a note than this is told it, metres.
const TOLD_WITHIN_M: f64 = 3.0;
/// One that he has passed by this much is no longer told, metres.
const PASSED_M: f64 = 1.2;
/// A note on another floor is not told, metres.
const SAME_FLOOR_M: f64 = 2.0;

/// A note: a landmark, with the place from which it was noted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RouteNote {
    /// What is there, without the side: "door".
    #[serde(rename = "note")]
    pub text: String,
    /// The side on which it is, as seen by the camera; `None` where the note is about the place itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Time of the pose.
    #[serde(rename = "t", with = "stamp_ns")]
    pub stamp: Stamp,
    /// The keyframe it is anchored to.
    #[serde(rename = "a")]
    pub anchor: Anchor,
    /// Pose of the camera in that keyframe, in the keyframe's unit of length.
    #[serde(rename = "rel", with = "seven")]
    pub anchor_from_camera: Se3,
    /// Pose of the camera in the odom frame of the recording, for the case that the keyframe is gone.
    #[serde(rename = "pose", with = "seven")]
    pub odom_from_camera: Se3,
}

/// Where a landmark lies for the walker who passes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RelativeDirection {
    /// To his left or right.
    Beside(Side),
    /// In front of him.
    Ahead,
    /// Behind him.
    Behind,
}

/// Why a note cannot be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoteError {
    /// It is empty, too long, or has several lines.
    #[error("a note has 1 to {} characters on one line", RouteNote::LONGEST)]
    Text,
    /// A pose is not finite.
    #[error("a value is not finite")]
    NotFinite,
}

impl RouteNote {
    /// How many notes a route may have.
    pub const MOST: usize = 1000;
    /// How many characters a note may have.
    pub const LONGEST: usize = 120;

    /// Whether it can be kept.
    ///
    /// # Errors
    /// [`NoteError`].
    pub fn check(&self) -> Result<(), NoteError> {
        let length = self.text.chars().count();
        if length == 0 || length > Self::LONGEST || self.text.chars().any(char::is_control) {
            return Err(NoteError::Text);
        }
        match self.anchor_from_camera.is_finite() && self.odom_from_camera.is_finite() {
            true => Ok(()),
            false => Err(NoteError::NotFinite),
        }
    }

    /// Whether a walker passes the note: he is near it and has not left it behind. `frame_from_camera` is where it was
    /// taken; lengths are metres.
    pub fn is_passed(ground: &Ground, frame_from_camera: &Se3, walker: &Heading) -> bool {
        let to_note = ground.plane(&frame_from_camera.translation) - walker.position;
        let ahead = to_note.dot(&crate::ground::direction(walker.course));
        let level = (ground.height(&frame_from_camera.translation) - walker.height).abs() <= SAME_FLOOR_M;
        level && to_note.norm() <= TOLD_WITHIN_M && ahead >= -PASSED_M
    }

    /// Where the landmark lies for a walker with this heading; `None` for a note without a side.
    pub fn lies(
        &self,
        ground: &Ground,
        frame_from_camera: &Se3,
        walker: &Heading,
    ) -> Option<RelativeDirection> {
        let turn = match self.side? {
            Side::Left => FRAC_PI_2,
            Side::Right => -FRAC_PI_2,
        };
        let landmark = ground.heading(frame_from_camera)? + turn;
        let from_chest = wrap(landmark - walker.heading);
        Some(match from_chest.abs() {
            a if a < FRAC_PI_4 => RelativeDirection::Ahead,
            a if a > 3.0 * FRAC_PI_4 => RelativeDirection::Behind,
            _ => RelativeDirection::Beside(Side::of(from_chest)),
        })
    }

    /// The note in words: "Door on your left."
    pub fn words(&self, lies: Option<RelativeDirection>, language: Language) -> String {
        let text = ("text", (&self.text).into());
        let place = match lies {
            None => return language.say("guide-note", &[text]),
            Some(RelativeDirection::Beside(side)) => side.name(),
            Some(RelativeDirection::Ahead) => "ahead",
            Some(RelativeDirection::Behind) => "behind",
        };
        language.say("guide-note-at", &[text, ("place", place.into())])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Facing;
    use cairn_geometry::{Pose, So3, Vec3};

    /// A camera at (x, y) that looks along `yaw`, with the ground plane z = 0: optical axis forward, y down.
    fn camera(x: f64, y: f64, yaw: f64) -> Se3 {
        let level = So3::exp(&Vec3::new(-FRAC_PI_2, 0.0, 0.0));
        let forward_is_y = So3::exp(&Vec3::new(0.0, 0.0, yaw - FRAC_PI_2));
        Se3::new(forward_is_y * level, Vec3::new(x, y, 1.4))
    }

    fn note(side: Option<Side>) -> RouteNote {
        let (anchor, pose) = (Anchor { robot: 0, seq: 0 }, camera(5.0, 0.0, 0.0));
        RouteNote {
            text: "door".into(),
            side,
            stamp: Stamp(7),
            anchor,
            anchor_from_camera: pose,
            odom_from_camera: pose,
        }
    }

    #[test]
    fn sides_are_mirrored_for_a_walker_who_faces_the_other_way() {
        let (ground, left) = (Ground::z_up(), note(Some(Side::Left)));
        let told = |facing: Facing, pose: Se3| {
            let walker = facing.heading(&ground, &Pose::new(pose)).unwrap();
            assert!(RouteNote::is_passed(&ground, &left.odom_from_camera, &walker), "{walker:?}");
            left.words(left.lies(&ground, &left.odom_from_camera, &walker), Language::English)
        };
        use std::f64::consts::PI;
        assert_eq!(told(Facing::Home, camera(3.0, 0.0, 0.0)), "Door on your left.");
        assert_eq!(told(Facing::Home, camera(7.0, 0.2, PI)), "Door on your right.");
        // The camera looks back: the walker faces home, the door is on his right.
        assert_eq!(told(Facing::Back, camera(7.0, 0.0, 0.0)), "Door on your right.");
        // Backwards he still faces as on the way out: his left stays his left.
        assert_eq!(told(Facing::Backwards, camera(7.0, 0.0, 0.0)), "Door on your left.");
        // Round a corner.
        assert_eq!(told(Facing::Home, camera(5.0, -2.0, FRAC_PI_2)), "Door ahead.");
        assert_eq!(told(Facing::Home, camera(5.0, 2.0, -FRAC_PI_2)), "Door behind you.");
        assert_eq!(note(None).words(None, Language::German), "Door.");
    }

    #[test]
    fn notes_are_told_near_and_ahead_and_on_the_same_floor_only() {
        let (ground, note) = (Ground::z_up(), note(None));
        let passed = |pose: Se3| {
            let walker = Facing::Home.heading(&ground, &Pose::new(pose)).unwrap();
            RouteNote::is_passed(&ground, &note.odom_from_camera, &walker)
        };
        assert!(passed(camera(2.5, 0.0, 0.0)) && passed(camera(6.0, 0.0, 0.0)));
        assert!(!passed(camera(1.5, 0.0, 0.0)), "too early");
        assert!(!passed(camera(6.5, 0.0, 0.0)), "behind");
        let upstairs = Se3::new(camera(4.0, 0.0, 0.0).rotation, Vec3::new(4.0, 0.0, 4.4));
        assert!(!passed(upstairs), "a floor above");
    }
}
