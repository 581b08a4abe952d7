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
//! A robot publishes the bags of words of its key frames, a kilobyte each, which everyone gets, and its map,
//! which only those get that want it ([`Peer::subscribe`]); where robots agree on a pose graph made of their maps, features of some
//! key frames ([`Peer::publish_places`]) and, in place of the map, the graph. Whom a robot shares a place with follows from the words alone, and
//! so every robot comes to the same answer (Cieslewski et al., "Data-efficient decentralized visual SLAM", 2018, and
//! Lajoie et al., "DOOR-SLAM", 2020, exchange in this order).
//!
//! There is no clock, no thread and no chance here; a driver calls [`Peer::tick`] about once a second.

mod exchange;
mod message;
mod part;
mod publish;
mod refusal_log;
mod seal;
mod traffic;

pub use message::{
    BLOCK_BYTES, MAX_PART_BYTES, MAX_PEER_MESSAGE_BYTES, MAX_PLACES_PART_BYTES, MAX_WORDS_PART_BYTES,
    MapSubscription, PeerKind,
};
pub use refusal_log::RefusalLog;
pub use seal::{Identity, IdentityError, TeamKey};
pub use traffic::{Amount, Traffic};

use crate::{MAX_ROBOTS, PlaceRequests, Refused, RobotId};
use message::{Body, Layer, PeerMessage, Stamp, Topic};
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
    wants: MapSubscription,
    tick: usize,
}

