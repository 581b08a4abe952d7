//! Peers on a network, with maps and words.

use cairn_team::peer::{Identity, MapSubscription, Outgoing, Peer, TeamKey, To};
use cairn_team::{Network, NetworkConfig, RobotId};
use std::collections::{BTreeMap, BTreeSet};

pub fn identity(robot: RobotId) -> Identity {
    Identity::from_seed(robot, &[robot as u8 + 1; 32]).expect("a seed of 32 bytes")
}

pub fn peer(robot: RobotId) -> Peer {
    Peer::new(identity(robot), TeamKey::new(b"a team"))
}

/// Some bytes: of one robot mostly the same from version to version, as a map that grows.
pub fn map(robot: RobotId, version: u32, length: usize) -> Vec<u8> {
    let fixed = |k: usize| (k / 251 + k * usize::from(robot + 1)) as u8;
    (0..length).map(|k| if k < 9 { version as u8 ^ k as u8 } else { fixed(k) }).collect()
}

/// Several peers on one network that loses, delays and repeats.
pub struct Team {
    pub peers: BTreeMap<RobotId, Peer>,
    pub network: Network,
    /// Robots that can only hear each other.
    pub island: BTreeSet<RobotId>,
    pub latest: BTreeMap<RobotId, Vec<u8>>,
}

impl Team {
    pub fn new(network: NetworkConfig) -> Self {
        Self {
            peers: BTreeMap::new(),
            network: Network::new(network),
            island: BTreeSet::new(),
            latest: BTreeMap::new(),
        }
    }

    pub fn publish(&mut self, robot: RobotId, length: usize) {
        let peer = self.peers.entry(robot).or_insert_with(|| peer(robot));
        let bytes = map(robot, self.latest.get(&robot).map_or(0, |b| u32::from(b[0])) + 1, length);
        peer.publish(&bytes).expect("short enough");
        self.latest.insert(robot, bytes);
    }

    pub fn send(&mut self, from: RobotId, out: Vec<Outgoing>) {
        for message in out {
            let to: Vec<RobotId> = match message.to {
                To::All => self.peers.keys().copied().filter(|r| *r != from).collect(),
                To::Robot(robot) => vec![robot],
            };
            for robot in to {
                if self.island.contains(&from) == self.island.contains(&robot) {
                    self.peers.get_mut(&from).expect("a peer").sent(&message);
                    self.network.send(from, robot, &message.bytes);
                }
            }
        }
    }

    pub fn round(&mut self) {
        let robots: Vec<RobotId> = self.peers.keys().copied().collect();
        for robot in &robots {
            let out = self.peers.get_mut(robot).expect("a peer").tick();
            self.send(*robot, out);
        }
        for packet in self.network.deliver() {
            let Some(peer) = self.peers.get_mut(&packet.to) else { continue };
            let out = peer.receive(&packet.bytes).expect("honest peers are believed");
            self.send(packet.to, out);
        }
    }

    /// Rounds until everyone has the latest of everyone.
    pub fn settle(&mut self, most: usize) -> usize {
        for round in 0..most {
            if self.is_settled() {
                return round;
            }
            self.round();
        }
        panic!("not the same after {most} rounds");
    }

    pub fn is_settled(&self) -> bool {
        self.peers.values().all(|peer| {
            let has: BTreeMap<RobotId, Vec<u8>> = peer.parts().map(|(h, bytes)| (h.robot, bytes)).collect();
            has == self.latest
        })
    }

    pub fn digests(&self) -> BTreeSet<[u8; 8]> {
        self.peers.values().map(Peer::digest).collect()
    }
}

/// Delivers everything among peers at once, without loss, until nothing is said any more.
pub fn talk(peers: &mut [&mut Peer]) {
    for _ in 0..4 {
        let mut waiting: Vec<(RobotId, Outgoing)> = peers
            .iter_mut()
            .flat_map(|p| p.tick().into_iter().map(|m| (p.robot(), m)).collect::<Vec<_>>())
            .collect();
        while let Some((from, message)) = waiting.pop() {
            for p in peers.iter_mut().filter(|p| p.robot() != from) {
                if message.to == To::All || message.to == To::Robot(p.robot()) {
                    let answers = p.receive(&message.bytes).unwrap();
                    waiting.extend(answers.into_iter().map(|m| (p.robot(), m)));
                }
            }
        }
    }
}

pub fn words(robot: RobotId, key_frames: usize) -> Vec<u8> {
    (0..900 * key_frames).map(|k| (k * 7 + usize::from(robot)) as u8).collect()
}

/// A peer with words and a map, which so far wants no map of others.
pub fn with_words(robot: RobotId, length: usize) -> Peer {
    let mut peer = peer(robot);
    peer.subscribe(MapSubscription::Of(BTreeSet::new()));
    let words = words(robot, 5);
    peer.publish_words(&words, &[words.len()]).unwrap();
    peer.publish(&map(robot, 1, length)).unwrap();
    peer
}

pub fn robots(peer: &Peer) -> Vec<RobotId> {
    peer.holdings().map(|holding| holding.robot).collect()
}

/// Bytes of one kind of message that a peer has received.
pub fn received(peer: &Peer, what: &str) -> u64 {
    let of = peer.traffic().received.iter().filter(|((_, kind), _)| kind.to_string() == what);
    of.map(|(_, amount)| amount.bytes).sum()
}
