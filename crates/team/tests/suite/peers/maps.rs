//! Maps: whatever the network does, all have the same in the end, and nothing is believed that its robot did not sign.

use crate::peers::team::{Team, identity, map, peer, received, talk};
use cairn_random::Random;
use cairn_team::peer::{
    BLOCK_BYTES, Identity, MAX_PEER_MESSAGE_BYTES, Outgoing, Peer, PeerKind, RefusalLog, TeamKey,
};
use cairn_team::{NetworkConfig, Refused, RobotId};
use proptest::prelude::*;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

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

#[test]
fn one_that_comes_late_gets_also_what_a_robot_that_left_had_published() {
    let (mut a, mut b, mut c) = (peer(1), peer(2), peer(3));
    a.publish(&map(1, 1, 5 * BLOCK_BYTES)).unwrap();
    talk(&mut [&mut a, &mut b]);
    drop(a);
    talk(&mut [&mut b, &mut c]);
    assert_eq!(c.holdings().map(|h| h.robot).collect::<Vec<_>>(), [1]);
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
    assert_eq!(c.holdings().map(|h| h.version).collect::<Vec<_>>(), [1]);
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
        "the message has version 9, this program reads version 3"
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
    assert_eq!(b.holdings().next().unwrap().version, 3);
}

#[test]
fn refusals_are_said_once_then_ever_more_rarely() {
    let mut refusals = RefusalLog::default();
    let lines: Vec<String> = (0..1000).filter_map(|_| refusals.line(&Refused::Seal)).collect();
    assert_eq!(lines.len(), 4, "{lines:?}");
    assert!(lines[3].starts_with("1000 messages were refused"), "{lines:?}");
    assert!(refusals.line(&Refused::OwnId).is_some());
}

#[test]
fn what_is_late_is_not_asked_for_again() {
    // Every message takes one round more.
    let mut team =
        Team::new(NetworkConfig { loss: 0.0, delayed: 1.0, delay_rounds: 1, duplicated: 0.0, seed: 1 });
    let length = 40 * BLOCK_BYTES;
    team.publish(1, length);
    team.peers.insert(2, peer(2));
    let rounds = team.settle(60);
    let blocks = received(&team.peers[&2], "block");
    println!("{length} bytes after {rounds} rounds: {blocks} bytes of blocks");
    assert!(blocks < length as u64 + length as u64 / 50, "{blocks} bytes for {length}");
    let manifests =
        team.peers[&2].traffic().received.iter().filter(|((_, k), _)| k.to_string() == "manifest");
    let manifests: u64 = manifests.map(|(_, amount)| amount.messages).sum();
    assert!(manifests <= 1 + rounds as u64 / 4, "{manifests} manifests in {rounds} rounds");
}

/// Who may send no more than so much in a second sends a block now and then: it is not asked for those that wait there again.
#[test]
fn blocks_that_come_slowly_are_asked_for_once() {
    let (mut a, mut b) = (peer(1), peer(2));
    a.publish(&map(1, 1, 20 * BLOCK_BYTES)).unwrap();
    let (mut waiting, mut blocks) = (VecDeque::new(), 0);
    for second in 0..80 {
        let mut said: Vec<(RobotId, Outgoing)> = a.tick().into_iter().map(|m| (1, m)).collect();
        said.extend(b.tick().into_iter().map(|m| (2, m)));
        if second % 4 == 3 {
            said.extend(waiting.pop_front());
        }
        while let Some((from, message)) = said.pop() {
            let (to, other) = if from == 1 { (&mut b, 2) } else { (&mut a, 1) };
            let answers = to.receive(&message.bytes).unwrap().into_iter().map(|m| (other, m));
            let (slow, rest): (Vec<_>, Vec<_>) = answers.partition(|(_, m)| m.kind == PeerKind::Block);
            blocks += slow.len();
            waiting.extend(slow);
            said.extend(rest);
        }
    }
    assert_eq!(a.digest(), b.digest());
    assert_eq!(blocks, 20, "of 20");
}

