//! Peers that share what they published: whatever the network does, all have the same in the end, and nothing is
//! believed that its robot did not sign.

use cairn_team::peer::{
    BLOCK_BYTES, Complaints, Identity, MAX_PEER_MESSAGE_BYTES, Outgoing, Peer, TeamKey, To,
};
use cairn_team::{Network, NetworkConfig, Refused, RobotId};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

fn identity(robot: RobotId) -> Identity {
    Identity::from_seed(robot, &[robot as u8 + 1; 32]).expect("a seed of 32 bytes")
}

fn peer(robot: RobotId) -> Peer {
    Peer::new(identity(robot), TeamKey::new(b"a team"))
}

/// Some bytes: of one robot mostly the same from version to version, as a map that grows.
fn map(robot: RobotId, version: u32, length: usize) -> Vec<u8> {
    let fixed = |k: usize| (k / 251 + k * usize::from(robot + 1)) as u8;
    (0..length).map(|k| if k < 9 { version as u8 ^ k as u8 } else { fixed(k) }).collect()
}

/// Several peers on one network that loses, delays and repeats.
struct Team {
    peers: BTreeMap<RobotId, Peer>,
    network: Network,
    /// Robots that can only hear each other.
    island: BTreeSet<RobotId>,
    latest: BTreeMap<RobotId, Vec<u8>>,
}

impl Team {
    fn new(network: NetworkConfig) -> Self {
        Self {
            peers: BTreeMap::new(),
            network: Network::new(network),
            island: BTreeSet::new(),
            latest: BTreeMap::new(),
        }
    }

    fn publish(&mut self, robot: RobotId, length: usize) {
        let peer = self.peers.entry(robot).or_insert_with(|| peer(robot));
        let bytes = map(robot, self.latest.get(&robot).map_or(0, |b| u32::from(b[0])) + 1, length);
        peer.publish(&bytes).expect("short enough");
        self.latest.insert(robot, bytes);
    }

