//! Saved maps round-trip bit for bit.

use crate::store::history::{camera, file, same, with_readings};
use cairn_atlas::store::{About, MapFile, Table};
use cairn_atlas::{Change, ChangeSet, Snapshot};
use cairn_sensor::ImuNoise;
use cairn_vision::SensorMode;
use std::collections::BTreeMap;

#[test]
fn any_history_round_trips() {
    let (mut maps, mut removed) = (0, 0);
    for seed in 0..60 {
        let saved = file(seed, 3 + seed as usize % 20, 12);
        let bytes = saved.write().unwrap();
        let reloaded = MapFile::read(&bytes).unwrap();
        same(&reloaded.snapshot, &saved.snapshot, &format!("seed {seed}"));
        assert_eq!((&reloaded.about, &reloaded.attached), (&saved.about, &saved.attached));
        assert_eq!(reloaded.write().unwrap(), bytes, "the same map gave other bytes");
        // A further change gives the same result: everything that it depends on has been restored.
        let changes =
            vec![Change::MoveKeyFrame(saved.snapshot.key_frames().last().unwrap().id, Default::default())];
        let next = |snapshot: &Snapshot| {
            snapshot.apply(&ChangeSet { base: snapshot.version(), changes: changes.clone() }).0
        };
        same(&next(&reloaded.snapshot), &next(&saved.snapshot), "a change later");
        maps += usize::from(saved.snapshot.maps().count() > 1);
        removed += usize::from(saved.snapshot.next_key_frame_id().index() > saved.snapshot.key_frame_count());
    }
    assert!(
        maps > 10 && removed > 10,
        "{maps} with several maps, {removed} with removed key frames: too few"
    );
}

#[test]
fn several_feature_parts_round_trip() {
    let saved = file(1, 150, 9);
    let bytes = saved.write().unwrap();
    let table = Table::read(&bytes).unwrap();
    let names: Vec<&str> = table.parts.iter().map(|p| p.name.as_str()).collect();
    assert!(names.contains(&"features 1") && names.last() == Some(&"attached/way/home"), "{names:?}");
    same(&MapFile::read(&bytes).unwrap().snapshot, &saved.snapshot, "many");
}

/// What the IMU measured between key frames is there again, to the last bit of single precision.
#[test]
fn imu_factors_round_trip() {
    let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-5, accel: 1e-2, accel_walk: 1e-4 };
    let mut factors = 0;
    for seed in 0..12 {
        let mut saved = file(seed, 10 + 12 * seed as usize, 9);
        saved.snapshot = with_readings(&saved.snapshot, noise);
        let bytes = saved.write().unwrap();
        let reloaded = MapFile::read(&bytes).unwrap();
        same(&reloaded.snapshot, &saved.snapshot, &format!("seed {seed}"));
        assert_eq!(reloaded.write().unwrap(), bytes);
        let of = |s: &Snapshot| s.key_frames().filter_map(|k| k.motion.as_ref()?.imu_factor.as_ref()).count();
        factors += of(&reloaded.snapshot);
        let stripped = MapFile { snapshot: saved.snapshot.without_imu_factors(), ..saved };
        let bytes = stripped.write().unwrap();
        same(&MapFile::read(&bytes).unwrap().snapshot, &stripped.snapshot, "without");
        assert_eq!(of(&stripped.snapshot), 0);
        assert!(Table::read(&bytes).unwrap().parts.iter().all(|part| !part.name.starts_with("readings")));
    }
    assert!(factors > 100, "{factors}");

    // What could not be read again is not written: a map always opens.
    let mut saved = file(1, 150, 9);
    saved.snapshot = with_readings(&saved.snapshot, ImuNoise { gyro: 0.0, ..noise });
    let reloaded = MapFile::read(&saved.write().unwrap()).unwrap();
    same(&reloaded.snapshot, &saved.snapshot.without_imu_factors(), "without noise");
}

#[test]
fn empty_map_round_trips() {
    let about = About { program: String::new(), sensor: SensorMode::Mono, camera: camera() };
    let saved = MapFile { snapshot: Snapshot::new(), about, attached: BTreeMap::new() };
    let reloaded = MapFile::read(&saved.write().unwrap()).unwrap();
    same(&reloaded.snapshot, &saved.snapshot, "nothing");
}
