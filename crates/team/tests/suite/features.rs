//! Messages around features of key frames: where key frames stand, and which are asked for. What is not valid is refused with a reason.

use cairn_geometry::Vec3;
use cairn_team::{
    KeyFrameWords, MAX_REQUESTED, MAX_REQUESTS_BYTES, MAX_VIEWPOINTS, MAX_VIEWPOINTS_BYTES, PlaceRequests,
    Refused, Viewpoint, Viewpoints,
};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

fn viewpoint(angle: f64, position: [f64; 3]) -> Viewpoint {
    let axis = Vec3::new(angle.cos() * 0.8, angle.sin() * 0.8, 0.6);
    Viewpoint { position: Vec3::from(position), axis }
}

/// A walk of so many key frames, every second one left out of the map.
fn walk(n: u32) -> Viewpoints {
    let at = |k: u32| (2 * k + 3, viewpoint(f64::from(k) * 0.3, [f64::from(k) * 0.25 - 7.0, 1.5, -0.3]));
    Viewpoints((0..n).map(at).collect())
}

fn requests(of: &[(u16, usize)]) -> PlaceRequests {
    PlaceRequests(of.iter().map(|(robot, n)| (*robot, (0..*n as u32).map(|k| 7 * k).collect())).collect())
}

proptest! {
    #[test]
    fn viewpoints_come_back_to_a_centimetre(
        all in prop::collection::btree_map(any::<u32>(), (0.0..6.3, prop::array::uniform3(-1e5..1e5)), 0..40),
    ) {
        let all: BTreeMap<u32, Viewpoint> = all.into_iter().map(|(k, (angle, p))| (k, viewpoint(angle, p))).collect();
        let bytes = Viewpoints(all.clone()).encode(5).expect("within bounds");
        let read = Viewpoints::decode(5, &bytes).expect("valid").0;
        prop_assert_eq!(read.keys().collect::<Vec<_>>(), all.keys().collect::<Vec<_>>());
        for (a, b) in read.values().zip(all.values()) {
            prop_assert!((a.position - b.position).norm() < 0.0087 && a.axis.angle(&b.axis) < 0.009);
        }
    }

    #[test]
    fn bytes_of_anything_are_refused_and_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(Viewpoints::decode(1, &bytes).is_err() && PlaceRequests::decode(1, &bytes).is_err());
    }

    #[test]
    fn a_changed_byte_is_refused(at in any::<prop::sample::Index>(), flip in 1u8..) {
        for (bytes, is_viewpoints) in
            [(walk(30).encode(5).unwrap(), true), (requests(&[(1, 6), (2, 4)]).encode(5).unwrap(), false)]
        {
            let mut changed = bytes.clone();
            changed[at.index(bytes.len())] ^= flip;
            let is_refused = match is_viewpoints {
                true => Viewpoints::decode(5, &changed).is_err(),
                false => PlaceRequests::decode(5, &changed).is_err(),
            };
            prop_assert!(is_refused);
        }
    }
}

#[test]
fn a_viewpoint_takes_a_dozen_bytes() {
    let bytes = walk(200).encode(5).unwrap().len();
    assert!(bytes <= 12 * 200, "{bytes} B");
}

#[test]
fn what_a_robot_says_of_another_and_what_is_too_much_is_refused() {
    let bytes = walk(3).encode(5).unwrap();
    assert_eq!(Viewpoints::decode(6, &bytes), Err(Refused::WrongSender { from: 6, claimed: 5 }));
    assert!(matches!(PlaceRequests::decode(5, &bytes), Err(Refused::Kind(_))));
    assert!(KeyFrameWords::decode(5, &bytes).is_err());
    let asks = requests(&[(1, MAX_REQUESTED), (2, 3)]);
    let bytes = asks.encode(5).unwrap();
    assert_eq!(PlaceRequests::decode(5, &bytes), Ok(asks));
    assert_eq!(PlaceRequests::decode(6, &bytes), Err(Refused::WrongSender { from: 6, claimed: 5 }));
    assert_eq!(requests(&[(1, MAX_REQUESTED + 1)]).encode(5), None);
    let many: Vec<(u16, usize)> = (0..300).map(|robot| (robot, 1)).collect();
    assert_eq!(requests(&many).encode(5), None);
    let far = Viewpoints(BTreeMap::from([(1, viewpoint(0.0, [1e7, 0.0, 0.0]))]));
    let nowhere = Viewpoints(BTreeMap::from([(1, viewpoint(0.0, [f64::NAN, 0.0, 0.0]))]));
    assert_eq!((far.encode(5), nowhere.encode(5)), (None, None));
    assert_eq!(walk(MAX_VIEWPOINTS as u32 + 1).encode(5), None);
    assert!(Viewpoints::decode(5, &vec![0; MAX_VIEWPOINTS_BYTES + 1]).is_err());
    assert!(PlaceRequests::decode(5, &vec![0; MAX_REQUESTS_BYTES + 1]).is_err());
}

/// As [`Viewpoints::encode`] writes them, from parts that it would not write.
fn sealed(kind: u8, body: &impl serde::Serialize) -> Vec<u8> {
    let body = postcard::to_stdvec(body).unwrap();
    let mut bytes = vec![cairn_team::VERSION, kind];
    bytes.extend(crc32fast::hash(&body).to_le_bytes());
    bytes.extend(body);
    bytes
}

#[test]
fn viewpoints_that_contradict_themselves_are_refused() {
    type KeyFrame = (u32, [i32; 3], [i8; 3]);
    let read = |all: &[KeyFrame]| Viewpoints::decode(5, &sealed(3, &(5u16, all.to_vec())));
    let good: KeyFrame = (4, [100, 0, -100], [127, 0, 0]);
    assert!(read(&[good, good]).is_ok());
    let reason = |all: &[KeyFrame]| read(all).unwrap_err().to_string();
    assert!(reason(&[good, (0, good.1, good.2)]).contains("two places"));
    assert!(reason(&[(4, good.1, [127, 127, 0])]).contains("length one"));
    assert!(reason(&[(4, good.1, [0, 0, 0])]).contains("length one"));
    assert!(reason(&[(4, [i32::MIN, 0, 0], good.2)]).contains("farther away"));
    assert!(read(&[(u32::MAX, good.1, good.2), good]).is_err());
    let asked: BTreeMap<u16, BTreeSet<u32>> = BTreeMap::from([(1, (0..1000).collect())]);
    let why = PlaceRequests::decode(5, &sealed(4, &(5u16, asked))).unwrap_err().to_string();
    assert!(why.contains("more key frames than"), "{why}");
}