    fn send(&mut self, from: RobotId, out: Vec<Outgoing>) {
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

    fn round(&mut self) {
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
    fn settle(&mut self, most: usize) -> usize {
        for round in 0..most {
            if self.is_settled() {
                return round;
            }
            self.round();
        }
        panic!("not the same after {most} rounds");
    }

    fn is_settled(&self) -> bool {
        self.peers.values().all(|peer| {
            let has: BTreeMap<RobotId, Vec<u8>> = peer.parts().map(|(h, bytes)| (h.robot, bytes)).collect();
            has == self.latest
        })
    }

    fn digests(&self) -> BTreeSet<[u8; 8]> {
        self.peers.values().map(Peer::digest).collect()
    }
}

#[derive(Clone, Debug)]
enum Event {
    Publish(RobotId, usize),
    /// Killed, and started again with nothing but its key.
    Restart(RobotId),
    Part(BTreeSet<RobotId>),
    Heal,
    Rounds(usize),
}

fn event() -> impl Strategy<Value = Event> {
    let robot = 0..4u16;
    prop_oneof![
        (robot.clone(), 1..5 * BLOCK_BYTES).prop_map(|(r, n)| Event::Publish(r, n + 9)),
        robot.clone().prop_map(Event::Restart),
        prop::collection::btree_set(robot, 0..3).prop_map(Event::Part),
        Just(Event::Heal),
        (1..4usize).prop_map(Event::Rounds),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_order_loss_and_repetition_ends_in_the_same(events in prop::collection::vec(event(), 1..14), seed: u64) {
        let network = NetworkConfig { loss: 0.3, delayed: 0.4, delay_rounds: 3, duplicated: 0.3, seed };
        let mut team = Team::new(network);
        (0..4).for_each(|robot| team.publish(robot, 20_000));
        for event in events {
            match event {
                Event::Publish(robot, length) => team.publish(robot, length),
                Event::Restart(robot) => {
                    // It finds its map in its file again, as a program does.
                    let mut again = peer(robot);
                    again.publish(&team.latest[&robot]).unwrap();
                    team.peers.insert(robot, again);
                }
                Event::Part(island) => team.island = island,
                Event::Heal => team.island.clear(),
                Event::Rounds(n) => (0..n).for_each(|_| team.round()),
            }
        }
        team.island.clear();
        team.settle(300);
        prop_assert_eq!(team.digests().len(), 1);
        prop_assert!(team.peers.values().all(|peer| !peer.is_fetching()));
    }

    #[test]
    fn garbage_is_refused_and_changes_nothing(bytes in prop::collection::vec(any::<u8>(), 0..400), flip: u16) {
        let mut a = peer(1);
        a.publish(&map(1, 1, 1000)).unwrap();
        let before = a.digest();
        prop_assert!(a.receive(&bytes).is_err());
        // A real message with one bit changed.
        let mut b = peer(2);
        b.publish(&map(2, 1, 1000)).unwrap();
        let mut real = b.tick()[0].bytes.to_vec();
        let at = usize::from(flip) % (real.len() * 8);
        real[at / 8] ^= 1 << (at % 8);
        prop_assert!(a.receive(&real).is_err());
        prop_assert_eq!(a.digest(), before);
        prop_assert!(!a.is_fetching());
    }
}

/// Delivers everything among peers at once, without loss, until nothing is said any more.
fn talk(peers: &mut [&mut Peer]) {
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

#[test]
fn one_that_comes_late_gets_also_what_a_robot_that_left_had_published() {
    let (mut a, mut b, mut c) = (peer(1), peer(2), peer(3));
    a.publish(&map(1, 1, 5 * BLOCK_BYTES)).unwrap();
    talk(&mut [&mut a, &mut b]);
    drop(a);
    talk(&mut [&mut b, &mut c]);
    assert_eq!(c.parts().map(|(h, _)| h.robot).collect::<Vec<_>>(), [1]);
    assert_eq!(b.digest(), c.digest());
}

#[test]
fn a_robot_that_leaves_in_the_middle_of_a_transfer_leaves_its_last_whole_map() {
    let (mut a, mut b, mut c) = (peer(1), peer(2), peer(3));
    a.publish(&map(1, 1, 3 * BLOCK_BYTES)).unwrap();
    talk(&mut [&mut a, &mut b]);
    let whole = b.digest();
    a.publish(&map(1, 2, 4 * BLOCK_BYTES)).unwrap();
    // The third hears of the newer map, and then its robot is gone.
    let have = a.tick().remove(0);
    let ask = |c: &mut Peer| c.tick().remove(0).bytes;
    c.receive(&have.bytes).unwrap();
    let manifest = a.receive(&ask(&mut c)).unwrap().remove(0);
    c.receive(&manifest.bytes).unwrap();
    assert!(c.is_fetching());
    drop(a);
    (0..4).for_each(|_| talk(&mut [&mut b, &mut c]));
    assert_eq!(c.digest(), whole);
    assert_eq!(c.parts().map(|(h, _)| h.version).collect::<Vec<_>>(), [1]);
}

#[test]
fn a_new_version_sends_only_the_blocks_that_changed() {
    let (mut a, mut b) = (peer(1), peer(2));
    a.publish(&map(1, 1, 20 * BLOCK_BYTES)).unwrap();
    talk(&mut [&mut a, &mut b]);
    let block_bytes = |b: &Peer| {
        b.traffic()
            .received
            .iter()
            .filter(|((_, kind), _)| kind.to_string() == "block")
            .map(|(_, n)| n.bytes)
            .sum::<u64>()
    };
    let first = block_bytes(&b);
    a.publish(&map(1, 2, 20 * BLOCK_BYTES)).unwrap();
    talk(&mut [&mut a, &mut b]);
    assert_eq!(a.digest(), b.digest());
    assert!(block_bytes(&b) - first < 2 * BLOCK_BYTES as u64, "{} then {}", first, block_bytes(&b));
    assert_eq!(b.held_bytes(), 20 * BLOCK_BYTES);
}

#[test]
fn nobody_can_speak_for_another_robot() {
    let team = || TeamKey::new(b"a team");
    let (mut a, mut b) = (peer(1), peer(2));
    a.publish(&map(1, 1, 1000)).unwrap();
    talk(&mut [&mut a, &mut b]);
    let before = b.digest();
    // One of the team that has the team's key, but not the key of robot 1.
    let mut liar = Peer::new(Identity::from_seed(1, &[77; 32]).unwrap(), team());
    for _ in 0..5 {
        liar.publish(&map(9, 1, 1000)).unwrap();
        liar.publish(&map(9, 2, 1000)).unwrap();
    }
    let manifest = liar.receive(&b.tick()[0].bytes).unwrap().remove(0);
    assert_eq!(b.receive(&manifest.bytes).unwrap_err(), Refused::OtherKey(1));
    // To robot 1 itself it is a message in its own name.
    assert_eq!(a.receive(&manifest.bytes).unwrap_err(), Refused::OwnId);
    assert_eq!(b.digest(), before);
    // Of another team, and of another version.
    let stranger = Peer::new(identity(3), TeamKey::new(b"another team")).tick().remove(0);
    assert_eq!(b.receive(&stranger.bytes).unwrap_err(), Refused::Seal);
    let mut newer = a.tick()[0].bytes.to_vec();
    newer[0] = 9;
    assert_eq!(
        b.receive(&newer).unwrap_err().to_string(),
        "the message has version 9, this program reads version 1"
    );
    assert!(matches!(b.receive(&vec![1; MAX_PEER_MESSAGE_BYTES + 1]), Err(Refused::TooLong(_))));
}

#[test]
fn an_old_message_played_again_takes_nothing_back() {
    let (mut a, mut b) = (peer(1), peer(2));
    a.publish(&map(1, 1, 1000)).unwrap();
    let mut heard: Vec<Arc<Vec<u8>>> = vec![a.tick().remove(0).bytes];
    let manifest = a.receive(&b.tick()[0].bytes).unwrap().remove(0).bytes;
    let want = b.receive(&manifest).unwrap().remove(0).bytes;
    heard.extend([manifest, a.receive(&want).unwrap().remove(0).bytes]);
    b.receive(&heard[2]).unwrap();
    a.publish(&map(1, 2, 1000)).unwrap();
    talk(&mut [&mut a, &mut b]);
    let newest = b.digest();
    for old in heard.iter().chain(&heard) {
        let answers = b.receive(old).unwrap();
        assert!(answers.iter().all(|m| m.kind.to_string() == "manifest"), "{answers:?}");
    }
    assert_eq!(b.digest(), newest);
    assert!(!b.is_fetching());
}

#[test]
fn a_robot_killed_without_its_file_gets_its_map_back_from_the_others() {
    let (mut a, mut b) = (peer(1), peer(2));
    a.publish(&map(1, 1, 3000)).unwrap();
    a.publish(&map(1, 2, 3000)).unwrap();
    talk(&mut [&mut a, &mut b]);
    let mut again = peer(1);
    talk(&mut [&mut again, &mut b]);
    assert_eq!(again.digest(), b.digest());
    assert_eq!(again.publish(&map(1, 3, 3000)).unwrap(), 3);
    talk(&mut [&mut again, &mut b]);
    assert_eq!(b.parts().next().unwrap().0.version, 3);
}

#[test]
fn refusals_are_said_once_then_ever_more_rarely() {
    let mut complaints = Complaints::default();
    let lines: Vec<String> = (0..1000).filter_map(|_| complaints.line(&Refused::Seal)).collect();
    assert_eq!(lines.len(), 4, "{lines:?}");
    assert!(lines[3].starts_with("1000 messages were refused"), "{lines:?}");
    assert!(complaints.line(&Refused::OwnId).is_some());
}
