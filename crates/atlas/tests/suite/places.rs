//! The place index: its answers equal a comparison with every key frame, in every version.

use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, PlaceIndex, Snapshot};
use cairn_geometry::Se3;
use cairn_vision::Frame;
use cairn_vision::bow::{BagOfWords, WordId};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

fn id(i: usize) -> KeyFrameId {
    KeyFrameId::from_index(i).unwrap()
}

/// A bag with weights that sum to 1; word numbers from a small and a far range.
fn bag() -> impl Strategy<Value = BagOfWords> {
    prop::collection::btree_map(prop_oneof![0u32..40, 70_000u32..70_020], 1u32..50, 0..25).prop_map(|words| {
        let sum: u32 = words.values().sum();
        let words = words.into_iter().map(|(w, n)| (WordId(w), n as f32 / sum as f32)).collect();
        BagOfWords::from_parts(words, vec![]).unwrap()
    })
}

/// The answer by comparing with all key frames.
fn by_comparison(
    all: &BTreeMap<KeyFrameId, BagOfWords>,
    query: &BagOfWords,
    limit: usize,
) -> Vec<(KeyFrameId, f64)> {
    let mut found: Vec<(KeyFrameId, f64)> = all
        .iter()
        .map(|(k, b)| (*k, query.similarity(b)))
        .filter(|(k, s)| *s > 0.0 && k.index() % 5 != 3)
        .collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    found.truncate(limit);
    found
}

proptest! {
    #[test]
    fn index_equals_comparison_with_all(
        steps in prop::collection::vec((0usize..30, any::<bool>(), bag()), 1..60),
        query in bag(),
        limit in 0usize..12,
    ) {
        let (mut index, mut all) = (PlaceIndex::default(), BTreeMap::new());
        let mut versions = Vec::new();
        for (i, insert, bag) in steps {
            if all.contains_key(&id(i)) {
                index.remove(id(i));
                all.remove(&id(i));
            }
            if insert {
                index.insert(id(i), &Arc::new(bag.clone()));
                all.insert(id(i), bag);
            }
            versions.push((index.clone(), all.clone()));
        }
        for (index, all) in &versions {
            prop_assert_eq!(index.query(&query, limit, |k| k.index() % 5 != 3), by_comparison(all, &query, limit));
        }
    }

    #[test]
    fn snapshot_indexes_its_existing_key_frames(
        steps in prop::collection::vec((prop::option::of(0usize..20), bag()), 1..30),
        query in bag(),
    ) {
        let mut snapshot = Snapshot::new();
        for (remove, bag) in steps {
            let change = match remove {
                Some(i) => Change::RemoveKeyFrame(id(i)),
                None => {
                    let next = snapshot.next_key_frame_id();
                    let parent = snapshot.newest_key_frame().map(|k| k.id);
                    let k = KeyFrame::new(next, Arc::new(Frame::default()), Se3::identity(), parent);
                    Change::AddKeyFrame(Box::new(k.with_bag(Arc::new(bag))))
                }
            };
            snapshot = snapshot.apply(&ChangeSet { base: snapshot.version(), changes: vec![change] }).0;
            let all = snapshot.key_frames().map(|k| (k.id, (*k.bag).clone())).collect();
            prop_assert_eq!(snapshot.places().query(&query, 100, |k| k.index() % 5 != 3), by_comparison(&all, &query, 100));
        }
    }
}

/// Many key frames, so that older ones are in small and large groups: some are removed from each, some come back.
#[test]
fn large_index_equals_comparison_with_all() {
    let bag = |i: usize| {
        let words: BTreeMap<u32, u32> =
            (0..20).map(|n| (((i / 7 * 31 + i * n * n) % 60) as u32, 1 + ((i + n) % 5) as u32)).collect();
        let sum: u32 = words.values().sum();
        let words = words.into_iter().map(|(w, n)| (WordId(w), n as f32 / sum as f32)).collect();
        Arc::new(BagOfWords::from_parts(words, vec![]).unwrap())
    };
    let (mut index, mut all) = (PlaceIndex::default(), BTreeMap::new());
    let mut versions = Vec::new();
    for i in 0..1500 {
        index.insert(id(i), &bag(i));
        all.insert(id(i), (*bag(i)).clone());
        for gone in [i / 2, i - i % 6].into_iter().filter(|gone| gone % 3 == 1 || i % 6 == 5) {
            index.remove(id(gone));
            all.remove(&id(gone));
        }
        if i % 50 == 49 {
            index.insert(id(i / 3), &bag(i / 3));
            all.insert(id(i / 3), (*bag(i / 3)).clone());
            versions.push((index.clone(), all.clone()));
        }
    }
    assert!(all.len() > 700 && versions.len() == 30);
    let mut compared = 0;
    for (index, all) in &versions {
        for query in [3, 400, 1200].map(bag) {
            let found = index.query(&query, 40, |k| k.index() % 5 != 3);
            assert_eq!(found, by_comparison(all, &query, 40));
            compared += found.len();
        }
    }
    assert!(compared > 2000, "{compared}");
}
