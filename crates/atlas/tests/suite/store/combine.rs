//! Two snapshots combined: each keeps its content under other ids.

use crate::store::history::{same, snapshot};
use cairn_atlas::store::MapFile;
use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, KeyFrameName, Snapshot};
use cairn_geometry::Se3;
use cairn_vision::{Frame, Octaves};
use std::sync::Arc;

#[test]
fn combined_snapshot_contains_both() {
    for seed in 0..20 {
        let (a, b) = (snapshot(seed, 12, 12), snapshot(seed + 100, 9, 12));
        let (both, shift) = a.combined_with(&b).unwrap();
        assert_eq!(both.check(), Ok(()));
        assert_eq!(both.key_frame_count(), a.key_frame_count() + b.key_frame_count());
        assert_eq!(both.landmark_count(), a.landmark_count() + b.landmark_count());
        assert_eq!(both.maps().count(), a.maps().count() + b.maps().count());
        for k in a.key_frames() {
            assert_eq!(format!("{k:?}"), format!("{:?}", both.key_frame(k.id).unwrap()));
            let similar = both.places().query(&k.bag, 1, |_| true);
            assert!(similar[0].1 > 0.999, "its own place is not found: {similar:?}");
        }
        for index in 0..b.next_key_frame_id().index() {
            let id = KeyFrameId::from_index(index).unwrap();
            let here = both.world_from_here(shift.key_frame(id).unwrap());
            assert_eq!(here, b.world_from_here(id), "existing and removed ones keep their poses");
            let (was, is) = (b.key_frame_name(id), both.key_frame_name(shift.key_frame(id).unwrap()));
            assert_eq!((shift.robot(was.robot), was.seq), (is.robot, is.seq));
            assert_eq!(both.key_frame_named(is), shift.key_frame(id));
        }
        for l in b.landmarks() {
            let moved = both.landmark(shift.landmark(l.id).unwrap()).unwrap();
            assert_eq!(
                (moved.position, moved.descriptor, moved.normal),
                (l.position, l.descriptor, l.normal)
            );
        }
        let mut file = crate::store::history::file(seed, 1, 3);
        file.snapshot = both.clone();
        same(&MapFile::read(&file.write().unwrap()).unwrap().snapshot, &both, "both");
    }
}

/// Two robots with numbers of their own: every name stays, and each goes on counting after the merge.
#[test]
fn names_of_different_robots_stay() {
    let (a, b) = (snapshot(3, 1, 6).continued_by(7), snapshot(6, 1, 6).continued_by(8));
    let one = |robot: u16| {
        let empty = Snapshot::new().continued_by(robot);
        let k = KeyFrame::new(empty.next_key_frame_id(), Arc::new(Frame::default()), Se3::identity(), None);
        let changes = vec![Change::AddKeyFrame(Box::new(k))];
        empty.apply(&ChangeSet { base: empty.version(), changes }).0
    };
    let (both, shift) = one(7).combined_with(&one(8)).unwrap();
    assert!(shift.robots.is_empty());
    let named = |robot, seq| both.key_frame_named(KeyFrameName { robot, seq }).map(KeyFrameId::index);
    assert_eq!([named(7, 0), named(8, 0), named(7, 1), named(0, 0)], [Some(0), Some(1), None, None]);
    let next = both.clone().continued_by(7);
    assert_eq!(next.key_frame_name(next.next_key_frame_id()), KeyFrameName { robot: 7, seq: 1 });
    // Both began as robot 0: that of the second gets another number.
    let (both, shift) = a.combined_with(&b).unwrap();
    assert_eq!(shift.robots.keys().copied().collect::<Vec<_>>(), [0]);
    assert!(!both.robots().is_empty());
}

#[test]
fn different_octaves_are_refused() {
    let other = Snapshot::with_octaves(Octaves { levels: 4, factor: 1.5 });
    assert!(Snapshot::new().combined_with(&other).unwrap_err().to_string().contains("levels: 4"));
}
