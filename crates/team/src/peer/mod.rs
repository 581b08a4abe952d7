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
//! A robot publishes two things: the bags of words of its key frames, a kilobyte each, which everyone gets, and its map,
//! which only those get that want it ([`Peer::want`]). Whom a robot shares a place with follows from the words alone, and
//! so every robot comes to the same answer (Cieslewski et al., "Data-efficient decentralized visual SLAM", 2018, and
//! Lajoie et al., "DOOR-SLAM", 2020, exchange in this order).
//!
//! There is no clock, no thread and no chance here; a driver calls [`Peer::tick`] about once a second.

mod complaints;
mod message;
mod part;
mod seal;
mod traffic;

pub use complaints::Complaints;
pub use message::{
    BLOCK_BYTES, MAX_PART_BYTES, MAX_PEER_MESSAGE_BYTES, MAX_WORDS_PART_BYTES, PeerKind, Wanted,
};
pub use seal::{Identity, IdentityError, TeamKey};
pub use traffic::{Amount, Traffic};

use crate::{MAX_ROBOTS, Refused, RobotId};
use message::{Body, Layer, MAX_BLOCKS, Manifest, PeerMessage, Stamp, Topic};
use part::Part;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Greatest number of bytes that a peer holds, of all robots together.
pub const MAX_HELD_BYTES: usize = 512 << 20;

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
#[derive(Debug)]
struct Heard {
    has: BTreeMap<Topic, Stamp>,
    wants: Wanted,
    tick: usize,
}

impl Default for Heard {
    fn default() -> Self {
        Self { has: BTreeMap::new(), wants: Wanted::Of(BTreeSet::new()), tick: 0 }
    }
}

/// A robot's side of a shared atlas.
#[derive(Debug)]
pub struct Peer {
    identity: Identity,
    team: TeamKey,
    /// The newest complete words and map of each robot, the own ones included.
    parts: BTreeMap<Topic, Part>,
    /// Newer ones that are still being fetched.
    coming: BTreeMap<Topic, Part>,
    /// Whose maps are fetched.
    wanted: Wanted,
    /// A map is not fetched again for so many ticks, and at which tick each was complete.
    refresh_ticks: usize,
    fetched: BTreeMap<RobotId, usize>,
    /// With [`Peer::want`]: the words that were there then; others are not said to be here yet.
    judged: Option<BTreeMap<RobotId, Stamp>>,
    /// The key that each robot signed with first; any other is refused.
    keys: BTreeMap<RobotId, [u8; 32]>,
    heard: BTreeMap<RobotId, Heard>,
    /// Which manifest was sent to whom last, of which robot, and at which tick.
    offered: BTreeMap<(RobotId, Topic), (Stamp, usize)>,
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
            wanted: Wanted::All,
            refresh_ticks: 0,
            fetched: BTreeMap::new(),
            judged: None,
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

    /// Does not fetch the map of a robot again for so many ticks after it was complete; what changed several times in
    /// between is then sent once. Its words always come at once.
    #[must_use]
    pub fn with_refresh(self, ticks: usize) -> Self {
        Self { refresh_ticks: ticks, ..self }
    }

    /// Sets whose maps are fetched, as it follows from [`Peer::words`]; before, those of all. Maps of others that are
    /// already here stay, to be passed on, but are neither renewed nor listed.
    ///
    /// Words are said to be here only once they were judged so: a robot that leaves when all have its words can rely on
    /// it that those who wanted its map have said so.
    pub fn want(&mut self, wanted: Wanted) {
        self.judged = match wanted {
            Wanted::All => None,
            Wanted::Of(_) => Some(self.word_stamps().collect()),
        };
        self.wanted = wanted;
        let robot = self.robot();
        let wanted = &self.wanted;
        self.coming.retain(|(r, layer), _| *layer == Layer::Words || *r == robot || wanted.includes(*r));
    }

    /// Whose maps are fetched.
    pub fn wanted(&self) -> &Wanted {
        &self.wanted
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
        self.publish_layer(Layer::Map, bytes, lengths)
    }

