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
            if let Some(there) = all.get(&id(i)) {
                index.remove(id(i), there);
                all.remove(&id(i));
            }
            if insert {
                index.insert(id(i), &bag);
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
