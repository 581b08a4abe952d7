//! What happens in a walk, in the order of time.

use crate::estimator::Reading;
use crate::page::Sentence;
use cairn_guide::Earcon;
use cairn_sensor::Stamp;
use cairn_session::{Command, Event};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What happens.
pub enum Happening {
    /// The walker goes on.
    Steps,
    /// The camera takes a picture.
    Picture,
    /// A picture has reached the server.
    Arrives(Box<Reading>),
    /// The server has time; the number says whether the plan still holds.
    Ready(u64),
    /// The server has had no picture for a while.
    Tick(u64),
    /// What the server had to say has come out of it.
    Emits(Vec<Event>, Option<Stamp>, bool),
    /// Words and sounds reach the phone.
    Words(Sentence),
    Sound(Earcon),
    Status(Option<Stamp>, bool),
    /// The phone looks round, each tenth of a second.
    PageLooks,
    /// The server hears whether words come late.
    Late(bool),
    /// A command of the walker.
    Commands(Command),
    /// A picture was acknowledged.
    Acknowledged,
}

struct Planned {
    at: Stamp,
    number: u64,
    what: Happening,
}

impl PartialEq for Planned {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}

impl Eq for Planned {}

impl PartialOrd for Planned {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Planned {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}

/// What is planned, in the order of time.
#[derive(Default)]
pub struct Plan {
    queue: BinaryHeap<Reverse<Planned>>,
    number: u64,
}

impl Plan {
    pub fn at(&mut self, at: Stamp, what: Happening) {
        self.number += 1;
        self.queue.push(Reverse(Planned { at, number: self.number, what }));
    }

    pub fn next(&mut self) -> Option<(Stamp, Happening)> {
        self.queue.pop().map(|Reverse(planned)| (planned.at, planned.what))
    }
}
