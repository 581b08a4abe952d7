//! Features of key frames, and their words.

use super::damage::Damage;
use crate::KeyFrame;
use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::layout::CHUNK;
use crate::store::wire::Decoder;
use cairn_sensor::Stamp;
use cairn_vision::bow::{BagOfWords, Vocabulary, WordId};
use cairn_vision::{Frame, Octaves, RectifiedCamera};
use std::sync::Arc;

pub(super) fn empty_frame(stamp: Stamp) -> Frame {
    let mut frame = Frame::default();
    frame.stamp = stamp;
    frame
}

/// Reads the features of the key frames; returns the landmark row (from 1) that each feature shows.
pub(super) fn read_features(
    parts: &Parts,
    camera: &RectifiedCamera,
    octaves: Octaves,
    key_frames: &mut [KeyFrame],
    features: &[u32],
    damage: &mut Damage,
) -> Result<Vec<u32>, StoreError> {
    let (mut bytes, mut shown) = (Vec::new(), Vec::new());
    for (i, (chunk, features)) in key_frames.chunks_mut(CHUNK).zip(features.chunks(CHUNK)).enumerate() {
        let whole = shown.len();
        let count = chunk.len();
        let result = read_feature_part(parts, camera, octaves, i, chunk, features, (&mut bytes, &mut shown));
        let loss = format!("{count} key frames keep their poses, but show nothing");
        damage.or(result, &loss, || shown.truncate(whole))?;
    }
    Ok(shown)
}

/// Reads the features of a run of key frames, and appends the landmark rows that they show.
pub(super) fn read_feature_part(
    parts: &Parts,
    camera: &RectifiedCamera,
    octaves: Octaves,
    i: usize,
    chunk: &mut [KeyFrame],
    features: &[u32],
    (bytes, shown): (&mut Vec<u8>, &mut Vec<u32>),
) -> Result<(), StoreError> {
    let name = format!("features {i}");
    parts.get_into(&name, bytes)?;
    let mut d = Decoder::new(&name, bytes);
    let n = features.iter().map(|n| *n as usize).sum();
    let raw_is_px = d.u8()? != 0;
    let px = [d.column_f32(n)?, d.column_f32(n)?];
    let raw = if raw_is_px { None } else { Some([d.column_f32(n)?, d.column_f32(n)?]) };
    let (angle, right_x, depth) = (d.column_f32(n)?, d.column_f32(n)?, d.column_f32(n)?);
    shown.append(&mut d.column_u32(n)?);
    let octave = d.bytes(n)?;
    let (descriptors, _) = d.bytes(n.saturating_mul(32))?.as_chunks::<32>();
    let seen = px.iter().chain(raw.iter().flatten()).chain([&angle]);
    if !seen.flatten().all(|v| v.is_finite()) {
        return Err(d.wrong("a pixel is not finite"));
    }
    if octave.iter().any(|o| usize::from(*o) >= octaves.levels) {
        return Err(d.wrong("the octave of a feature is outside the pyramid"));
    }
    d.end()?;
    let mut start = 0;
    for (k, features) in chunk.iter_mut().zip(features) {
        let span = start..start + *features as usize;
        let pairs = |c: &[Vec<f32>; 2]| -> Vec<[f32; 2]> {
            c[0][span.clone()].iter().zip(&c[1][span.clone()]).map(|(x, y)| [*x, *y]).collect()
        };
        let mut frame = empty_frame(k.frame.stamp);
        frame.px = pairs(&px);
        frame.raw = raw.as_ref().map_or_else(|| frame.px.clone(), pairs);
        frame.octave = octave[span.clone()].to_vec();
        frame.angle = angle[span.clone()].to_vec();
        frame.descriptors = descriptors[span.clone()].to_vec();
        frame.right_x = right_x[span.clone()].to_vec();
        frame.depth = depth[span.clone()].to_vec();
        frame.index(k.camera(camera));
        k.landmarks = vec![None; frame.len()];
        k.frame = Arc::new(frame);
        start = span.end;
    }
    Ok(())
}

/// The words of a key frame, computed.
pub(super) fn bag_of(k: &KeyFrame) -> Arc<BagOfWords> {
    Arc::new(Vocabulary::current().bag(&k.frame.descriptors))
}

/// Reads the words of the key frames: those of the file if this program has the vocabulary that made them,
/// else computes them.
pub(super) fn read_words(parts: &Parts, key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    let bytes = parts.get("words")?;
    let mut d = Decoder::new("words", &bytes);
    let vocabulary = Vocabulary::current();
    let same = d.u32()? == vocabulary.facts().checksum;
    let (words, nodes) = (d.column_u32(key_frames.len())?, d.column_u32(key_frames.len())?);
    let sum = |v: &[u32]| v.iter().map(|n| *n as usize).sum::<usize>();
    let word_steps = d.column_u32(sum(&words))?;
    let weights = d.column_f32(sum(&words))?;
    let node_steps = d.column_u32(sum(&nodes))?;
    let features = d.column_u16(sum(&nodes))?;
    let (mut word_at, mut node_at) = (0, 0);
    for (i, k) in key_frames.iter_mut().enumerate() {
        let word_span = word_at..word_at + words[i] as usize;
        let node_span = node_at..node_at + nodes[i] as usize;
        (word_at, node_at) = (word_span.end, node_span.end);
        let bag = if same {
            let weighted = sums(&word_steps[word_span.clone()]).zip(&weights[word_span]);
            let passed = sums(&node_steps[node_span.clone()]).zip(&features[node_span]);
            let words = weighted.map(|(word, weight)| (WordId(word), *weight)).collect();
            let nodes = passed.map(|(node, feature)| (node, *feature)).collect();
            BagOfWords::from_parts(words, nodes).map_err(|e| d.wrong(e.to_string()))?
        } else if words[i] > 0 {
            vocabulary.bag(&k.frame.descriptors)
        } else {
            BagOfWords::default()
        };
        let known = vocabulary.facts().nodes;
        let valid = bag.words().last().is_none_or(|(word, _)| word.0 < known)
            && bag
                .nodes()
                .iter()
                .all(|(node, feature)| *node < known && usize::from(*feature) < k.frame.len());
        if !valid {
            return Err(d.wrong(format!("the words of {:?} are not in the vocabulary", k.id)));
        }
        k.bag = Arc::new(bag);
    }
    d.end()
}

/// Rising numbers from their differences; an overflow of 32 bits wraps around and is then refused as not
/// rising.
pub(super) fn sums(steps: &[u32]) -> impl Iterator<Item = u32> {
    steps.iter().scan(0u32, |sum, step| {
        *sum = sum.wrapping_add(*step);
        Some(*sum)
    })
}
