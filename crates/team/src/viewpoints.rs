//! Where the key frames of a robot's map stand and which way they look, in about a dozen bytes each.
//!
//! Another robot that has found how the map lies to its own can tell from them which key frames would show what it saw itself.

use crate::RobotId;
use crate::envelope::{Kind, Refused, open, seal};
use cairn_geometry::{Se3, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Greatest number of key frames in a message.
pub const MAX_VIEWPOINTS: usize = 65_536;
/// Greatest length of a message, in bytes: at most 20 for a key frame.
pub const MAX_VIEWPOINTS_BYTES: usize = 20 * MAX_VIEWPOINTS + 64;
/// Units of a position in a metre, and of a direction in one.
const PER_METRE: f64 = 100.0;
const PER_ONE: f64 = 127.0;
/// Farthest that a key frame may be from the origin along an axis, in units of a position: 1,000 km.
const FARTHEST: i32 = 100_000_000;
/// How long a direction may be, where rounding makes it 1 within 1 %.
const UNIT_LENGTH: std::ops::Range<f64> = 0.98..1.02;

/// Where a key frame stands and which way it looks, in the frame of its map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The position of the camera, metres; to a centimetre.
    pub position: Vec3,
    /// The optical axis, of length one; to half a degree.
    pub axis: Vec3,
}

impl Viewpoint {
    /// Of a camera.
    pub fn of(world_from_camera: &Se3) -> Self {
        Self { position: world_from_camera.translation, axis: world_from_camera.rotation * Vec3::z() }
    }

    /// The same in another frame.
    #[must_use]
    pub fn moved(&self, other_from_map: &Se3) -> Self {
        Self { position: *other_from_map * self.position, axis: other_from_map.rotation * self.axis }
    }
}

/// The viewpoints of the key frames of a robot's map, by their numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Viewpoints(pub BTreeMap<u32, Viewpoint>);

#[derive(Serialize, Deserialize)]
struct Body {
    robot: RobotId,
    /// How much greater each number is than the one before, and the viewpoint in its units.
    key_frames: Vec<(u32, [i32; 3], [i8; 3])>,
}

impl Viewpoints {
    /// The bytes to send; `None` where there are too many, or one is too far away.
    pub fn encode(&self, robot: RobotId) -> Option<Vec<u8>> {
        let mut last = 0;
        let mut key_frames = Vec::with_capacity(self.0.len());
        for (seq, Viewpoint { position, axis }) in &self.0 {
            let cm = [position.x, position.y, position.z].map(|v| (v * PER_METRE).round());
            if self.0.len() > MAX_VIEWPOINTS || !cm.iter().all(|v| v.abs() <= f64::from(FARTHEST)) {
                return None;
            }
            let axis = [axis.x, axis.y, axis.z].map(|v| (v * PER_ONE).round() as i8);
            key_frames.push((seq - std::mem::replace(&mut last, *seq), cm.map(|v| v as i32), axis));
        }
        let body = postcard::to_stdvec(&Body { robot, key_frames }).ok()?;
        Some(seal(Kind::Viewpoints, &body))
    }

    /// Decodes them. `from` is the robot that signed them.
    ///
    /// # Errors
    /// When the message is not valid; see [`Refused`].
    pub fn decode(from: RobotId, bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > MAX_VIEWPOINTS_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let body = open(Kind::Viewpoints, bytes)?;
        let (body, rest) = postcard::take_from_bytes::<Body>(body).map_err(|_| Refused::Encoding)?;
        if !rest.is_empty() || body.key_frames.len() > MAX_VIEWPOINTS {
            return Err(Refused::Encoding);
        }
        if body.robot != from {
            return Err(Refused::WrongSender { from, claimed: body.robot });
        }
        let (mut seq, mut viewpoints) = (0u32, BTreeMap::new());
        for (step, cm, axis) in body.key_frames {
            seq = seq.checked_add(step).ok_or(Refused::Encoding)?;
            if !cm.iter().all(|v| (-FARTHEST..=FARTHEST).contains(v)) {
                return Err(Refused::Inconsistent("a key frame is farther away than a robot walks"));
            }
            let axis = Vec3::from(axis.map(f64::from)) / PER_ONE;
            if !UNIT_LENGTH.contains(&axis.norm()) {
                return Err(Refused::Inconsistent("the direction of a key frame has not the length one"));
            }
            let position = Vec3::from(cm.map(f64::from)) / PER_METRE;
            if viewpoints.insert(seq, Viewpoint { position, axis: axis.normalize() }).is_some() {
                return Err(Refused::Inconsistent("a key frame stands at two places"));
            }
        }
        Ok(Self(viewpoints))
    }
}
