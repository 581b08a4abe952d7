//! A robot of a team on the network: the peer that decides, the wire that carries.

use crate::{Event, LinkId, Wire};
use cairn_team::RobotId;
use cairn_team::peer::{Outgoing, Peer, RefusalLog, To};
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
    complaints: RefusalLog,
    next_tick: Instant,
}

impl Member {
    /// Listens on an address and dials others.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn open(peer: Peer, listen: impl ToSocketAddrs, dial: &[String]) -> io::Result<Self> {
        let wire = Wire::open(listen, dial)?;
        let complaints = RefusalLog::default();
        Ok(Self { peer, wire, robots: BTreeMap::new(), complaints, next_tick: Instant::now() })
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
        self.complaints.count()
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
                self.send(&out);
            }
            if now >= until {
                return lines;
            }
            let wait = until.min(self.next_tick).saturating_duration_since(now);
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
                self.robots.insert(link, from);
                self.send(&answers);
                None
            }
            Err(why) => self.complaints.line(&why),
        }
    }

    /// For each robot the newest link to it.
    fn ways(&self) -> BTreeMap<RobotId, LinkId> {
        self.robots.iter().map(|(link, robot)| (*robot, *link)).collect()
    }

    fn send(&mut self, out: &[Outgoing]) {
        let ways = self.ways();
        let unknown = || self.wire.links().into_iter().filter(|link| !self.robots.contains_key(link));
        let mut sent = Vec::new();
        for message in out {
            let links: Vec<LinkId> = match message.to {
                To::All => ways.values().copied().chain(unknown()).collect(),
                To::Robot(robot) => ways.get(&robot).copied().into_iter().collect(),
            };
            sent.extend(links.iter().filter(|link| self.wire.send(**link, &message.bytes)).map(|_| message));
        }
        sent.into_iter().for_each(|message| self.peer.sent(message));
    }
}
