//! Features of key frames.

use super::damage::Damage;
use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::layout::{CHUNK, FEATURES};
use crate::store::wire::Decoder;
use crate::{KeyFrame, Paged};
use cairn_sensor::Stamp;
use cairn_vision::bow::{BagOfWords, Vocabulary};
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
    let name = format!("{FEATURES}{i}");
    parts.get_into(&name, bytes)?;
    let frames = decode_features(&name, bytes, octaves, features, shown)?;
    for (k, mut frame) in chunk.iter_mut().zip(frames) {
        frame.stamp = k.stamp;
        frame.index(k.camera(camera));
        k.landmarks = vec![None; frame.len()];
        k.frame = Arc::new(frame).into();
    }
    Ok(())
}

/// The features in the bytes of a part, of key frames with these numbers of them, without stamps and lookup grids; appends the
/// landmark rows that they show.
pub(in crate::store) fn decode_features(
    name: &str,
    bytes: &[u8],
    octaves: Octaves,
    features: &[u32],
    shown: &mut Vec<u32>,
) -> Result<Vec<Frame>, StoreError> {
    let mut d = Decoder::new(name, bytes);
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
    let (mut start, mut frames) = (0, Vec::with_capacity(features.len()));
    for features in features {
        let span = start..start + *features as usize;
        let pairs = |c: &[Vec<f32>; 2]| -> Vec<[f32; 2]> {
            c[0][span.clone()].iter().zip(&c[1][span.clone()]).map(|(x, y)| [*x, *y]).collect()
        };
        let mut frame = Frame::default();
        frame.px = pairs(&px);
        frame.raw = raw.as_ref().map_or_else(|| frame.px.clone(), pairs);
        frame.octave = octave[span.clone()].to_vec();
        frame.angle = angle[span.clone()].to_vec();
        frame.descriptors = descriptors[span.clone()].to_vec();
        frame.right_x = right_x[span.clone()].to_vec();
        frame.depth = depth[span.clone()].to_vec();
        frames.push(frame);
        start = span.end;
    }
    Ok(frames)
}

/// The words of a key frame, computed.
pub(super) fn bag_of(k: &KeyFrame) -> Paged<BagOfWords> {
    Arc::new(Vocabulary::current().bag(&k.frame.descriptors)).into()
}
