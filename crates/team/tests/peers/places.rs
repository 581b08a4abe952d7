//! Features of key frames that look alike go to robots of greater numbers that want the map, and to no others.

use crate::team::{received, talk, with_words};
use cairn_team::RobotId;
use cairn_team::peer::{BLOCK_BYTES, MAX_PLACES_PART_BYTES, MapSubscription, Peer};

fn has(peer: &Peer) -> Vec<RobotId> {
    peer.places().map(|holding| holding.robot).collect()
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
    assert_eq!((received(&a, "places"), received(&d, "places")), (0, 0));
    // Robot 1 needs nothing of robot 3, and robot 4 nothing of anybody.
    assert!(a.is_up_to_date(2) && a.is_up_to_date(3) && a.is_up_to_date(4) && c.is_up_to_date(1));
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
