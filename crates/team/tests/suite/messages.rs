//! A message is accepted only if it is complete, of this version, new, and from the sender that it names.

use cairn_geometry::{Se2, Se3};
use cairn_solve::Loss;
use cairn_solve::graph::PoseGraph;
use cairn_team::{Estimate, Message, PoseId, Refused, Robot, RobotGraph, Shared, VERSION, split};
use proptest::prelude::*;

fn robots() -> Vec<Robot<Se2, 3>> {
    let mut graph = PoseGraph::new();
    for _ in 0..30 {
        graph.add_vertex(Se2::identity(), false);
    }
    let information = nalgebra::Matrix3::identity() * 50.0;
    for k in 0..29 {
        let step = Se2::from_xy_angle(1.0, 0.0, 0.2);
        graph.add_edge(k, k + 1, step, &information, Loss::Squared).unwrap();
    }
    for k in 0..8 {
        let a_from_b = Se2::from_xy_angle(0.1 * f64::from(k), 0.2, -0.3);
        graph.add_edge(k as usize, 20 + k as usize, a_from_b, &information, Loss::Squared).unwrap();
    }
    split(&graph, 3).unwrap().iter().map(|own| Robot::new(own, None).unwrap()).collect()
}

/// The bytes with a corrected checksum.
fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = crc32fast::hash(&bytes[6..]).to_le_bytes();
    bytes[2..6].copy_from_slice(&checksum);
    bytes
}

#[test]
fn a_message_is_read_as_it_was_written() {
    let mut robots = robots();
    let bytes = robots[0].message().unwrap();
    let message = Message::decode(&bytes).unwrap();
    assert_eq!((message.robot, message.number, message.dimension), (0, 1, 3));
    assert!(message.shared.is_some() && message.encode().unwrap() == bytes);
    // The part that does not change is sent once, and again on request.
    let second = Message::decode(&robots[0].message().unwrap()).unwrap();
    assert_eq!(second.shared, None);
    let second = second.encode().unwrap();
    robots[1].receive(0, &second).unwrap();
    assert_eq!(robots[1].known().collect::<Vec<_>>(), [1], "nothing is known of robot 0 yet");
    let asks = robots[1].message().unwrap();
    assert_eq!(Message::decode(&asks).unwrap().requests, [0]);
    robots[0].receive(1, &asks).unwrap();
    let answer = robots[0].message().unwrap();
    assert!(Message::decode(&answer).unwrap().shared.is_some());
    robots[1].receive(0, &answer).unwrap();
    assert_eq!(robots[1].known().collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn other_versions_replays_and_false_names_are_refused() {
    let mut robots = robots();
    let first = robots[0].message().unwrap();
    let mut newer = first.clone();
    newer[0] = VERSION + 1;
    assert_eq!(robots[1].receive(0, &newer), Err(Refused::Version(VERSION + 1)));
    assert_eq!(Refused::Version(9).to_string(), "the message has version 9, this program reads version 3");
    assert_eq!(robots[1].receive(2, &first), Err(Refused::WrongSender { from: 2, claimed: 0 }));
    assert_eq!(robots[0].receive(0, &first), Err(Refused::OwnId));
    robots[1].receive(0, &first).unwrap();
    let old = Refused::Old { robot: 0, number: 1, newest: 1 };
    assert_eq!(robots[1].receive(0, &first), Err(old), "replayed");
    let long = vec![VERSION; cairn_team::MAX_BYTES + 1];
    assert_eq!(robots[1].receive(0, &long), Err(Refused::TooLong(cairn_team::MAX_BYTES + 1)));
    assert_eq!(robots[1].receive(0, &[]), Err(Refused::TooShort(0)));
    assert_eq!(robots[1].receive(0, &[VERSION, 1]), Err(Refused::TooShort(2)));
    let space = RobotGraph::<Se3, 6> {
        robot: 2,
        poses: [(0, Se3::identity())].into_iter().collect(),
        measurements: Vec::new(),
    };
    let bytes = Robot::new(&space, None).unwrap().message().unwrap();
    assert_eq!(robots[1].receive(2, &bytes), Err(Refused::Dimension { found: 6, expected: 3 }));
}

#[test]
fn messages_that_contradict_themselves_are_refused() {
    let mut robots = robots();
    let good = Message::decode(&robots[0].message().unwrap()).unwrap();
    let spoil: [fn(&mut Shared, &mut Estimate); 9] = [
        |s, _| s.steps[1] = 0,
        |s, _| s.steps[1] = u32::MAX,
        |s, _| s.measured[0] = f64::NAN,
        |s, _| s.loops[0].1 = PoseId { robot: 0, seq: 1 },
        |s, _| s.loops[0].0 = u16::MAX,
        |s, _| s.information[0] = 77,
        |s, _| s.informations[0] = -1e9,
        |_, e| e.others[0] = f32::INFINITY,
        |_, e| e.parts.push(1.0),
    ];
    for (k, spoil) in spoil.iter().enumerate() {
        let mut bad = good.clone();
        spoil(bad.shared.as_mut().unwrap(), &mut bad.estimate);
        let refused = robots[1].receive(0, &bad.encode().unwrap());
        assert!(matches!(refused, Err(Refused::Inconsistent(_))), "{k}: {refused:?}");
        assert_eq!(robots[1].known().collect::<Vec<_>>(), [1], "{k}: nothing of it is kept");
    }
    robots[1].receive(0, &good.encode().unwrap()).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn garbage_never_harms(bytes in proptest::collection::vec(any::<u8>(), 0..300), versioned in any::<bool>()) {
        let mut robot = robots().remove(1);
        let mut bytes = bytes;
        if versioned && bytes.len() > 6 {
            (bytes[0], bytes[1]) = (VERSION, 1);
            bytes = resealed(bytes);
        }
        let refused = robot.receive(0, &bytes);
        prop_assert!(refused.is_err());
        robot.step().unwrap();
    }

    /// Bytes of a message are changed and its checksum is corrected, as by a malicious peer: it is refused or does no
    /// harm.
    #[test]
    fn a_peer_that_lies_never_harms(at in any::<prop::sample::Index>(), value in any::<u8>(), more in any::<u8>()) {
        let mut robots = robots();
        let mut bytes = robots[0].message().unwrap();
        let k = 6 + at.index(bytes.len() - 6);
        bytes[k] ^= value;
        if let Some(next) = bytes.get_mut(k + 1) {
            *next ^= more;
        }
        let taken = robots[1].receive(0, &resealed(bytes));
        robots[1].step().unwrap();
        prop_assert!(robots[1].own_poses().all(|(_, p)| p.translation.iter().all(|v| v.is_finite())), "{:?}", taken);
        robots[1].message().unwrap();
    }
}
