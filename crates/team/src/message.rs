//! Messages about the robots' graphs: one message per robot and exchange, encoded by postcard.
//!
//! A message is complete except for the part that rarely changes ([`Shared`]: which poses the robot shares, and the
//! measurements between them); that part is sent when it is new, and again on request. Numbers that determine the
//! optimum have full precision; those that only affect the rate of convergence are `f32`.

use crate::envelope::{Kind, Refused, open, seal};
use crate::{PoseId, RobotId};
use serde::{Deserialize, Serialize};

/// Greatest length of a message that is read or written, in bytes.
pub const MAX_BYTES: usize = 4 << 20;

/// A message of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Degrees of freedom of a pose: 3 or 6.
    pub dimension: u8,
    /// The sender.
    pub robot: RobotId,
    /// Increases with every message of the robot.
    pub number: u32,
    /// Increases whenever [`Shared`] changes.
    pub epoch: u32,
    /// Robots whose [`Shared`] the sender is missing.
    pub requests: Vec<RobotId>,
    /// The part that changes rarely; `None` when it is not sent.
    pub shared: Option<Shared>,
    /// The part that changes with every message.
    pub estimate: Estimate,
    /// Loops to other robots that the sender rejects, as indices of [`Shared::loops`]; `None` if it has not judged them
    /// yet.
    pub rejected: Option<Vec<u32>>,
}

/// What a robot shares: poses, measurements between them, loops to others, and the poses around its eliminated parts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shared {
    /// Numbers of the poses, in rising order: the first, then the difference to the one before.
    pub steps: Vec<u32>,
    /// The different information matrices: upper triangles by rows, one matrix after the other.
    pub informations: Vec<f64>,
    /// Measurements between two of these poses, as pairs of pose indices.
    pub inner: Vec<(u16, u16)>,
    /// Loops between one of these poses, by index, and a pose of another robot; true if the other pose is the first,
    /// `a`.
    pub loops: Vec<(u16, PoseId, bool)>,
    /// Coordinates of `a_from_b` of all measurements, then of all loops.
    pub measured: Vec<f64>,
    /// The index of the information matrix of each of them.
    pub information: Vec<u16>,
    /// The poses around each eliminated part, as pose indices, the base first.
    pub parts: Vec<Vec<u16>>,
}

/// The estimate of a robot: its poses, and its condensed graph linearised there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Coordinates of `world_from_pose` of the first pose.
    pub first: Vec<f64>,
    /// Coordinates of `first^-1 * pose` of the others.
    pub others: Vec<f32>,
    /// For each part: the upper triangle of `R` by rows, then `z`.
    pub parts: Vec<f32>,
}

impl Message {
    /// The bytes to send; `None` when they would be more than [`MAX_BYTES`].
    pub fn encode(&self) -> Option<Vec<u8>> {
        let bytes = seal(Kind::Graph, &postcard::to_stdvec(self).ok()?);
        (bytes.len() <= MAX_BYTES).then_some(bytes)
    }

    /// The same bytes with the lengths of three pieces that they are made of: who sends the message, what it shares, and its estimate.
    /// The second one stays the same from message to message as long as the epoch does.
    pub fn encode_pieces(&self) -> Option<(Vec<u8>, [usize; 3])> {
        let bytes = self.encode()?;
        let shared = postcard::to_stdvec(&self.shared).ok()?.len();
        let estimate = postcard::to_stdvec(&(&self.estimate, &self.rejected)).ok()?.len();
        // Fields follow each other, without anything between them.
        let first = bytes.len().checked_sub(shared + estimate)?;
        Some((bytes, [first, shared, estimate]))
    }

