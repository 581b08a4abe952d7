//! A robot's side of a shared atlas, without a network: messages in, messages out.
//!
//! Each robot publishes its own map, as bytes with a rising version, and keeps the newest that every other robot has
//! published. What a peer holds is a set that only grows in the order of versions (a state-based replicated data type;
//! Shapiro et al., "Conflict-free replicated data types", 2011), so that any order, loss and repetition of messages
//! leads to the same set; the shared atlas is a function of that set, and so equal wherever the set is. Peers compare
//! what they have at every [`Peer::tick`] (anti-entropy; Demers et al., "Epidemic algorithms for replicated database
//! maintenance", 1987) and fetch what they miss in blocks, from anyone who has it: the robot that published it may have
//! left long ago.
//!
//! There is no clock, no thread and no chance here; a driver calls [`Peer::tick`] about once a second.

mod complaints;
mod message;
mod part;
mod seal;
mod traffic;

pub use complaints::Complaints;
pub use message::{BLOCK_BYTES, MAX_PART_BYTES, MAX_PEER_MESSAGE_BYTES, PeerKind};
pub use seal::{Identity, IdentityError, TeamKey};
pub use traffic::{Amount, Traffic};

use crate::{MAX_ROBOTS, Refused, RobotId};
use message::{Body, MAX_BLOCKS, Manifest, PeerMessage, Stamp};
use part::Part;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Greatest number of bytes that a peer holds, of all robots together.
const MAX_HELD_BYTES: usize = 512 << 20;

/// A peer that said nothing for this many ticks is taken for gone: nothing is expected from it.
const SILENT_TICKS: usize = 6;

/// A manifest is not sent again to the same peer within so many ticks.
const OFFER_TICKS: usize = 4;

/// Where a message goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum To {
    /// To all peers that can be reached.
    All,
    /// To one.
    Robot(RobotId),
}

/// A message to send.
#[derive(Clone, Debug)]
pub struct Outgoing {
    /// Where to.
    pub to: To,
    /// What it is.
    pub kind: PeerKind,
    /// The message.
    pub bytes: Arc<Vec<u8>>,
}

/// What a peer has of a robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holding {
    /// The robot that published it.
    pub robot: RobotId,
    /// Its version.
    pub version: u32,
    /// Length, bytes.
    pub bytes: usize,
}

/// What another peer said it has, and at which tick.
#[derive(Debug, Default)]
struct Heard {
    has: BTreeMap<RobotId, Stamp>,
    tick: usize,
}

/// A robot's side of a shared atlas.
#[derive(Debug)]
pub struct Peer {
    identity: Identity,
    team: TeamKey,
    /// The newest complete part of each robot, the own one included.
    parts: BTreeMap<RobotId, Part>,
    /// Newer ones that are still being fetched.
    coming: BTreeMap<RobotId, Part>,
    /// The key that each robot signed with first; any other is refused.
    keys: BTreeMap<RobotId, [u8; 32]>,
    heard: BTreeMap<RobotId, Heard>,
    /// Which manifest was sent to whom last, of which robot, and at which tick.
    offered: BTreeMap<(RobotId, RobotId), (Stamp, usize)>,
    ticks: usize,
    traffic: Traffic,
}

impl Peer {
    /// A peer that has nothing yet.
    pub fn new(identity: Identity, team: TeamKey) -> Self {
        let keys = BTreeMap::from([(identity.robot(), identity.public())]);
        Self {
            identity,
            team,
            parts: BTreeMap::new(),
            coming: BTreeMap::new(),
            keys,
            heard: BTreeMap::new(),
            offered: BTreeMap::new(),
            ticks: 0,
            traffic: Traffic::default(),
        }
    }

    /// This robot.
    pub fn robot(&self) -> RobotId {
        self.identity.robot()
    }

