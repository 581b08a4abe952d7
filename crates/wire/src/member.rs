//! A robot of a team on the network: the peer that decides, the wire that carries.

use crate::send_limit::SendLimit;
use crate::{Event, LinkId, Wire};
use cairn_team::RobotId;
use cairn_team::peer::{Outgoing, Peer, PeerKind, RefusalLog, To};
use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, ToSocketAddrs};
use std::time::{Duration, Instant};

/// How often a peer says what it has.
const TICK: Duration = Duration::from_secs(1);

/// A robot of a team on the network.
pub struct Member {
    peer: Peer,
    wire: Wire,
    /// Who was heard on which link last.
    robots: BTreeMap<LinkId, RobotId>,
    refusals: RefusalLog,
    next_tick: Instant,
    /// What waits so that no more than so much is sent in a second.
    limit: Option<SendLimit>,
}

impl Member {
    /// Listens on an address and dials others.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn open(peer: Peer, listen: impl ToSocketAddrs, dial: &[String]) -> io::Result<Self> {
        let wire = Wire::open(listen, dial)?;
        let refusals = RefusalLog::default();
        let next_tick = Instant::now();
        Ok(Self { peer, wire, robots: BTreeMap::new(), refusals, next_tick, limit: None })
    }

    /// Sends no more than so many bytes in a second, over all links together, as far as that is up to maps: their blocks wait until
    /// there is room beside words and what is said of versions, which go at once.
    #[must_use]
    pub fn with_send_limit(self, bytes_per_s: f64) -> Self {
        Self { limit: Some(SendLimit::new(bytes_per_s, Instant::now())), ..self }
    }

    /// The address that is listened on.
    pub fn address(&self) -> SocketAddr {
        self.wire.address()
    }

    /// The peer.
    pub fn peer(&self) -> &Peer {
        &self.peer
    }

    /// The peer, to publish with.
    pub fn peer_mut(&mut self) -> &mut Peer {
        &mut self.peer
    }

    /// Robots that are heard now.
    pub fn reached(&self) -> impl Iterator<Item = RobotId> {
        self.ways().into_keys()
    }

    /// Messages that were refused so far.
    pub fn refused(&self) -> u64 {
        self.refusals.count()
    }

    /// Exchanges messages for about this long; returns what a user should know, a line each.
    pub fn step(&mut self, time: Duration) -> Vec<String> {
        let until = Instant::now() + time;
        let mut lines = Vec::new();
        loop {
            let now = Instant::now();
            if now >= self.next_tick {
                self.next_tick = now + TICK;
                let out = self.peer.tick();
                self.send(out);
            }
            self.send_waiting(now);
            if now >= until {
                return lines;
            }
            let next = self.limit.as_ref().and_then(|limit| limit.next_at(now)).unwrap_or(until);
            let wait = until.min(self.next_tick).min(next).saturating_duration_since(now);
            match self.wire.next(wait) {
                // Says at once what it has.
                Some(Event::Opened(..)) => self.next_tick = now,
                Some(Event::Message(link, bytes)) => lines.extend(self.take(link, &bytes)),
                Some(Event::Closed(link, why)) => {
                    let robot = self.robots.remove(&link);
                    // Two robots that dial each other have two links, of which one falls silent.
                    let still = robot.is_some_and(|robot| self.reached().any(|other| other == robot));
                    lines.extend(why.filter(|_| !still).map(|why| match robot {
                        Some(robot) => format!("the link to robot {robot} was closed: {why}"),
                        None => format!("a link was closed: {why}"),
                    }));
                }
                None => {}
            }
        }
    }

    fn take(&mut self, link: LinkId, bytes: &[u8]) -> Option<String> {
        match self.peer.receive_from(bytes) {
            Ok((from, answers)) => {
                self.wire.know(link);
                self.robots.insert(link, from);
                self.send(answers);
                None
            }
            Err(why) => self.refusals.line(&why),
        }
    }

    /// For each robot the newest link to it.
    fn ways(&self) -> BTreeMap<RobotId, LinkId> {
        self.robots.iter().map(|(link, robot)| (*robot, *link)).collect()
    }

    /// Sends messages; blocks of maps wait for their turn where there is a limit.
    fn send(&mut self, out: Vec<Outgoing>) {
        for message in out {
            match &mut self.limit {
                Some(limit) if message.kind == PeerKind::Block => limit.wait(message),
                _ => self.send_now(&message),
            }
        }
    }

    /// Sends the blocks that waited and whose turn it is.
    fn send_waiting(&mut self, now: Instant) {
        while let Some(message) = self.limit.as_mut().and_then(|limit| limit.take(now)) {
            self.send_now(&message);
        }
    }

    /// Sends a message on each link that it is for, and counts it as often.
    fn send_now(&mut self, message: &Outgoing) {
        let ways = self.ways();
        let unknown = || self.wire.links().into_iter().filter(|link| !self.robots.contains_key(link));
        let links: Vec<LinkId> = match message.to {
            To::All => ways.values().copied().chain(unknown()).collect(),
            To::Robot(robot) => ways.get(&robot).copied().into_iter().collect(),
        };
        for _ in links.into_iter().filter(|link| self.wire.send(*link, &message.bytes)) {
            self.peer.sent(message);
            if let Some(limit) = &mut self.limit {
                limit.sent(message.bytes.len());
            }
        }
    }
}