    /// Decodes a message and checks that its parts are consistent.
    ///
    /// # Errors
    /// When the message is not valid; see [`Refused`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > MAX_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let body = open(Kind::Graph, bytes)?;
        let (message, rest) = postcard::take_from_bytes::<Self>(body).map_err(|_| Refused::Encoding)?;
        if !rest.is_empty() {
            return Err(Refused::Encoding);
        }
        message.check()?;
        Ok(message)
    }

    fn check(&self) -> Result<(), Refused> {
        let d = usize::from(self.dimension);
        if d == 0 || d > 7 {
            return Err(Refused::Inconsistent("no pose has as many degrees of freedom"));
        }
        let e = &self.estimate;
        let numbers = e.first.iter().copied().chain(e.others.iter().chain(&e.parts).map(|v| f64::from(*v)));
        if !numbers.into_iter().all(f64::is_finite) {
            return Err(Refused::Inconsistent("a number of the estimate is not finite"));
        }
        if ![0, d].contains(&e.first.len()) || !e.others.len().is_multiple_of(d) {
            return Err(Refused::Inconsistent("the poses of the estimate are not whole"));
        }
        match &self.shared {
            Some(shared) => shared.check(d, self.robot)?.fits(e, self.rejected.as_deref(), d),
            None => Ok(()),
        }
    }
}

impl Shared {
    /// Number of shared poses.
    pub fn poses(&self) -> usize {
        self.steps.len()
    }

    fn check(&self, d: usize, robot: RobotId) -> Result<&Self, Refused> {
        let n = self.steps.len();
        let triangle = d * (d + 1) / 2;
        if n > usize::from(u16::MAX) {
            return Err(Refused::Inconsistent("it shares too many poses"));
        }
        let mut seq = 0u32;
        for (k, step) in self.steps.iter().enumerate() {
            seq = seq.checked_add(*step).ok_or(Refused::Inconsistent("its pose numbers overflow"))?;
            if k > 0 && *step == 0 {
                return Err(Refused::Inconsistent("its pose numbers do not rise"));
            }
        }
        let measurements = self.inner.len() + self.loops.len();
        let informations = self.informations.len() / triangle;
        if !self.informations.len().is_multiple_of(triangle)
            || self.measured.len() != measurements * d
            || self.information.len() != measurements
        {
            return Err(Refused::Inconsistent("its measurements are not whole"));
        }
        let place = |k: &u16| usize::from(*k) < n;
        let inner = self.inner.iter().all(|(a, b)| place(a) && place(b) && a != b);
        let loops = self.loops.iter().all(|(own, other, _)| place(own) && other.robot != robot);
        if !inner || !loops || !self.information.iter().all(|k| usize::from(*k) < informations) {
            return Err(Refused::Inconsistent("a measurement names what there is not"));
        }
        if !self.informations.iter().chain(&self.measured).all(|v| v.is_finite()) {
            return Err(Refused::Inconsistent("a measurement is not finite"));
        }
        for part in &self.parts {
            let mut sorted = part.clone();
            sorted.sort_unstable();
            if part.len() < 2 || !part.iter().all(place) || sorted.windows(2).any(|w| w[0] == w[1]) {
                return Err(Refused::Inconsistent("an eliminated part names what there is not"));
            }
        }
        Ok(self)
    }

    /// Checks that an estimate fits what is shared here.
    pub(crate) fn fits(&self, e: &Estimate, rejected: Option<&[u32]>, d: usize) -> Result<(), Refused> {
        let n = self.poses();
        let expected = if n == 0 { (0, 0) } else { (d, (n - 1) * d) };
        let root = |m: &Vec<u16>| {
            let n = d * (m.len() - 1);
            n * (n + 1) / 2 + n
        };
        if (e.first.len(), e.others.len()) != expected {
            return Err(Refused::Inconsistent("the estimate has another number of poses"));
        }
        if e.parts.len() != self.parts.iter().map(root).sum::<usize>() {
            return Err(Refused::Inconsistent("the estimate has another number of condensed parts"));
        }
        match rejected.unwrap_or_default().iter().all(|k| (*k as usize) < self.loops.len()) {
            true => Ok(()),
            false => Err(Refused::Inconsistent("it rejects a loop that it does not have")),
        }
    }
}
