//! Two snapshots combined: each keeps its content under other ids.

use crate::history::{same, snapshot};
use cairn_atlas::store::MapFile;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_vision::Octaves;

#[test]
fn combined_snapshot_contains_both() {
    for seed in 0..20 {
        let (a, b) = (snapshot(seed, 12, 12), snapshot(seed + 100, 9, 12));
        let (both, shift) = a.beside(&b).unwrap();
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
        }
        for l in b.landmarks() {
            let moved = both.landmark(shift.landmark(l.id).unwrap()).unwrap();
            assert_eq!(
                (moved.position, moved.descriptor, moved.normal),
                (l.position, l.descriptor, l.normal)
            );
        }
        let mut file = crate::history::file(seed, 1, 3);
        file.snapshot = both.clone();
        same(&MapFile::read(&file.write().unwrap()).unwrap().snapshot, &both, "both");
    }
}

#[test]
fn different_octaves_are_refused() {
    let other = Snapshot::with_octaves(Octaves { levels: 4, factor: 1.5 });
    assert!(Snapshot::new().beside(&other).unwrap_err().contains("levels: 4"));
}