    /// Publishes this robot's map in place of the one before, and returns its version: the same one if it has not
    /// changed.
    ///
    /// # Errors
    /// When it is empty or too long ([`MAX_PART_BYTES`]).
    pub fn publish(&mut self, bytes: &[u8]) -> Result<u32, Refused> {
        self.publish_pieces(bytes, &[bytes.len()])
    }

    /// As [`Peer::publish`], for bytes made of pieces of these lengths, of which later versions have many in common: a
    /// piece that others already have is not sent again.
    ///
    /// # Errors
    /// As [`Peer::publish`], and when the pieces do not make up the bytes or are too many.
    pub fn publish_pieces(&mut self, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        if bytes.is_empty() || bytes.len() > MAX_PART_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let mut blocks: Vec<&[u8]> = Vec::new();
        let mut rest = bytes;
        for length in lengths {
            let (piece, after) = rest
                .split_at_checked(*length)
                .ok_or(Refused::Inconsistent("its pieces are longer than it"))?;
            blocks.extend(piece.chunks(BLOCK_BYTES));
            rest = after;
        }
        if !rest.is_empty() || blocks.len() > MAX_BLOCKS {
            return Err(Refused::Inconsistent("its pieces do not make it up, or are too many"));
        }
        let robot = self.robot();
        let before = self.parts.get(&robot).map_or(0, |part| part.manifest.version);
        let version = before.max(self.coming.get(&robot).map_or(0, |part| part.manifest.version));
        let same = self.parts.get(&robot).filter(|part| {
            let m = Manifest::new(&self.identity, part.manifest.version, &blocks);
            part.manifest.version == version && m.stamp() == part.stamp
        });
        if same.is_some() {
            return Ok(version);
        }
        Ok(self.publish_as(version.saturating_add(1), &blocks))
    }

    fn publish_as(&mut self, version: u32, blocks: &[&[u8]]) -> u32 {
        let part = Part::whole(Manifest::new(&self.identity, version, blocks), blocks);
        self.coming.remove(&self.robot());
        self.parts.insert(self.robot(), part);
        version
    }

    /// Messages that are due: what this peer has, and requests for what it misses. To be called about once a second.
    pub fn tick(&mut self) -> Vec<Outgoing> {
        self.ticks += 1;
        let have = self.parts.iter().map(|(robot, part)| (*robot, part.stamp)).collect();
        let mut out = vec![self.message(To::All, Body::Have(have))];
        let mut wants = Vec::new();
        for (robot, part) in &mut self.coming {
            let holders = holders(&self.heard, self.ticks, *robot, part.stamp);
            // Another one each time: the one asked before may not hear.
            let Some(from) = holders.get(self.ticks % holders.len().max(1)) else { continue };
            let blocks = part.next(self.ticks);
            if !blocks.is_empty() {
                wants.push((*from, Body::Want { robot: *robot, stamp: part.stamp, blocks }));
            }
        }
        out.extend(wants.into_iter().map(|(from, want)| self.message(To::Robot(from), want)));
        out
    }

