//! What is whole of a damaged map is saved, and the result is a whole map.

use crate::store::fixtures::two_cameras;
use crate::store::history::{Dice, file, same, with_readings};
use cairn_atlas::store::{MapFile, Table, inspect};
use cairn_sensor::ImuNoise;

/// Enough for more than one part of features.
const STEPS: usize = 220;

/// Where a part is stored in a file.
fn span(bytes: &[u8], name: &str) -> std::ops::Range<usize> {
    let parts = Table::read(bytes).unwrap().parts;
    let total: u64 = parts.iter().map(|p| p.stored_bytes).sum();
    let mut at = bytes.len() - total as usize;
    for p in parts {
        let end = at + p.stored_bytes as usize;
        if p.name == name {
            return at..end;
        }
        at = end;
    }
    panic!("no part {name}");
}

fn with_damage(bytes: &[u8], name: &str) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    let span = span(bytes, name);
    damaged[(span.start + span.end) / 2] ^= 0x55;
    assert!(MapFile::read(&damaged).is_err(), "{name}");
    damaged
}

/// Salvages, and checks that the result is a map that can be saved and read.
fn salvaged(bytes: &[u8]) -> (MapFile, Vec<String>) {
    let (saved, lost) = MapFile::salvage(bytes).unwrap();
    assert_eq!(saved.snapshot.check(), Ok(()));
    let again = MapFile::read(&saved.write().unwrap()).unwrap();
    assert_eq!(again.snapshot.key_frame_count(), saved.snapshot.key_frame_count());
    (saved, lost)
}

#[test]
fn a_whole_map_loses_nothing() {
    let whole = file(3, STEPS, 6);
    let bytes = whole.write().unwrap();
    let (saved, lost) = salvaged(&bytes);
    assert_eq!(lost, [""; 0]);
    assert_eq!(saved.write().unwrap(), bytes);
}

/// Without the list of cameras the features of a map of several would mean nothing.
#[test]
fn a_map_of_several_cameras_needs_to_know_them() {
    let bytes = two_cameras(&file(3, 8, 6)).write().unwrap();
    let damaged = with_damage(&bytes, "cameras");
    let why = MapFile::salvage(&damaged).unwrap_err().to_string();
    assert!(why.contains("part 'cameras'"), "{why}");
}

#[test]
fn what_can_be_computed_or_done_without_is_left_out() {
    let whole = file(3, STEPS, 6);
    let bytes = whole.write().unwrap();
    let count = |file: &MapFile| (file.snapshot.key_frame_count(), file.snapshot.landmark_count());
    for name in ["words", "motion", "gone", "worlds", "attached/way/home"] {
        let (saved, lost) = salvaged(&with_damage(&bytes, name));
        assert_eq!(count(&saved), count(&whole), "{name}");
        assert!(!lost.is_empty() && lost[0].contains(name), "{name}: {lost:?}");
        assert_eq!(saved.attached.len() + usize::from(name.starts_with("attached")), whole.attached.len());
    }
    let (saved, _) = salvaged(&with_damage(&bytes, "words"));
    for (a, b) in saved.snapshot.key_frames().zip(whole.snapshot.key_frames()) {
        assert_eq!(a.bag, b.bag, "the words of {:?} are computed again", a.id);
    }
}

#[test]
fn key_frames_without_features_keep_their_poses() {
    let whole = file(3, STEPS, 6);
    let bytes = whole.write().unwrap();
    let features = inspect(&bytes).unwrap().iter().filter(|(p, _)| p.name.starts_with("features ")).count();
    assert!(features > 1, "the map is too small for this test");
    let (saved, lost) = salvaged(&with_damage(&bytes, "features 0"));
    assert_eq!(lost.len(), 1, "{lost:?}");
    assert_eq!(saved.snapshot.key_frame_count(), whole.snapshot.key_frame_count());
    assert!(saved.snapshot.landmark_count() < whole.snapshot.landmark_count());
    for (n, (a, b)) in saved.snapshot.key_frames().zip(whole.snapshot.key_frames()).enumerate() {
        assert_eq!((a.id, a.world_from_camera), (b.id, b.world_from_camera));
        assert_eq!(a.frame.len(), if n < 64 { 0 } else { b.frame.len() });
    }
    for l in saved.snapshot.landmarks() {
        assert_eq!(l.position, whole.snapshot.landmark(l.id).unwrap().position);
    }
}

#[test]
fn a_truncated_file_and_a_damaged_header_are_salvaged() {
    let whole = file(3, STEPS, 6);
    let bytes = whole.write().unwrap();
    let cut = span(&bytes, "features 1").start + 10;
    let (saved, lost) = salvaged(&bytes[..cut]);
    assert!(lost[0].contains("promises") && lost.iter().any(|l| l.contains("features 1")), "{lost:?}");
    assert_eq!(saved.snapshot.key_frame_count(), whole.snapshot.key_frame_count());
    for at in [9, 14, 20, 26, 30] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0xff;
        let (saved, lost) = salvaged(&damaged);
        assert!(lost[0].contains("header"), "{lost:?}");
        assert_eq!(saved.snapshot.landmark_count(), whole.snapshot.landmark_count());
    }
}

#[test]
fn what_nothing_can_be_done_without_is_an_error_and_nothing_panics() {
    let bytes = file(3, 4, 6).write().unwrap();
    for name in ["about", "key frames", "landmarks"] {
        let error = MapFile::salvage(&with_damage(&bytes, name)).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
    }
    assert!(MapFile::salvage(b"").is_err() && MapFile::salvage(b"something else").is_err());
    let mut dice = Dice::new(5);
    for _ in 0..2000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + dice.roll(4) {
            let at = dice.roll(damaged.len());
            damaged[at] ^= 1 + dice.roll(255) as u8;
        }
        damaged.truncate(damaged.len() - dice.roll(damaged.len() / 2) * dice.roll(2));
        if let Ok((saved, _)) = MapFile::salvage(&damaged) {
            assert_eq!(saved.snapshot.check(), Ok(()));
        }
    }
}

#[test]
fn damaged_imu_readings_are_forgotten() {
    let mut whole = file(3, STEPS, 6);
    let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-5, accel: 1e-2, accel_walk: 1e-4 };
    whole.snapshot = with_readings(&whole.snapshot, noise);
    let damaged = with_damage(&whole.write().unwrap(), "readings 1");
    assert!(MapFile::read(&damaged).unwrap_err().to_string().contains("readings 1"));
    let (saved, lost) = salvaged(&damaged);
    assert!(
        lost.len() == 1 && lost[0].contains("what the IMU measured between key frames is forgotten"),
        "{lost:?}"
    );
    same(&saved.snapshot, &whole.snapshot.without_imu_factors(), "repaired");
}
