//! What one robot made of an atlas that several made.

use crate::store::history::{Dice, file, same, step};
use cairn_atlas::store::MapFile;
use cairn_atlas::{ChangeSet, KeyFrameId, RobotId, Snapshot};

/// Robots that go on with one atlas by turns, over several maps with merges, loops, removals.
fn by_turns(seed: u64) -> Snapshot {
    let (mut dice, mut snapshot) = (Dice::new(seed), Snapshot::new());
    for _ in 0..6 {
        snapshot = snapshot.continued_by(dice.roll(3) as RobotId);
        for _ in 0..4 {
            let changes = step(&mut dice, &snapshot, 12);
            snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes }).0;
        }
    }
    snapshot.check().unwrap();
    snapshot
}

#[test]
fn a_part_holds_what_the_robot_made_where_it_was_under_its_names() {
    let (mut moved, mut removed_kept) = (0, 0);
    for seed in 0..40 {
        let whole = by_turns(seed);
        for (robot, key_frames) in whole.robots() {
            let part = whole.part_of(robot).unwrap();
            part.check().unwrap();
            assert_eq!(part.robots(), [(robot, key_frames)].into());
            for k in part.key_frames() {
                let before =
                    whole.key_frame(whole.key_frame_named(part.key_frame_name(k.id)).unwrap()).unwrap();
                assert_eq!((k.world_from_camera, k.unit), (before.world_from_camera, before.unit));
                assert_eq!((k.stamp, k.landmarks.len()), (before.stamp, before.landmarks.len()));
                moved += usize::from(k.id != before.id);
                for (id, of_whole) in k.landmarks.iter().zip(&before.landmarks) {
                    let at = id.map(|id| part.landmark(id).unwrap().position);
                    assert_eq!(at, of_whole.map(|id| whole.landmark(id).unwrap().position));
                    if let Some(id) = id {
                        assert_eq!(part.landmark_name(*id).robot, robot);
                    }
                }
                let similar = part.places().query(&k.bag, 1, |_| true);
                assert!(similar[0].1 > 0.999, "its own place is not found: {similar:?}");
            }
            // Removed ones are where they were.
            for id in (0..part.next_key_frame_id().index()).filter_map(KeyFrameId::from_index) {
                let Some(here) = part.world_from_here(id).filter(|_| part.key_frame(id).is_none()) else {
                    continue;
                };
                let before =
                    whole.world_from_here(whole.key_frame_named(part.key_frame_name(id)).unwrap()).unwrap();
                assert!((here.translation - before.translation).norm() < 1e-9);
                assert!((here.scale - before.scale).abs() < 1e-9);
                removed_kept += 1;
            }
            let mut saved = file(seed, 1, 3);
            saved.snapshot = part.clone();
            same(&MapFile::read(&saved.write().unwrap()).unwrap().snapshot, &part, "part");
        }
        assert!(whole.part_of(9).is_none());
    }
    assert!(moved > 100 && removed_kept > 20, "{moved} {removed_kept}");
}

/// The parts of all robots, put together again, are what there was, and no robot needs another number.
#[test]
fn the_parts_of_all_robots_are_the_whole() {
    for seed in 0..40 {
        let whole = by_turns(seed);
        let parts = whole.robots().into_keys().map(|robot| whole.part_of(robot).unwrap());
        let all = parts.reduce(|all, part| {
            let (all, shift) = all.combined_with(&part).unwrap();
            assert!(shift.robots.is_empty(), "{:?}", shift.robots);
            all
        });
        let all = all.unwrap();
        all.check().unwrap();
        assert_eq!(all.key_frame_count(), whole.key_frame_count());
        for k in whole.key_frames() {
            let there = all.key_frame(all.key_frame_named(whole.key_frame_name(k.id)).unwrap()).unwrap();
            assert_eq!((there.world_from_camera, there.unit), (k.world_from_camera, k.unit));
        }
    }
}
