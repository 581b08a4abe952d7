//! Features that are paged out, or stay in the file of a saved map, are the same when somebody looks at them.

use crate::store::history::{Dice, camera, file, same, step};
use cairn_atlas::store::{About, MapFile};
use cairn_atlas::{Atlas, ChangeSet, Snapshot};
use cairn_vision::SensorMode;
use std::collections::BTreeMap;
use std::path::PathBuf;

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("cairn-atlas-paging-{}-{name}.map", std::process::id()))
}

fn in_memory(snapshot: &Snapshot) -> usize {
    snapshot.key_frames().filter(|k| k.frame.in_memory().is_some()).count()
}

/// A history of many key frames in an atlas, which pages out, and without one.
fn two(steps: usize) -> [Snapshot; 2] {
    let (mut dice, mut plain) = (Dice::new(5), Snapshot::new());
    let mut atlas = Atlas::new(plain.clone());
    for _ in 0..steps {
        let changes = step(&mut dice, &plain, 9);
        atlas.commit(changes.clone());
        plain = plain.apply(&ChangeSet { base: plain.version(), changes }).0;
    }
    // Nobody looks at the others meanwhile.
    for _ in 0..200 {
        let mut changes = step(&mut dice, &plain, 9);
        changes.truncate(1);
        atlas.commit(changes.clone());
        plain = plain.apply(&ChangeSet { base: plain.version(), changes }).0;
    }
    [(**atlas.latest()).clone(), plain]
}

fn saved(snapshot: &Snapshot) -> MapFile {
    let about = About { program: "cairn test".into(), sensor: SensorMode::Stereo, camera: camera() };
    MapFile { snapshot: snapshot.clone(), about, attached: BTreeMap::new() }
}

#[test]
fn what_was_paged_out_comes_back_to_the_last_bit() {
    let [paged, plain] = two(300);
    let (count, before) = (plain.key_frame_count(), in_memory(&paged));
    assert!(count > 350 && before < count - 50 && before >= 64, "{before} of {count} in memory");
    assert_eq!(in_memory(&plain), count);
    // Saving reads what is on the disk, and keeps none of it.
    let bytes = saved(&paged).write().unwrap();
    assert_eq!(in_memory(&paged), before);
    assert!(bytes == saved(&plain).write().unwrap(), "other bytes");
    same(&paged, &plain, "paged");
    assert_eq!(in_memory(&paged), count);
    assert!(paged.read_fault().is_none());
}

#[test]
fn a_saved_map_opens_without_its_features() {
    for (seed, steps) in (0..12).map(|seed| (seed, 5 + seed as usize)).chain([(1, 150)]) {
        let path = path(&format!("open-{seed}-{steps}"));
        let whole = file(seed, steps, 12);
        whole.save(&path).unwrap();
        let opened = MapFile::load(&path).unwrap();
        // The file that was opened stays open.
        std::fs::remove_file(&path).unwrap();
        assert_eq!(in_memory(&opened.snapshot), 0);
        assert_eq!(opened.snapshot.check(), Ok(()));
        assert!(opened.write().unwrap() == whole.write().unwrap(), "other bytes");
        assert_eq!(in_memory(&opened.snapshot), 0);
        same(&opened.snapshot, &whole.snapshot, &format!("seed {seed}"));
        assert_eq!((&opened.about, &opened.attached), (&whole.about, &whole.attached));
        assert!(opened.snapshot.read_fault().is_none());
    }
}

/// A saved map in which one byte of the last part of features was changed, and its path.
fn damaged_in_place(path: &PathBuf, at: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    let last = bytes.len() - at;
    bytes[last] ^= 4;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn damaged_features_are_told_when_the_map_is_opened() {
    let path = path("damaged");
    let mut whole = file(1, 150, 12);
    whole.attached.clear();
    whole.save(&path).unwrap();
    for at in [1, 500, 5000] {
        damaged_in_place(&path, at);
        let message = MapFile::load(&path).expect_err("it was not seen").to_string();
        assert!(message.contains("part 'features ") && message.contains("bytes were altered"), "{message}");
        damaged_in_place(&path, at);
    }
    assert!(MapFile::load(&path).is_ok());
    std::fs::remove_file(&path).unwrap();
}

#[test]
fn features_that_cannot_be_read_later_match_nothing_and_are_never_saved() {
    let path = path("later");
    let mut whole = file(1, 150, 12);
    whole.attached.clear();
    whole.save(&path).unwrap();
    let opened = MapFile::load(&path).unwrap();
    damaged_in_place(&path, 500);
    let error = opened.write().expect_err("its features cannot be read").to_string();
    assert!(error.contains("cannot be saved") && error.contains("bytes were altered"), "{error}");
    let last = opened.snapshot.key_frames().last().unwrap();
    assert_eq!((last.frame.len(), last.landmarks.len()), (12, 12));
    last.frame.near(320.0, 240.0, 1e6, |_| panic!("it matches"));
    assert!(last.frame.px.iter().flatten().all(|v| v.is_nan()));
    let fault = opened.snapshot.read_fault().expect("a fault").to_string();
    assert!(fault.contains("part 'features ") && fault.contains("bytes were altered"), "{fault}");
    // What was read from whole parts is there.
    assert!(opened.snapshot.key_frames().next().unwrap().frame.px[0][0].is_finite());
    damaged_in_place(&path, 500);
    assert!(opened.write().is_err(), "what stands in for features must not be saved");
    std::fs::remove_file(&path).unwrap();
}
