//! What robots send each other about their graphs: one message a robot and exchange, encoded by postcard.
//!
//! A message says everything of its robot anew but what never changes ([`Shared`]: which poses it shares, and the
//! measurements between them); that is sent when it is new, and again when someone asks. Numbers that fix the optimum keep their digits;
//! those that only say how fast it is approached are `f32`.

use crate::envelope::{Kind, open, seal};
use crate::{PoseId, RobotId};
use serde::{Deserialize, Serialize};

/// The version that this program writes and reads.
pub const VERSION: u8 = 1;
/// Longest message that is read or written, in bytes.
pub const MAX_BYTES: usize = 4 << 20;

/// Why a message was not believed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// It is longer than what is read ([`MAX_BYTES`], of words [`crate::MAX_WORDS_BYTES`]).
    #[error("the message has {0} bytes, more than are read")]
    TooLong(usize),
    /// It is shorter than its header.
    #[error("the message ends after {0} bytes")]
    TooShort(usize),
    /// Another version.
    #[error("the message has version {0}, this program reads version {VERSION}")]
    Version(u8),
    /// Of another kind than expected, or of none that is known.
    #[error("the message is of kind {0}, another one was expected here")]
    Kind(u8),
    /// The checksum is not that of the bytes.
    #[error("the checksum of the message does not fit its bytes")]
    Checksum,
    /// The bytes are no message, or go on after one.
    #[error("the message cannot be decoded")]
    Encoding,
    /// It says it is from another robot than the one it came from.
    #[error("robot {from} sent a message as robot {claimed}")]
    WrongSender {
        /// Who sent it.
        from: RobotId,
        /// Who it says it is from.
        claimed: RobotId,
    },
    /// It says it is from the robot that received it.
    #[error("a message claims to be from this robot")]
    OwnId,
    /// One with this number or a higher one came before: late, twice, or replayed.
    #[error("message {number} of robot {robot} came after number {newest}")]
    Old {
        /// Whose it is.
        robot: RobotId,
        /// Its number.
        number: u32,
        /// The highest number before.
        newest: u32,
    },
    /// Its poses have another dimension.
    #[error("the message is about poses of {found} dimensions, not {expected}")]
    Dimension {
        /// Of the message.
        found: u8,
        /// Of this team.
        expected: u8,
    },
    /// Its parts contradict each other.
    #[error("the message contradicts itself: {0}")]
    Inconsistent(&'static str),
    /// More robots than [`crate::MAX_ROBOTS`].
    #[error("there are too many robots to listen to one more")]
    TooManyRobots,
}

/// A message of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Degrees of freedom of a pose: 3 or 6.
    pub dimension: u8,
    /// Who sends it.
    pub robot: RobotId,
    /// Rises with every message of the robot.
    pub number: u32,
    /// Rises whenever [`Shared`] changes.
    pub epoch: u32,
    /// Robots whose [`Shared`] is missing here.
    pub requests: Vec<RobotId>,
    /// What changes rarely.
    pub shared: Option<Shared>,
    /// What changes with every message.
    pub estimate: Estimate,
    /// Loops to other robots, by their place in [`Shared::loops`], that this robot rejects; nothing while it has not judged.
    pub rejected: Option<Vec<u32>>,
}

/// What a robot shares: poses, measurements between them, loops to others, and which poses surround what it eliminated.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shared {
    /// Numbers of the poses, rising: the first, then each less the one before.
    pub steps: Vec<u32>,
    /// Different information matrices, upper triangles by rows one after the other.
    pub informations: Vec<f64>,
    /// Measurements between two of these poses, by their places.
    pub inner: Vec<(u16, u16)>,
    /// Loops between one of these poses, by its place, and a pose of another robot; whether the other is the first, `a`.
    pub loops: Vec<(u16, PoseId, bool)>,
    /// Coordinates of `a_from_b` of all measurements, then of all loops.
    pub measured: Vec<f64>,
    /// Which of the information matrices each of them has.
    pub information: Vec<u16>,
    /// The poses around each part that was eliminated, by their places, the base first.
    pub parts: Vec<Vec<u16>>,
}

/// Where a robot is: its poses, and its condensed graph there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Coordinates of `world_from_pose` of the first pose.
    pub first: Vec<f64>,
    /// Coordinates of `first^-1 * pose` of the others.
    pub others: Vec<f32>,
    /// Of each part, one after the other: the upper triangle of `R` by rows, then `z`.
    pub parts: Vec<f32>,
}