#[test]
fn pieces_that_others_have_are_not_sent_again() {
    let (mut a, mut b) = (peer(1), peer(2));
    let piece = |k: usize| -> Vec<u8> { (0..9000).map(|i| (i * (2 * k + 1) + k) as u8).collect() };
    let publish = |a: &mut Peer, pieces: &[Vec<u8>]| {
        let lengths: Vec<usize> = pieces.iter().map(Vec::len).collect();
        a.publish_pieces(&pieces.concat(), &lengths).unwrap()
    };
    let mut pieces: Vec<Vec<u8>> = (0..100).map(piece).collect();
    publish(&mut a, &pieces);
    talk(&mut [&mut a, &mut b]);
    let first = received(&b, "block");
    // A new one in front moves all others, as a longer index does.
    pieces.insert(0, b"an index".to_vec());
    pieces.push(piece(100));
    pieces.push(piece(7));
    publish(&mut a, &pieces);
    talk(&mut [&mut a, &mut b]);
    assert_eq!(b.parts().next().unwrap().1, pieces.concat());
    assert!(received(&b, "block") - first < 10_000, "{first}, then {}", received(&b, "block"));
    // Pieces that are not what they say.
    assert!(a.publish_pieces(b"abc", &[2]).is_err() && a.publish_pieces(b"abc", &[2, 2]).is_err());
    assert!(a.publish_pieces(&[0; 5000], &[1; 5000]).is_err());
}

/// One round is a second: 30 % are lost, all others take a second, one robot is cut off for a minute while all go on
/// publishing, and a fourth one sends garbage, plays everything again and claims to be robot 1.
#[test]
fn loss_delay_a_minute_apart_garbage_replays_and_a_claimed_number_cost_nothing() {
    let mut team =
        Team::new(NetworkConfig { loss: 0.3, delayed: 1.0, delay_rounds: 1, duplicated: 0.0, seed: 8 });
    let length = 12 * BLOCK_BYTES;
    (1..=3).for_each(|robot| team.publish(robot, length));
    (0..3).for_each(|_| team.round());
    let mut liar = Peer::new(Identity::from_seed(1, &[77; 32]).unwrap(), TeamKey::new(b"a team"));
    for version in 0..9 {
        liar.publish(&map(7, version, 5000)).unwrap();
    }
    let (mut refusals, mut said, mut noise) = (RefusalLog::default(), Vec::new(), Random::new(1));
    let mut played: Vec<Arc<Vec<u8>>> = Vec::new();
    let mut most = 0;
    for second in 0..90 {
        team.island = if (10..70).contains(&second) { [2].into() } else { BTreeSet::new() };
        if second % 10 == 5 {
            (1..=3).for_each(|robot| team.publish(robot, length + second));
        }
        team.round();
        let robots: Vec<RobotId> = team.peers.keys().copied().collect();
        for robot in robots {
            let peer = team.peers.get_mut(&robot).unwrap();
            let own = peer.tick();
            let garbage = (0..200).map(|_| noise.below(256) as u8);
            let mut attack = vec![Arc::new(garbage.collect::<Vec<u8>>())];
            attack.extend(liar.receive(&own[0].bytes).into_iter().flatten().map(|m| m.bytes));
            attack.extend(played.iter().filter(|_| robot == 3).cloned());
            for bytes in attack {
                said.extend(peer.receive(&bytes).err().and_then(|why| refusals.line(&why)));
            }
            played.extend(own.into_iter().map(|m| m.bytes));
            most = most.max(peer.held_bytes());
        }
        let old = played.len().saturating_sub(40);
        played.drain(..old);
    }
    let rounds = team.settle(60);
    println!("the same {rounds} s after the last one; at most {most} bytes held; said: {said:#?}");
    assert_eq!(team.digests().len(), 1);
    // Three maps, and a newer one of each on its way.
    assert!(most <= 6 * (length + 100), "{most} bytes held");
    assert!(said.len() < 12, "{said:#?}");
    assert!(said.iter().any(|line| line.contains("robot 1")), "{said:#?}");
}
