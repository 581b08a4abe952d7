//! Words of key frames, and the index of places made of them.

use crate::places::PlaceIndexBuilder;
use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::later::LaterFeatures;
use crate::store::wire::Decoder;
use crate::{KeyFrameId, Paged, PlaceIndex};
use cairn_vision::Frame;
use cairn_vision::bow::{BagOfWords, Vocabulary, WordId};
use std::sync::Arc;

/// What the words belong to: for each key frame its id, its features, and how many they are.
pub(super) struct Owners {
    pub ids: Vec<KeyFrameId>,
    pub frames: Vec<Paged<Frame>>,
    pub features: Vec<u32>,
}

/// Reads the words of the key frames: those of the file if this program has the vocabulary that made them,
/// else computes them. With `later`, key frames compute theirs again when somebody looks at them.
pub(super) fn read_words(
    parts: &Parts,
    owners: &Owners,
    later: Option<&Arc<LaterFeatures>>,
) -> Result<(Vec<Paged<BagOfWords>>, PlaceIndex), StoreError> {
    let count = owners.ids.len();
    let bytes = parts.get("words")?;
    let mut d = Decoder::new("words", &bytes);
    let vocabulary = Vocabulary::current();
    let (known, same) = (vocabulary.facts().nodes, d.u32()? == vocabulary.facts().checksum);
    let (words, nodes) = (d.column_u32(count)?, d.column_u32(count)?);
    let sum = |v: &[u32]| v.iter().map(|n| *n as usize).sum::<usize>();
    let word_steps = d.column_u32(sum(&words))?;
    let weights = d.column_f32(sum(&words))?;
    let (node_steps, features) = match later {
        None => (d.column_u32(sum(&nodes))?, d.column_u16(sum(&nodes))?),
        // Nobody needs them before the features.
        Some(_) => {
            d.bytes(sum(&nodes).saturating_mul(6))?;
            (Vec::new(), Vec::new())
        }
    };
    let (mut word_at, mut node_at) = (0, 0);
    let mut places = PlaceIndexBuilder::default();
    let mut bags = Vec::with_capacity(count);
    for (i, id) in owners.ids.iter().enumerate() {
        let word_span = word_at..word_at + words[i] as usize;
        let node_span = node_at..node_at + nodes[i] as usize;
        (word_at, node_at) = (word_span.end, node_span.end);
        let has_words = words[i] > 0 || nodes[i] > 0;
        let bag = if same {
            let weighted = sums(&word_steps[word_span.clone()]).zip(&weights[word_span]);
            let words = weighted.map(|(word, weight)| (WordId(word), *weight)).collect();
            let nodes = match later {
                None => {
                    let passed = sums(&node_steps[node_span.clone()]).zip(&features[node_span]);
                    passed.map(|(node, feature)| (node, *feature)).collect()
                }
                Some(_) => Vec::new(),
            };
            BagOfWords::from_parts(words, nodes).map_err(|e| d.wrong(e.to_string()))?
        } else if words[i] > 0 {
            vocabulary.bag(&owners.frames[i].descriptors)
        } else {
            BagOfWords::default()
        };
        let in_features =
            |(node, feature): &(u32, u16)| *node < known && u32::from(*feature) < owners.features[i];
        if bag.words().last().is_some_and(|(word, _)| word.0 >= known) || !bag.nodes().iter().all(in_features)
        {
            return Err(d.wrong(format!("the words of {id:?} are not in the vocabulary")));
        }
        let bag = Arc::new(bag);
        bags.push(match later {
            Some(later) if has_words => later.words(i),
            _ => bag.clone().into(),
        });
        places.insert(*id, bag);
    }
    d.end()?;
    Ok((bags, places.finish()))
}

/// Rising numbers from their differences; an overflow of 32 bits wraps around and is then refused as not
/// rising.
pub(super) fn sums(steps: &[u32]) -> impl Iterator<Item = u32> {
    steps.iter().scan(0u32, |sum, step| {
        *sum = sum.wrapping_add(*step);
        Some(*sum)
    })
}