impl Message {
    /// The bytes to send; `None` when they would be longer than [`MAX_BYTES`].
    pub fn encode(&self) -> Option<Vec<u8>> {
        let bytes = seal(Kind::Graph, &postcard::to_stdvec(self).ok()?);
        (bytes.len() <= MAX_BYTES).then_some(bytes)
    }

    /// The message in these bytes, with its parts checked against each other.
    ///
    /// # Errors
    /// When it cannot be believed; see [`Refused`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > MAX_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let body = open(Kind::Graph, bytes)?;
        let (message, rest) = postcard::take_from_bytes::<Self>(body).map_err(|_| Refused::Encoding)?;
        if !rest.is_empty() {
            return Err(Refused::Encoding);
        }
        message.check().map_err(Refused::Inconsistent)?;
        Ok(message)
    }

    fn check(&self) -> Result<(), &'static str> {
        let d = usize::from(self.dimension);
        if d == 0 || d > 7 {
            return Err("no pose has as many degrees of freedom");
        }
        let e = &self.estimate;
        let numbers = e.first.iter().copied().chain(e.others.iter().chain(&e.parts).map(|v| f64::from(*v)));
        if !numbers.into_iter().all(f64::is_finite) {
            return Err("a number of the estimate is not finite");
        }
        if ![0, d].contains(&e.first.len()) || !e.others.len().is_multiple_of(d) {
            return Err("the poses of the estimate are not whole");
        }
        match &self.shared {
            Some(shared) => shared.check(d, self.robot)?.fits(e, self.rejected.as_deref(), d),
            None => Ok(()),
        }
    }
}

impl Shared {
    /// Poses that are shared.
    pub fn poses(&self) -> usize {
        self.steps.len()
    }

    fn check(&self, d: usize, robot: RobotId) -> Result<&Self, &'static str> {
        let n = self.steps.len();
        let triangle = d * (d + 1) / 2;
        if n > usize::from(u16::MAX) {
            return Err("it shares too many poses");
        }
        let mut seq = 0u32;
        for (k, step) in self.steps.iter().enumerate() {
            seq = seq.checked_add(*step).ok_or("its pose numbers overflow")?;
            if k > 0 && *step == 0 {
                return Err("its pose numbers do not rise");
            }
        }
        let measurements = self.inner.len() + self.loops.len();
        let informations = self.informations.len() / triangle;
        if !self.informations.len().is_multiple_of(triangle)
            || self.measured.len() != measurements * d
            || self.information.len() != measurements
        {
            return Err("its measurements are not whole");
        }
        let place = |k: &u16| usize::from(*k) < n;
        let inner = self.inner.iter().all(|(a, b)| place(a) && place(b) && a != b);
        let loops = self.loops.iter().all(|(own, other, _)| place(own) && other.robot != robot);
        if !inner || !loops || !self.information.iter().all(|k| usize::from(*k) < informations) {
            return Err("a measurement names what there is not");
        }
        if !self.informations.iter().chain(&self.measured).all(|v| v.is_finite()) {
            return Err("a measurement is not finite");
        }
        for part in &self.parts {
            let mut sorted = part.clone();
            sorted.sort_unstable();
            if part.len() < 2 || !part.iter().all(place) || sorted.windows(2).any(|w| w[0] == w[1]) {
                return Err("an eliminated part names what there is not");
            }
        }
        Ok(self)
    }

    /// Whether an estimate is about what is shared here.
    pub(crate) fn fits(&self, e: &Estimate, rejected: Option<&[u32]>, d: usize) -> Result<(), &'static str> {
        let n = self.poses();
        let expected = if n == 0 { (0, 0) } else { (d, (n - 1) * d) };
        let root = |m: &Vec<u16>| {
            let n = d * (m.len() - 1);
            n * (n + 1) / 2 + n
        };
        if (e.first.len(), e.others.len()) != expected {
            return Err("the estimate has another number of poses");
        }
        if e.parts.len() != self.parts.iter().map(root).sum::<usize>() {
            return Err("the estimate has another number of condensed parts");
        }
        match rejected.unwrap_or_default().iter().all(|k| (*k as usize) < self.loops.len()) {
            true => Ok(()),
            false => Err("it rejects a loop that it does not have"),
        }
    }
}
