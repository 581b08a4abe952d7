//! Features of key frames that look alike go to robots of greater numbers that want the map, and to no others.

use crate::peers::team::{received, talk, with_words};
use cairn_team::peer::{BLOCK_BYTES, MAX_PLACES_PART_BYTES, MapSubscription, Peer};
use cairn_team::{MAX_REQUESTED, PlaceRequests, RobotId};
use std::collections::{BTreeMap, BTreeSet};

fn has(peer: &Peer) -> Vec<RobotId> {
    peer.places().map(|holding| holding.robot).collect()
}

fn compare(peer: &mut Peer) {
    let all: Vec<_> = peer.places().collect();
    all.iter().for_each(|holding| peer.compared_places(holding));
}

fn features(robot: RobotId) -> Vec<u8> {
    (0..3 * BLOCK_BYTES).map(|k| (k * 3 + k / 97 + usize::from(robot)) as u8).collect()
}

fn with_places(robot: RobotId, wants: &[RobotId]) -> Peer {
    let mut peer = with_words(robot, 1000);
    let bytes = features(robot);
    peer.publish_places(&bytes, &[bytes.len()]).expect("short enough");
    peer.subscribe(MapSubscription::Of(wants.iter().copied().collect()));
    peer
}

#[test]
fn features_go_to_greater_numbers_that_want_the_map() {
    let (mut a, mut b, mut c, mut d) = (
        with_places(1, &[1, 2, 3]),
        with_places(2, &[1, 2, 3]),
        with_places(3, &[1, 2, 3]),
        with_places(4, &[4]),
    );
    assert!(!a.is_up_to_date(2));
    talk(&mut [&mut a, &mut b, &mut c, &mut d]);
    for p in [&mut a, &mut b, &mut c, &mut d] {
        let wants = p.subscription().clone();
        p.subscribe(wants);
    }
    talk(&mut [&mut a, &mut b, &mut c, &mut d]);
    assert_eq!([&a, &b, &c, &d].map(has), [vec![], vec![1], vec![1, 2], vec![]]);
    assert_eq!(c.places_of(2), Some(features(2)));
    assert!(!a.is_up_to_date(2) && !a.is_up_to_date(3), "nobody has compared its features");
    [&mut b, &mut c].into_iter().for_each(compare);
    talk(&mut [&mut a, &mut b, &mut c, &mut d]);
    assert_eq!((received(&a, "places"), received(&d, "places")), (0, 0));
    // Robot 1 needs nothing of robot 3, and robot 4 nothing of anybody.
    assert!(a.is_up_to_date(2) && a.is_up_to_date(3) && a.is_up_to_date(4) && c.is_up_to_date(1));
}

fn asked(peer: &Peer) -> Vec<(RobotId, PlaceRequests)> {
    peer.requests().map(|(holding, requests)| (holding.robot, requests.expect("valid"))).collect()
}

#[test]
fn what_is_asked_for_goes_to_smaller_numbers_and_is_waited_for() {
    let (mut a, mut b, mut c) =
        (with_places(1, &[1, 2, 3]), with_places(2, &[1, 2, 3]), with_places(3, &[1, 2, 3]));
    for _ in 0..3 {
        talk(&mut [&mut a, &mut b, &mut c]);
        for p in [&mut a, &mut b, &mut c] {
            let wants = p.subscription().clone();
            p.subscribe(wants);
            compare(p);
        }
    }
    let requests = PlaceRequests(BTreeMap::from([(1, BTreeSet::from([4, 8, 15]))]));
    b.publish_requests(&requests).expect("few enough");
    // Robot 1 hears that there is something, before it comes.
    let have = b.tick().remove(0);
    a.receive(&have.bytes).unwrap();
    assert!(a.is_behind(2) && !a.is_behind(3) && !a.is_behind(7));
    (0..2).for_each(|_| talk(&mut [&mut a, &mut b, &mut c]));
    assert_eq!((asked(&a), asked(&b), asked(&c)), (vec![(2, requests.clone())], vec![], vec![]));
    assert!(!a.is_behind(2));
    // Robot 2 has left; who comes after it learns from robot 1 nothing that is not for it.
    drop(b);
    let mut d = with_places(4, &[1, 2, 3, 4]);
    (0..2).for_each(|_| talk(&mut [&mut a, &mut c, &mut d]));
    assert_eq!(asked(&d), []);
    let too_much = PlaceRequests(BTreeMap::from([(1, (0..=MAX_REQUESTED as u32).collect())]));
    assert!(d.publish_requests(&too_much).is_err());
}

#[test]
fn a_robot_that_is_started_again_publishes_above_what_it_had() {
    let (mut a, mut b) = (with_places(1, &[1, 2]), with_places(2, &[1, 2]));
    let changed = b"features of an earlier start".to_vec();
    (0..3).for_each(|_| drop(a.publish_places(&changed, &[changed.len()])));
    talk(&mut [&mut a, &mut b]);
    assert_eq!(b.places_of(1), Some(changed));
    drop(a);
    let mut again = with_places(1, &[1, 2]);
    (0..3).for_each(|_| talk(&mut [&mut again, &mut b]));
    assert_eq!(b.places_of(1), Some(features(1)));
    let long = vec![0; MAX_PLACES_PART_BYTES + 1];
    assert!(again.publish_places(&long, &[long.len()]).is_err() && again.publish_places(&[], &[]).is_err());
}