    /// As [`Peer::publish_pieces`], for the words of this robot's key frames, to be published before its map.
    ///
    /// # Errors
    /// As [`Peer::publish_pieces`], with [`MAX_WORDS_PART_BYTES`].
    pub fn publish_words(&mut self, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        if bytes.is_empty() || bytes.len() > MAX_WORDS_PART_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        self.publish_layer(Layer::Words, bytes, lengths)
    }

    fn publish_layer(&mut self, layer: Layer, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
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
        let topic = (self.robot(), layer);
        let version = |part: Option<&Part>| part.map_or(0, |part| part.manifest.version);
        let newest = version(self.parts.get(&topic)).max(version(self.coming.get(&topic)));
        let same = self.parts.get(&topic).filter(|part| {
            let m = Manifest::new(&self.identity, layer, part.manifest.version, &blocks);
            part.manifest.version == newest && m.stamp() == part.stamp
        });
        if same.is_some() {
            return Ok(newest);
        }
        Ok(self.publish_as(layer, newest.saturating_add(1), &blocks))
    }

    fn publish_as(&mut self, layer: Layer, version: u32, blocks: &[&[u8]]) -> u32 {
        let part = Part::whole(Manifest::new(&self.identity, layer, version, blocks), blocks);
        let topic = (self.robot(), layer);
        self.coming.remove(&topic);
        self.parts.insert(topic, part);
        version
    }

    /// Messages that are due: what this peer has, and requests for what it misses. To be called about once a second.
    pub fn tick(&mut self) -> Vec<Outgoing> {
        self.ticks += 1;
        let mut out = vec![self.message(To::All, Body::Have { has: self.said(), wants: self.due() })];
        let mut wants = Vec::new();
        for (topic, part) in &mut self.coming {
            let holders = holders(&self.heard, self.ticks, *topic, part.stamp);
            // Another one each time: the one asked before may not hear.
            let Some(from) = holders.get(self.ticks % holders.len().max(1)) else { continue };
            let blocks = part.next(self.ticks);
            if !blocks.is_empty() {
                wants.push((*from, Body::Want { topic: *topic, stamp: part.stamp, blocks }));
            }
        }
        out.extend(wants.into_iter().map(|(from, want)| self.message(To::Robot(from), want)));
        out
    }

    /// What it says to have: words only once they were judged.
    fn said(&self) -> Vec<(Topic, Stamp)> {
        let is_said = |(robot, layer): &Topic, stamp: &Stamp| {
            let judged = self.judged.as_ref().is_none_or(|judged| judged.get(robot) == Some(stamp));
            *layer == Layer::Map || *robot == self.robot() || judged
        };
        let all = self.parts.iter().map(|(topic, part)| (*topic, part.stamp));
        all.filter(|(topic, stamp)| is_said(topic, stamp)).collect()
    }

    /// Whose maps it would fetch now: those wanted, and not so soon after the last time.
    fn due(&self) -> Wanted {
        let rests = |robot: &RobotId| {
            let since = |tick: &usize| self.ticks.saturating_sub(*tick);
            self.fetched.get(robot).is_some_and(|tick| since(tick) < self.refresh_ticks)
        };
        let known = self.heard.values().flat_map(|heard| heard.has.keys()).map(|(robot, _)| *robot);
        let robots = known.filter(|robot| self.wanted.includes(*robot) && !rests(robot));
        match self.wanted {
            Wanted::All if self.refresh_ticks == 0 => Wanted::All,
            _ => Wanted::Of(robots.chain([self.robot()]).take(MAX_ROBOTS).collect()),
        }
    }

    fn word_stamps(&self) -> impl Iterator<Item = (RobotId, Stamp)> {
        let words = self.parts.iter().filter(|((_, layer), _)| *layer == Layer::Words);
        words.map(|((robot, _), part)| (*robot, part.stamp))
    }

