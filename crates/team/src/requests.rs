//! Which key frames of other robots a robot needs features of, to tell whether it was where it seems to have been.

use crate::envelope::{Kind, Refused, open, seal};
use crate::{MAX_ROBOTS, RobotId};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Greatest number of key frames that are asked for of one robot.
pub const MAX_REQUESTED: usize = 16;
/// Greatest length of a message, in bytes.
pub const MAX_REQUESTS_BYTES: usize = 64 << 10;

/// The key frames that a robot asks for, by their robots and numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlaceRequests(pub BTreeMap<RobotId, BTreeSet<u32>>);

#[derive(Serialize, Deserialize)]
struct Body {
    robot: RobotId,
    requests: PlaceRequests,
}

impl PlaceRequests {
    fn is_bounded(&self) -> bool {
        self.0.len() <= MAX_ROBOTS && self.0.values().all(|seqs| seqs.len() <= MAX_REQUESTED)
    }

    /// The bytes to send; `None` where too much is asked for.
    pub fn encode(&self, robot: RobotId) -> Option<Vec<u8>> {
        let body = postcard::to_stdvec(&Body { robot, requests: self.clone() }).ok()?;
        let bytes = seal(Kind::Requests, &body);
        (self.is_bounded() && bytes.len() <= MAX_REQUESTS_BYTES).then_some(bytes)
    }

    /// Decodes them. `from` is the robot that signed them.
    ///
    /// # Errors
    /// When the message is not valid, or asks for too much; see [`Refused`].
    pub fn decode(from: RobotId, bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > MAX_REQUESTS_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let body = open(Kind::Requests, bytes)?;
        let (Body { robot, requests }, rest) =
            postcard::take_from_bytes::<Body>(body).map_err(|_| Refused::Encoding)?;
        if !rest.is_empty() {
            return Err(Refused::Encoding);
        }
        if robot != from {
            return Err(Refused::WrongSender { from, claimed: robot });
        }
        match requests.is_bounded() {
            true => Ok(requests),
            false => Err(Refused::Inconsistent("it asks for more key frames than a robot may")),
        }
    }
}