impl Default for Heard {
    fn default() -> Self {
        Self { has: BTreeMap::new(), wants: MapSubscription::Of(BTreeSet::new()), tick: 0 }
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
    subscription: MapSubscription,
    /// A map is not fetched again for so many ticks, and at which tick each was complete.
    refresh_ticks: usize,
    fetched: BTreeMap<RobotId, usize>,
    /// With [`Peer::subscribe`]: the words that were there then; others are not said to be here yet.
    judged: Option<BTreeMap<RobotId, Stamp>>,
    /// The features of each robot that were compared with the own map; others are not said to be here yet.
    compared: BTreeMap<RobotId, u32>,
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
            subscription: MapSubscription::All,
            refresh_ticks: 0,
            fetched: BTreeMap::new(),
            judged: None,
            compared: BTreeMap::new(),
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
    pub fn subscribe(&mut self, subscription: MapSubscription) {
        self.judged = match subscription {
            MapSubscription::All => None,
            MapSubscription::Of(_) => Some(self.word_stamps().collect()),
        };
        self.subscription = subscription;
        let robot = self.robot();
        let subscription = &self.subscription;
        self.coming.retain(|(r, layer), _| *r == robot || layer.goes_to(robot, *r, subscription));
    }

    /// Whose maps are fetched.
    pub fn subscription(&self) -> &MapSubscription {
        &self.subscription
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

    /// What it says to have: words only once they were judged, and features once they were compared.
    fn said(&self) -> Vec<(Topic, Stamp)> {
        let is_said = |(robot, layer): &Topic, stamp: &Stamp| match layer {
            _ if *robot == self.robot() => true,
            Layer::Words => self.judged.as_ref().is_none_or(|judged| judged.get(robot) == Some(stamp)),
            Layer::Places => self.compared.get(robot) == Some(&stamp.0),
            Layer::Map | Layer::Requests => true,
        };
        let all = self.parts.iter().map(|(topic, part)| (*topic, part.stamp));
        all.filter(|(topic, stamp)| is_said(topic, stamp)).collect()
    }

    /// Whose maps it would fetch now: those wanted, and not so soon after the last time.
    fn due(&self) -> MapSubscription {
        let rests = |robot: &RobotId| {
            let since = |tick: &usize| self.ticks.saturating_sub(*tick);
            self.fetched.get(robot).is_some_and(|tick| since(tick) < self.refresh_ticks)
        };
        let known = self.heard.values().flat_map(|heard| heard.has.keys()).map(|(robot, _)| *robot);
        let robots = known.filter(|robot| self.subscription.includes(*robot) && !rests(robot));
        match self.subscription {
            MapSubscription::All if self.refresh_ticks == 0 => MapSubscription::All,
            _ => MapSubscription::Of(robots.chain([self.robot()]).take(MAX_ROBOTS).collect()),
        }
    }

    fn word_stamps(&self) -> impl Iterator<Item = (RobotId, Stamp)> {
        let words = self.parts.iter().filter(|((_, layer), _)| *layer == Layer::Words);
        words.map(|((robot, _), part)| (*robot, part.stamp))
    }

    /// Whether words came that [`Peer::subscribe`] has not judged.
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
        let message = PeerMessage::decode(&self.team.open(bytes)?)?;
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

    /// What those are, without their bytes.
    pub fn holdings(&self) -> impl Iterator<Item = Holding> {
        self.maps().map(holding)
    }

    /// The newest map of one robot, complete and wanted; `None` where there is none.
    pub fn part_of(&self, robot: RobotId) -> Option<Vec<u8>> {
        self.maps().find(|part| part.manifest.robot == robot).map(Part::bytes)
    }

    /// The newest complete words of each robot, by robot.
    pub fn words(&self) -> impl Iterator<Item = (Holding, Vec<u8>)> {
        let words = self.parts.iter().filter(|((_, layer), _)| *layer == Layer::Words);
        words.map(|(_, part)| (holding(part), part.bytes()))
    }

    /// Of which robots there are complete features of key frames that look like what this robot saw: those of smaller numbers whose
    /// maps are wanted ([`Peer::publish_places`]).
    pub fn places(&self) -> impl Iterator<Item = Holding> {
        let own = self.robot();
        let listed = move |(robot, layer): &Topic| {
            *layer == Layer::Places && *robot != own && layer.goes_to(own, *robot, &self.subscription)
        };
        self.parts.iter().filter(move |(topic, _)| listed(topic)).map(|(_, part)| holding(part))
    }

    /// These features of one robot; `None` where there are none.
    pub fn places_of(&self, robot: RobotId) -> Option<Vec<u8>> {
        self.parts.get(&(robot, Layer::Places)).map(Part::bytes)
    }

    /// Says that features of this version were compared with the own map, and that what follows from that was published: their robot
    /// can rely on it, and leave.
    pub fn compared_places(&mut self, of: &Holding) {
        self.compared.insert(of.robot, of.version);
    }

    /// What robots of greater numbers whose maps are wanted ask for, with its version; an error where that is not valid.
    pub fn requests(&self) -> impl Iterator<Item = (Holding, Result<PlaceRequests, Refused>)> {
        let own = self.robot();
        let listed = move |(robot, layer): &Topic| {
            *layer == Layer::Requests && *robot != own && layer.goes_to(own, *robot, &self.subscription)
        };
        let listed = self.parts.iter().filter(move |(topic, _)| listed(topic));
        listed.map(|((robot, _), part)| (holding(part), PlaceRequests::decode(*robot, &part.bytes())))
    }

    fn maps(&self) -> impl Iterator<Item = &Part> {
        let own = self.robot();
        let listed = move |(robot, layer): &Topic| {
            *layer == Layer::Map && (*robot == own || self.subscription.includes(*robot))
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
        let looks = Layer::Places.goes_to(other, self.robot(), &heard.wants);
        let has_places = !looks || own(Layer::Places).is_none() || own(Layer::Places) == has(Layer::Places);
        let has_map = own(Layer::Map) == has(Layer::Map) || is_without && own(Layer::Words).is_some();
        has_words && has_places && has_map
    }

    /// Whether another peer published something for this one, as it said last, that has not come.
    pub fn is_behind(&self, other: RobotId) -> bool {
        let Some(heard) = self.heard.get(&other) else { return false };
        let goes = |layer: &Layer| layer.goes_to(self.robot(), other, &self.subscription);
        let has = |layer| self.parts.get(&(other, layer)).map(|part| part.stamp);
        let published = heard.has.iter().filter(|((robot, layer), _)| *robot == other && goes(layer));
        published.into_iter().any(|((_, layer), stamp)| has(*layer).is_none_or(|held| held < *stamp))
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
