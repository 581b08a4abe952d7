//! Costs of place recognition: opening the vocabulary, computing bags of words, inserting into and querying the index.

use cairn_atlas::{KeyFrameId, PlaceIndex};
use cairn_random::Random;
use cairn_vision::Descriptor;
use cairn_vision::bow::{BagOfWords, Vocabulary};
use serde::Serialize;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

/// Milliseconds, each the minimum of many repetitions.
#[derive(Clone, Debug, Serialize)]
pub struct Times {
    /// Checking and opening the built-in vocabulary.
    pub open_ms: f64,
    /// BagOfWords of words of 1,000 descriptors.
    pub bag_ms: f64,
    /// Adding a key frame to an index of 1,000 of which another version is still in use.
    pub insert_ms: f64,
    /// Querying the best ten of an index of 1,000 key frames.
    pub query_ms: f64,
    /// Comparing two bags of words.
    pub similarity_ms: f64,
}

/// Measures; `frames` are descriptors of real images.
pub fn measure(frames: &[Vec<Descriptor>]) -> Times {
    let vocabulary = Vocabulary::embedded();
    let open_ms = minimum(20, || Vocabulary::open(vocabulary.bytes().to_vec()));
    let all: Vec<Descriptor> = frames.iter().flatten().copied().collect();
    let mut random = Random::new(7);
    // A thousand key frames that share words as frames of one building do: mixtures of real ones.
    let mut mixture = || -> Vec<Descriptor> {
        let from = random.below(all.len());
        (0..1000).map(|k| all[(from + k + random.below(300)) % all.len()]).collect()
    };
    let Some(first) = (!all.is_empty()).then(&mut mixture) else {
        return Times { open_ms, bag_ms: 0.0, insert_ms: 0.0, query_ms: 0.0, similarity_ms: 0.0 };
    };
    let bags: Vec<Arc<BagOfWords>> = (0..1001).map(|_| Arc::new(vocabulary.bag(&mixture()))).collect();
    let mut index = PlaceIndex::default();
    let ids: Vec<KeyFrameId> = (0..1001).filter_map(KeyFrameId::from_index).collect();
    for (id, bag) in ids.iter().zip(&bags).take(1000) {
        index.insert(*id, bag);
    }
    Times {
        open_ms,
        bag_ms: minimum(100, || vocabulary.bag(&first)),
        insert_ms: minimum(100, || {
            let mut next = index.clone();
            next.insert(ids[1000], &bags[1000]);
            next
        }),
        query_ms: minimum(100, || index.query(&bags[1000], 10, |_| true)),
        similarity_ms: minimum(100, || bags[0].similarity(&bags[1])),
    }
}

fn minimum<T>(times: usize, mut what: impl FnMut() -> T) -> f64 {
    let once = |_| {
        let began = Instant::now();
        black_box(what());
        began.elapsed().as_secs_f64() * 1e3
    };
    (0..times).map(once).fold(f64::INFINITY, f64::min)
}