    /// Whether words came that [`Peer::want`] has not judged.
    pub fn has_new_words(&self) -> bool {
        let now: BTreeMap<RobotId, Stamp> = self.word_stamps().collect();
        self.judged.as_ref() != Some(&now)
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
            Body::Have { has, wants } => self.compare(from, has, wants),
            Body::Manifest(manifest) => self.learn(from, manifest)?,
            Body::Want { topic, stamp, blocks } => self.serve(from, topic, stamp, &blocks),
            Body::Block { topic, stamp, index, bytes } => self.put(from, topic, stamp, index, bytes)?,
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

    /// The newest complete map of each robot whose map is wanted, the own one included, by robot.
    pub fn parts(&self) -> impl Iterator<Item = (Holding, Vec<u8>)> {
        self.maps().map(|part| (holding(part), part.bytes()))
    }

    /// The newest complete words of each robot, by robot.
    pub fn words(&self) -> impl Iterator<Item = (Holding, Vec<u8>)> {
        let words = self.parts.iter().filter(|((_, layer), _)| *layer == Layer::Words);
        words.map(|(_, part)| (holding(part), part.bytes()))
    }

    fn maps(&self) -> impl Iterator<Item = &Part> {
        let own = self.robot();
        let listed = move |(robot, layer): &Topic| {
            *layer == Layer::Map && (*robot == own || self.wanted.includes(*robot))
        };
        self.parts.iter().filter(move |(topic, _)| listed(topic)).map(|(_, part)| part)
    }

    /// Whether another peer has the last words of this robot, and its last map if it wants that, as it said last.
    pub fn is_up_to_date(&self, other: RobotId) -> bool {
        let own = |layer| self.parts.get(&(self.robot(), layer)).map(|part| part.stamp);
        let Some(heard) = self.heard.get(&other) else { return false };
        let has = |layer| heard.has.get(&(self.robot(), layer)).copied();
        let has_words = own(Layer::Words).is_none_or(|stamp| has(Layer::Words) == Some(stamp));
        let is_without = has(Layer::Map).is_none() && !heard.wants.includes(self.robot());
        has_words && (own(Layer::Map) == has(Layer::Map) || is_without && own(Layer::Words).is_some())
    }

    /// Whether something newer than what is held is on its way.
    pub fn is_fetching(&self) -> bool {
        !self.coming.is_empty()
    }

    /// The same on all peers that want and have the same maps, and on no others.
    pub fn digest(&self) -> [u8; 8] {
        let mut bytes = Vec::new();
        for part in self.maps() {
            bytes.extend(part.manifest.robot.to_le_bytes());
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

    /// Sends the manifests of what another peer has not or has older: of words, and of the maps that it wants.
    fn compare(&mut self, from: RobotId, has: Vec<(Topic, Stamp)>, wants: Wanted) -> Vec<Outgoing> {
        let has: BTreeMap<Topic, Stamp> = has.into_iter().collect();
        let goes = |(robot, layer): &Topic| *layer == Layer::Words || wants.includes(*robot);
        let is_newer = |topic: &Topic, part: &Part| has.get(topic).is_none_or(|s| *s < part.stamp);
        let newer = self.parts.iter().filter(|(topic, part)| goes(topic) && is_newer(topic, part));
        let (now, offered) = (self.ticks, &mut self.offered);
        let due = |(topic, part): &(&Topic, &Part)| {
            let last = offered.insert((from, **topic), (part.stamp, now));
            // A peer may still be fetching what it was offered.
            let waits = last.filter(|(stamp, tick)| *stamp == part.stamp && now - tick < OFFER_TICKS);
            waits.is_none_or(|last| {
                offered.insert((from, **topic), last);
                false
            })
        };
        let manifests: Vec<Manifest> = newer.filter(due).map(|(_, part)| part.manifest.clone()).collect();
        let heard = self.heard.entry(from).or_default();
        (heard.has, heard.wants) = (has, wants);
        manifests.into_iter().map(|m| self.message(To::Robot(from), Body::Manifest(m))).collect()
    }

    fn learn(&mut self, from: RobotId, manifest: Manifest) -> Result<Vec<Outgoing>, Refused> {
        let (robot, topic, stamp) = (manifest.robot, manifest.topic(), manifest.stamp());
        if self.parts.get(&topic).is_some_and(|part| part.stamp >= stamp) {
            return Ok(Vec::new());
        }
        manifest.check()?;
        match self.keys.get(&robot) {
            Some(key) if *key != manifest.key => return Err(Refused::OtherKey(robot)),
            None if self.keys.len() >= MAX_ROBOTS => return Err(Refused::TooManyRobots),
            _ => {}
        }
        self.heard.entry(from).or_default().has.insert(topic, stamp);
        let is_own = robot == self.robot();
        if topic.1 == Layer::Map && !is_own && !self.wanted.includes(robot) {
            return Ok(Vec::new());
        }
        // One that is newer still is waited for, unless everyone who had it has left.
        let better = |part: &Part| {
            part.stamp == stamp
                || part.stamp > stamp && !holders(&self.heard, self.ticks, topic, part.stamp).is_empty()
        };
        if self.coming.get(&topic).is_some_and(better) {
            return Ok(Vec::new());
        }
        let replaced = self.coming.get(&topic).map_or(0, |part| part.manifest.length());
        if self.held_bytes() - replaced + manifest.length() > MAX_HELD_BYTES {
            return Err(Refused::TooMuch(MAX_HELD_BYTES));
        }
        self.keys.insert(robot, manifest.key);
        if is_own && let Some(own) = self.parts.get(&topic) {
            // Published before this robot was started again: what it has now is newer.
            let own = own.clone();
            self.publish_as(topic.1, stamp.0.saturating_add(1), &own.blocks());
            return Ok(Vec::new());
        }
        let before = [self.parts.get(&topic), self.coming.get(&topic)];
        let before: Vec<&Part> = before.into_iter().flatten().collect();
        let part = Part::new(manifest, &before);
        self.coming.insert(topic, part);
        Ok(self.go_on(from, topic))
    }

    fn serve(&self, to: RobotId, topic: Topic, stamp: Stamp, blocks: &[u16]) -> Vec<Outgoing> {
        let Some(part) = self.parts.get(&topic).filter(|part| part.stamp == stamp) else { return Vec::new() };
        let block = |index: &u16| {
            let bytes = part.block(*index)?.to_vec();
            Some(self.message(To::Robot(to), Body::Block { topic, stamp, index: *index, bytes }))
        };
        blocks.iter().filter_map(block).collect()
    }

    fn put(
        &mut self,
        from: RobotId,
        topic: Topic,
        stamp: Stamp,
        index: u16,
        bytes: Vec<u8>,
    ) -> Result<Vec<Outgoing>, Refused> {
        // A block of an older version, or one that came before, is late and no fault.
        let Some(part) = self.coming.get_mut(&topic).filter(|part| part.stamp == stamp) else {
            return Ok(Vec::new());
        };
        if !part.put(index, bytes) {
            return Err(Refused::Inconsistent("a block is not the one that its robot signed"));
        }
        Ok(self.go_on(from, topic))
    }

    /// Takes a part over when it is complete; otherwise asks for the next blocks when those asked for have come.
    fn go_on(&mut self, from: RobotId, topic: Topic) -> Vec<Outgoing> {
        let Some(part) = self.coming.get_mut(&topic) else { return Vec::new() };
        if part.is_complete() {
            if let Some(part) = self.coming.remove(&topic) {
                self.parts.insert(topic, part);
                if topic.1 == Layer::Map {
                    self.fetched.insert(topic.0, self.ticks);
                }
            }
            return Vec::new();
        }
        let blocks = if part.has_room() { part.next(self.ticks) } else { Vec::new() };
        if blocks.is_empty() {
            return Vec::new();
        }
        let want = Body::Want { topic, stamp: part.stamp, blocks };
        vec![self.message(To::Robot(from), want)]
    }
}

fn holding(part: &Part) -> Holding {
    let manifest = &part.manifest;
    Holding { robot: manifest.robot, version: manifest.version, bytes: manifest.length() }
}

/// The peers that have this version of a robot's words or map, and were heard lately.
fn holders(heard: &BTreeMap<RobotId, Heard>, now: usize, topic: Topic, stamp: Stamp) -> Vec<RobotId> {
    let here = |h: &Heard| h.has.get(&topic) == Some(&stamp) && now - h.tick <= SILENT_TICKS;
    heard.iter().filter(|(_, h)| here(h)).map(|(peer, _)| *peer).collect()
}