    /// Takes a message in; gives the answers to it.
    ///
    /// # Errors
    /// When the message is not believed; nothing has changed then.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<Vec<Outgoing>, Refused> {
        self.receive_from(bytes).map(|(_, answers)| answers)
    }

    /// As [`Peer::receive`], with the sender that the message names, to whom the driver then knows a way.
    ///
    /// # Errors
    /// As [`Peer::receive`].
    pub fn receive_from(&mut self, bytes: &[u8]) -> Result<(RobotId, Vec<Outgoing>), Refused> {
        if bytes.len() > MAX_PEER_MESSAGE_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        let message = PeerMessage::decode(self.team.open(bytes)?)?;
        let (from, kind) = (message.from, message.kind());
        if from == self.robot() {
            return Err(Refused::OwnId);
        }
        if !self.heard.contains_key(&from) && self.heard.len() + 1 >= MAX_ROBOTS {
            return Err(Refused::TooManyRobots);
        }
        let answers = match message.body {
            Body::Have(have) => self.compare(from, have),
            Body::Manifest(manifest) => self.learn(from, manifest)?,
            Body::Want { robot, stamp, blocks } => self.serve(from, robot, stamp, &blocks),
            Body::Block { robot, stamp, index, bytes } => self.put(from, robot, stamp, index, bytes)?,
        };
        self.heard.entry(from).or_default().tick = self.ticks;
        self.traffic.received(from, kind, bytes.len());
        Ok((from, answers))
    }

    /// Counts a message that was sent; a message to all is sent several times.
    pub fn sent(&mut self, message: &Outgoing) {
        self.traffic.sent(message.kind, message.bytes.len());
    }

    /// Bytes sent and received so far.
    pub fn traffic(&self) -> &Traffic {
        &self.traffic
    }

    /// The newest complete part of each robot, by robot.
    pub fn parts(&self) -> impl Iterator<Item = (Holding, Vec<u8>)> {
        let holding = |p: &Part| Holding {
            robot: p.manifest.robot,
            version: p.manifest.version,
            bytes: p.manifest.length(),
        };
        self.parts.values().map(move |part| (holding(part), part.bytes()))
    }

    /// What the other peers have, as they said last: the version of each robot's part.
    pub fn heard(&self) -> impl Iterator<Item = (RobotId, BTreeMap<RobotId, u32>)> {
        let versions = |heard: &Heard| heard.has.iter().map(|(robot, stamp)| (*robot, stamp.0)).collect();
        self.heard.iter().map(move |(peer, heard)| (*peer, versions(heard)))
    }

    /// Whether a newer part than the one held is on its way.
    pub fn is_fetching(&self) -> bool {
        !self.coming.is_empty()
    }

    /// The same on all peers that have the same parts, and on no others.
    pub fn digest(&self) -> [u8; 8] {
        let mut bytes = Vec::new();
        for (robot, part) in &self.parts {
            bytes.extend(robot.to_le_bytes());
            bytes.extend(part.stamp.0.to_le_bytes());
            bytes.extend(part.stamp.1);
        }
        seal::hash(&bytes)
    }

    /// Bytes held, complete or not.
    pub fn held_bytes(&self) -> usize {
        self.parts.values().chain(self.coming.values()).map(|part| part.manifest.length()).sum()
    }

    fn message(&self, to: To, body: Body) -> Outgoing {
        let message = PeerMessage { from: self.robot(), body };
        // Encoding into memory cannot fail; an empty message would be refused by everyone.
        let body = postcard::to_stdvec(&message).unwrap_or_default();
        Outgoing { to, kind: message.kind(), bytes: Arc::new(self.team.seal(&body)) }
    }

    /// Sends the manifests of what another peer has not or has older.
    fn compare(&mut self, from: RobotId, have: Vec<(RobotId, Stamp)>) -> Vec<Outgoing> {
        let have: BTreeMap<RobotId, Stamp> = have.into_iter().collect();
        let newer = self.parts.iter().filter(|(robot, part)| have.get(robot).is_none_or(|s| *s < part.stamp));
        let (now, offered) = (self.ticks, &mut self.offered);
        let due = |(robot, part): &(&RobotId, &Part)| {
            let last = offered.insert((from, **robot), (part.stamp, now));
            // A peer may still be fetching what it was offered.
            let waits = last.filter(|(stamp, tick)| *stamp == part.stamp && now - tick < OFFER_TICKS);
            waits.is_none_or(|last| {
                offered.insert((from, **robot), last);
                false
            })
        };
        let manifests: Vec<Manifest> = newer.filter(due).map(|(_, part)| part.manifest.clone()).collect();
        self.heard.entry(from).or_default().has = have;
        manifests.into_iter().map(|m| self.message(To::Robot(from), Body::Manifest(m))).collect()
    }

    fn learn(&mut self, from: RobotId, manifest: Manifest) -> Result<Vec<Outgoing>, Refused> {
        let robot = manifest.robot;
        let stamp = manifest.stamp();
        if self.parts.get(&robot).is_some_and(|part| part.stamp >= stamp) {
            return Ok(Vec::new());
        }
        manifest.check()?;
        match self.keys.get(&robot) {
            Some(key) if *key != manifest.key => return Err(Refused::OtherKey(robot)),
            None if self.keys.len() >= MAX_ROBOTS => return Err(Refused::TooManyRobots),
            _ => {}
        }
        self.heard.entry(from).or_default().has.insert(robot, stamp);
        // One that is newer still is waited for, unless everyone who had it has left.
        let better = |part: &Part| {
            part.stamp == stamp
                || part.stamp > stamp && !holders(&self.heard, self.ticks, robot, part.stamp).is_empty()
        };
        if self.coming.get(&robot).is_some_and(better) {
            return Ok(Vec::new());
        }
        let replaced = self.coming.get(&robot).map_or(0, |part| part.manifest.length());
        if self.held_bytes() - replaced + manifest.length() > MAX_HELD_BYTES {
            return Err(Refused::TooMuch(MAX_HELD_BYTES));
        }
        self.keys.insert(robot, manifest.key);
        if robot == self.robot()
            && let Some(own) = self.parts.get(&robot)
        {
            // Published before this robot was started again: what it has now is newer.
            let own = own.clone();
            self.publish_as(stamp.0.saturating_add(1), &own.blocks());
            return Ok(Vec::new());
        }
        let before = [self.parts.get(&robot), self.coming.get(&robot)];
        let before: Vec<&Part> = before.into_iter().flatten().collect();
        let part = Part::new(manifest, &before);
        self.coming.insert(robot, part);
        Ok(self.go_on(from, robot))
    }

    fn serve(&self, to: RobotId, robot: RobotId, stamp: Stamp, blocks: &[u16]) -> Vec<Outgoing> {
        let Some(part) = self.parts.get(&robot).filter(|part| part.stamp == stamp) else { return Vec::new() };
        let block = |index: &u16| {
            let bytes = part.block(*index)?.to_vec();
            Some(self.message(To::Robot(to), Body::Block { robot, stamp, index: *index, bytes }))
        };
        blocks.iter().filter_map(block).collect()
    }

    fn put(
        &mut self,
        from: RobotId,
        robot: RobotId,
        stamp: Stamp,
        index: u16,
        bytes: Vec<u8>,
    ) -> Result<Vec<Outgoing>, Refused> {
        // A block of an older version, or one that came before, is late and no fault.
        let Some(part) = self.coming.get_mut(&robot).filter(|part| part.stamp == stamp) else {
            return Ok(Vec::new());
        };
        if !part.put(index, bytes) {
            return Err(Refused::Inconsistent("a block is not the one that its robot signed"));
        }
        Ok(self.go_on(from, robot))
    }

    /// Takes a part over when it is complete; otherwise asks for the next blocks when those asked for have come.
    fn go_on(&mut self, from: RobotId, robot: RobotId) -> Vec<Outgoing> {
        let Some(part) = self.coming.get_mut(&robot) else { return Vec::new() };
        if part.is_complete() {
            if let Some(part) = self.coming.remove(&robot) {
                self.parts.insert(robot, part);
            }
            return Vec::new();
        }
        let blocks = if part.has_room() { part.next(self.ticks) } else { Vec::new() };
        if blocks.is_empty() {
            return Vec::new();
        }
        let want = Body::Want { robot, stamp: part.stamp, blocks };
        vec![self.message(To::Robot(from), want)]
    }
}

/// The peers that have this version of a robot's part, and were heard lately.
fn holders(heard: &BTreeMap<RobotId, Heard>, now: usize, robot: RobotId, stamp: Stamp) -> Vec<RobotId> {
    let here = |h: &Heard| h.has.get(&robot) == Some(&stamp) && now - h.tick <= SILENT_TICKS;
    heard.iter().filter(|(_, h)| here(h)).map(|(peer, _)| *peer).collect()
}
