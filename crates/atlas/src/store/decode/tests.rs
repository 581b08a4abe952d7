//! Files of which a part was changed.

use super::features::empty_frame;
use super::*;
use crate::store::about::tests::about;
use crate::store::container::PartsWriter;
use crate::{Change, ChangeSet, KeyFrame, KeyFrameId, LandmarkId};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_vision::bow::Vocabulary;
use std::io::Cursor;

/// A map of one key frame, some features of which show landmarks.
fn small() -> MapFile {
    let about = about();
    let mut frame = empty_frame(Stamp(7));
    for i in 0..40u8 {
        let px = [f32::from(i) * 16.0, f32::from(i) * 11.0];
        frame.px.push(px);
        frame.raw.push(px);
        frame.octave.push(i % 8);
        frame.angle.push(0.1);
        frame.descriptors.push(std::array::from_fn(|k| i.wrapping_mul(37).wrapping_add(91 * k as u8)));
        frame.depth.push(f32::NAN);
        frame.right_x.push(f32::NAN);
    }
    frame.index(&about.camera);
    let bag = Arc::new(Vocabulary::embedded().bag(&frame.descriptors));
    let key_frame = KeyFrame::new(KeyFrameId::FIRST, Arc::new(frame), Se3::identity(), None).with_bag(bag);
    let changes = vec![
        Change::AddKeyFrame(Box::new(key_frame)),
        Change::AddLandmark(LandmarkId::FIRST, Vec3::new(0.0, 0.0, 3.0)),
        Change::Observe(LandmarkId::FIRST, KeyFrameId::FIRST, 5),
    ];
    let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
    MapFile { snapshot, about, attached: BTreeMap::new() }
}

/// A file with one part changed, all checksums right.
fn with_part(bytes: &[u8], name: &str, change: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let parts = Parts::open(bytes, crate::store::VERSION).unwrap();
    let mut out = Cursor::new(Vec::new());
    let names = parts.names().map(String::from).collect();
    let mut writer = PartsWriter::begin(&mut out, 1, names).unwrap();
    for each in parts.names() {
        let mut plain = parts.get(each).unwrap();
        if each == name {
            change(&mut plain);
        }
        writer.put(&plain).unwrap();
    }
    writer.finish().unwrap();
    out.into_inner()
}

#[test]
fn other_descriptors_are_refused_and_none_means_those_of_the_first_release() {
    let bytes = small().write().unwrap();
    let other = with_part(&bytes, DESCRIPTORS, |plain| plain[0] ^= 1);
    for read in [MapFile::read(&other), MapFile::salvage(&other).map(|(file, _)| file)] {
        assert!(matches!(read, Err(StoreError::Descriptors { .. })));
    }
}

#[test]
fn words_of_another_vocabulary_are_recomputed() {
    let saved = small();
    let bytes = saved.write().unwrap();
    let other = with_part(&bytes, "words", |plain| {
        // Another vocabulary, and words that would be wrong in this one.
        plain[0] ^= 1;
        let end = plain.len();
        plain[end - 30..].fill(0);
    });
    let reloaded = MapFile::read(&other).unwrap();
    let (a, b) =
        (reloaded.snapshot.key_frames().next().unwrap(), saved.snapshot.key_frames().next().unwrap());
    assert!(!b.bag.is_empty() && a.bag == b.bag);
    let found = reloaded.snapshot.places().query(&b.bag, 1, |_| true);
    assert!(found.len() == 1 && found[0].1 > 0.999, "{found:?}");
    // The same damage to words of this vocabulary is refused.
    let wrong = with_part(&bytes, "words", |plain| {
        let end = plain.len();
        plain[end - 30..].fill(0xff);
    });
    assert!(MapFile::read(&wrong).unwrap_err().to_string().contains("part 'words'"));
}

#[test]
fn impossible_counts_do_not_allocate() {
    let bytes = small().write().unwrap();
    // The counts of key frames, of landmarks, and of features of the first key frame, as large as
    // possible.
    let about = Parts::open(&bytes, crate::store::VERSION).unwrap().get("about").unwrap().len();
    for (part, at) in [("about", about - 16), ("about", about - 12), ("key frames", 12)] {
        let wrong = with_part(&bytes, part, |plain| plain[at..at + 4].fill(0xff));
        let message = MapFile::read(&wrong).unwrap_err().to_string();
        assert!(message.contains("part '"), "{message}");
    }
}
