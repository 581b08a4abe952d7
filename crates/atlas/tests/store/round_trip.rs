//! What is saved comes back to the last bit.

use crate::history::{camera, file, same};
use cairn_atlas::store::{About, MapFile, Table};
use cairn_atlas::{Change, ChangeSet, Snapshot};
use cairn_vision::SensorMode;
use std::collections::BTreeMap;

#[test]
fn any_history_comes_back_to_the_last_bit_and_goes_on_alike() {
    let (mut maps, mut gone) = (0, 0);
    for seed in 0..60 {
        let saved = file(seed, 3 + seed as usize % 20, 12);
        let bytes = saved.write().unwrap();
        let again = MapFile::read(&bytes).unwrap();
        same(&again.snapshot, &saved.snapshot, &format!("seed {seed}"));
        assert_eq!((&again.about, &again.attached), (&saved.about, &saved.attached));
        assert_eq!(again.write().unwrap(), bytes, "the same map, other bytes");
        // What follows is the same too: everything that a change looks at has come back.
        let changes =
            vec![Change::MoveKeyFrame(saved.snapshot.key_frames().last().unwrap().id, Default::default())];
        let next = |snapshot: &Snapshot| {
            snapshot.apply(&ChangeSet { base: snapshot.version(), changes: changes.clone() }).0
        };
        same(&next(&again.snapshot), &next(&saved.snapshot), "a change later");
        maps += usize::from(saved.snapshot.maps().count() > 1);
        gone += usize::from(saved.snapshot.next_key_frame_id().index() > saved.snapshot.key_frame_count());
    }
    assert!(maps > 10 && gone > 10, "{maps} maps with worlds, {gone} with removed key frames: too few");
}

#[test]
fn more_key_frames_than_one_part_holds_come_back() {
    let saved = file(1, 150, 9);
    let bytes = saved.write().unwrap();
    let table = Table::read(&bytes).unwrap();
    let names: Vec<&str> = table.parts.iter().map(|p| p.name.as_str()).collect();
    assert!(names.contains(&"features 1") && names.last() == Some(&"attached/way/home"), "{names:?}");
    same(&MapFile::read(&bytes).unwrap().snapshot, &saved.snapshot, "many");
}

#[test]
fn an_empty_map_comes_back() {
    let about = About { program: String::new(), sensor: SensorMode::Mono, camera: camera() };
    let saved = MapFile { snapshot: Snapshot::new(), about, attached: BTreeMap::new() };
    let again = MapFile::read(&saved.write().unwrap()).unwrap();
    same(&again.snapshot, &saved.snapshot, "nothing");
}
