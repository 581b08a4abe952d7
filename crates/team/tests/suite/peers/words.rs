//! Words of key frames go to all, maps only to those that want them.

use crate::peers::team::{Team, map, peer, received, robots, talk, with_words, words};
use cairn_team::peer::{BLOCK_BYTES, MAX_WORDS_PART_BYTES, MapSubscription};
use cairn_team::{NetworkConfig, Refused, RobotId};
use proptest::prelude::*;
use std::collections::BTreeSet;

#[test]
fn words_go_to_all_and_a_map_only_to_those_that_want_it() {
    let length = 6 * BLOCK_BYTES;
    let (mut a, mut b, mut c) = (with_words(1, length), with_words(2, length), with_words(3, length));
    talk(&mut [&mut a, &mut b, &mut c]);
    for p in [&a, &b, &c] {
        let has: Vec<(RobotId, Vec<u8>)> = p.words().map(|(holding, bytes)| (holding.robot, bytes)).collect();
        assert_eq!(has, [1, 2, 3].map(|robot| (robot, words(robot, 5))));
        assert_eq!(robots(p), [p.robot()]);
        assert_eq!(received(p, "block"), 0);
    }
    // Robots 1 and 2 share a place, robot 3 none with them.
    [&mut a, &mut b].into_iter().for_each(|p| p.subscribe(MapSubscription::Of([1, 2].into())));
    c.subscribe(MapSubscription::Of([3].into()));
    talk(&mut [&mut a, &mut b, &mut c]);
    assert_eq!((robots(&a), robots(&b), robots(&c)), (vec![1, 2], vec![1, 2], vec![3]));
    assert_eq!(a.digest(), b.digest());
    assert_eq!(received(&c, "block"), 0);
    let all: u64 = c.traffic().received.values().map(|amount| amount.bytes).sum();
    assert!(all < 20_000, "{all} bytes came to a robot that shares nothing");
    // It comes into a place of theirs when robot 1 has left already.
    drop(a);
    c.subscribe(MapSubscription::Of([1, 2, 3].into()));
    b.subscribe(MapSubscription::Of([1, 2, 3].into()));
    talk(&mut [&mut b, &mut c]);
    assert_eq!(robots(&c), [1, 2, 3]);
    assert_eq!(b.digest(), c.digest());
    // And out of it again: what it holds is no longer part of its atlas.
    c.subscribe(MapSubscription::Of([3].into()));
    assert_eq!(robots(&c), [3]);
}

#[test]
fn a_robot_that_leaves_knows_whether_its_words_were_judged_and_its_map_came() {
    let (mut a, mut b) = (with_words(1, 1000), with_words(2, 1000));
    talk(&mut [&mut a, &mut b]);
    // Robot 2 has the words, but has not looked at them.
    assert!(b.has_new_words() && !a.is_up_to_date(2));
    b.subscribe(MapSubscription::Of([1, 2].into()));
    a.receive(&b.tick()[0].bytes).unwrap();
    assert!(!b.has_new_words() && !a.is_up_to_date(2), "its map is wanted and has not come");
    // The manifest of before was lost, and is offered again after a while.
    (0..2).for_each(|_| talk(&mut [&mut a, &mut b]));
    assert!(a.is_up_to_date(2));
    assert!(!b.is_up_to_date(1), "robot 1 has not looked at the words of robot 2");
    a.subscribe(MapSubscription::Of([1].into()));
    talk(&mut [&mut a, &mut b]);
    assert!(b.is_up_to_date(1), "its map is not wanted");
    assert!(!a.is_up_to_date(7), "nobody was heard");
}

#[test]
fn a_map_that_is_saved_often_is_fetched_more_rarely_and_the_last_one_comes() {
    let blocks_of = |refresh: usize| {
        let (mut a, mut b) = (peer(1), peer(2).with_refresh(refresh));
        for version in 0..20 {
            a.publish(&(0..BLOCK_BYTES).map(|k| (k * version + version) as u8).collect::<Vec<_>>()).unwrap();
            talk(&mut [&mut a, &mut b]);
        }
        (0..4).for_each(|_| talk(&mut [&mut a, &mut b]));
        assert_eq!(a.digest(), b.digest());
        received(&b, "block") / BLOCK_BYTES as u64
    };
    // Four ticks from one version to the next: of 20 the first and then each third, and the last.
    assert_eq!((blocks_of(0), blocks_of(12)), (20, 8));
}

#[test]
fn words_that_are_too_long_are_not_published() {
    let mut a = peer(1);
    let long = vec![1; MAX_WORDS_PART_BYTES + 1];
    assert_eq!(a.publish_words(&long, &[long.len()]), Err(Refused::TooLong(long.len())));
    assert!(a.publish_words(&[], &[]).is_err() && a.publish_words(b"abc", &[2]).is_err());
    assert_eq!(a.words().count(), 0);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    /// Two groups: whatever the network does and in whichever order they learn of each other, all have all words in the
    /// end, those of a group the same maps, and nobody one of the other group.
    #[test]
    fn groups_end_with_their_own_maps(member in prop::collection::vec(any::<bool>(), 5), late: u8, seed: u64) {
        let mut team = Team::new(NetworkConfig {
            loss: 0.3, delayed: 0.4, delay_rounds: 3, duplicated: 0.3, seed,
        });
        for robot in 0..5 {
            team.peers.insert(robot, with_words(robot, 30_000).with_refresh(usize::from(robot)));
        }
        let group = |robot: RobotId| -> BTreeSet<RobotId> {
            let of = |r: RobotId| member[usize::from(r)];
            (0..5).filter(|r| of(*r) == of(robot)).collect()
        };
        for round in 0..200 {
            if round == 20 {
                for robot in 0..5 {
                    let version = 2 + u32::from(late % 7);
                    team.peers.get_mut(&robot).unwrap().publish(&map(robot, version, 40_000)).unwrap();
                }
            }
            for (robot, peer) in &mut team.peers {
                if peer.has_new_words() && round % (1 + usize::from(*robot)) == 0 {
                    peer.subscribe(MapSubscription::Of(group(*robot)));
                }
            }
            team.round();
        }
        for (robot, peer) in &team.peers {
            prop_assert_eq!(peer.words().count(), 5);
            let expected: Vec<RobotId> = group(*robot).into_iter().collect();
            prop_assert_eq!(robots(peer), expected);
            prop_assert!(!peer.is_fetching());
            for other in group(*robot) {
                prop_assert_eq!(peer.digest(), team.peers[&other].digest());
            }
        }
    }
}
