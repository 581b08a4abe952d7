//! Bytes and messages, by robot and kind.

use super::PeerKind;
use crate::RobotId;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A number of messages and their bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Amount {
    /// Messages.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
}

impl Amount {
    fn add(&mut self, bytes: usize) {
        self.messages += 1;
        self.bytes += bytes as u64;
    }
}

/// What a peer sent, and what it received and believed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Sent, by kind.
    pub sent: BTreeMap<PeerKind, Amount>,
    /// Received, by the robot that sent it and kind.
    pub received: BTreeMap<(RobotId, PeerKind), Amount>,
}

impl Traffic {
    pub(super) fn sent(&mut self, kind: PeerKind, bytes: usize) {
        self.sent.entry(kind).or_default().add(bytes);
    }

    pub(super) fn received(&mut self, from: RobotId, kind: PeerKind, bytes: usize) {
        self.received.entry((from, kind)).or_default().add(bytes);
    }
}
