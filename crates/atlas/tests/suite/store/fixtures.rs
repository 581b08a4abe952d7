//! One file per format version, kept for good: each can still be loaded.

use crate::store::history::{file, same};
use cairn_atlas::KeyFrameName;
use cairn_atlas::store::{MapFile, Table, VERSION};
use cairn_vision::SensorMode;
use std::path::PathBuf;

fn fixture(version: u32) -> PathBuf {
    PathBuf::from(format!("{}/tests/suite/store/fixtures/v{version}.map", env!("CARGO_MANIFEST_DIR")))
}

/// Run once for a new version: `cargo test -p cairn-atlas --test suite store:: -- --ignored writes_the_fixture`.
#[test]
#[ignore = "writes the fixture of this version"]
fn writes_the_fixture() {
    let path = fixture(VERSION);
    assert!(!path.exists(), "{} is kept for good", path.display());
    // The first small history that has everything: several maps, a prior, a gravity-aligned map, loops,
    // removed key frames.
    let has_everything = |f: &MapFile| {
        f.snapshot.maps().any(|(_, prior)| prior.is_some())
            && f.snapshot.maps().any(|(map, _)| f.snapshot.is_gravity_aligned(map))
            && f.snapshot.removed_key_frame_count() > 0
            && f.snapshot.robots().len() > 1
            && f.snapshot.key_frames().any(|k| !k.links.is_empty())
    };
    let saved = (0..1000).map(|seed| file(seed, 10, 12)).find(has_everything).unwrap();
    let saved = two_cameras(&saved);
    saved.save(&path).unwrap();
    same(&MapFile::load(&path).unwrap().snapshot, &saved.snapshot, "the fixture");
}

/// A file beside another one of another camera.
pub fn two_cameras(own: &MapFile) -> MapFile {
    let mut other = file(3, 6, 12);
    (other.about.sensor, other.about.camera.fx, other.about.camera.baseline_fx) =
        (SensorMode::Mono, 300.0, 0.0);
    let other = other.in_atlas_of(own).unwrap();
    MapFile { snapshot: own.snapshot.combined_with(&other.snapshot).unwrap().0, ..own.clone() }
}

#[test]
fn version_5_opens_with_its_cameras() {
    let opened = MapFile::load(&fixture(5)).unwrap();
    let snapshot = &opened.snapshot;
    let others: Vec<_> = snapshot.other_cameras().collect();
    assert_eq!(others.len(), 1);
    assert_eq!(
        (others[0].sensor, others[0].camera.fx, others[0].focal_ratio),
        (SensorMode::Mono, 300.0, 300.0 / 450.0)
    );
    let has = |other: bool| snapshot.key_frames().filter(|k| k.other_camera.is_some() == other).count();
    assert!(has(true) > 0 && has(false) > 0);
    assert_eq!(snapshot.check(), Ok(()));
}

#[test]
fn cameras_are_kept_and_one_camera_stays_in_the_older_format() {
    let saved = two_cameras(&file(1, 6, 12));
    same(&MapFile::read(&saved.write().unwrap()).unwrap().snapshot, &saved.snapshot, "two cameras");
    assert_eq!(Table::read(&saved.write().unwrap()).unwrap().version, 5);
    assert_eq!(Table::read(&file(1, 6, 12).write().unwrap()).unwrap().version, 4);
}

#[test]
fn every_version_has_its_fixture() {
    for version in 1..=VERSION {
        let bytes = std::fs::read(fixture(version)).unwrap();
        assert_eq!(Table::read(&bytes).unwrap().version, version);
    }
}

#[test]
fn version_1_opens() {
    let opened = MapFile::load(&fixture(1)).unwrap();
    let snapshot = &opened.snapshot;
    assert_eq!((opened.about.program.as_str(), opened.about.sensor), ("cairn test", SensorMode::Stereo));
    assert_eq!((opened.about.camera.fx, opened.about.camera.baseline_fx), (450.0, 45.0));
    let counts = (snapshot.key_frame_count(), snapshot.removed_key_frame_count(), snapshot.landmark_count());
    assert_eq!(counts, (7, 3, 29));
    let observations: usize = snapshot.landmarks().map(|l| l.observations.len()).sum();
    assert_eq!((observations, snapshot.maps().count()), (38, 3));
    assert_eq!(snapshot.maps().filter(|(_, prior)| prior.is_some()).count(), 2);
    assert!(snapshot.key_frames().any(|k| !k.links.is_empty()));
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    near(snapshot.right_offset(), 0.510_328_292_846_679_7);
    let last = snapshot.key_frames().last().unwrap();
    near(last.world_from_camera.translation.x, -0.504_512_786_865_234_4);
    assert_eq!((last.id.index(), last.frame.len(), last.frame.px[3]), (9, 12, [101.00415, 127.11834]));
    assert!(!last.bag.is_empty());
    let l = snapshot.landmarks().last().unwrap();
    near(l.position.z, -2.616_806_030_273_437_5);
    near(l.normal.z, -0.800_232_471_938_011_1);
    assert_eq!((l.observations.len(), l.descriptor[..4].to_vec()), (1, vec![239, 67, 214, 41]));
    assert_eq!(opened.attached["way/home"], b"{\"format\":1}\n".repeat(3));
    assert_eq!(snapshot.check(), Ok(()));
}

/// Files from before robots had numbers: all was created by robot 0, in order.
#[test]
fn older_versions_are_of_robot_0() {
    for version in 1..=3 {
        let snapshot = MapFile::load(&fixture(version)).unwrap().snapshot;
        assert_eq!(snapshot.robots().into_keys().collect::<Vec<_>>(), [0]);
        let last = snapshot.key_frames().last().unwrap().id;
        assert_eq!(snapshot.key_frame_name(last), KeyFrameName { robot: 0, seq: last.index() as u32 });
    }
}

#[test]
fn version_2_opens() {
    let opened = MapFile::load(&fixture(2)).unwrap();
    let snapshot = &opened.snapshot;
    let counts = (snapshot.key_frame_count(), snapshot.removed_key_frame_count(), snapshot.landmark_count());
    let gravity_aligned: Vec<bool> =
        snapshot.maps().map(|(map, _)| snapshot.is_gravity_aligned(map)).collect();
    assert_eq!((counts, gravity_aligned), ((9, 1, 34), vec![true, false]));
    let moving: Vec<_> = snapshot.key_frames().filter_map(|k| k.motion.as_ref()).collect();
    let last = moving.last().unwrap();
    assert_eq!(
        (moving.len(), last.velocity.y, last.imu_factor.is_none()),
        (4, -0.548_204_421_997_070_3, true)
    );
    assert_eq!((last.bias.gyro.x, last.bias.accel.z), (0.007_293_796_539_306_641, 0.013_232_231_140_136_719));
    assert_eq!(snapshot.check(), Ok(()));
}
