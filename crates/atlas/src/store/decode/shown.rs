//! What of the features a map needs before they are read: the landmarks that they show, and how those appear.

use crate::store::container::Parts;
use crate::store::error::StoreError;
use crate::store::layout::SHOWN;
use crate::store::wire::Decoder;
use cairn_vision::{Descriptor, Octaves};

/// Descriptor of a landmark, pyramid level of its first observation, angle of its latest.
pub(super) type Appearance = (Descriptor, u8, f32);

/// The part `shown`.
pub(super) struct Shown {
    /// For each feature of all key frames the row (from 1) of the landmark that it shows.
    pub rows: Vec<u32>,
    /// How each landmark appears.
    pub appearances: Vec<Appearance>,
}

/// Reads the part for this many features and landmarks.
pub(super) fn read_shown(
    parts: &Parts,
    octaves: Octaves,
    features: usize,
    landmarks: usize,
) -> Result<Shown, StoreError> {
    let bytes = parts.get(SHOWN)?;
    let mut d = Decoder::new(SHOWN, &bytes);
    let rows = d.column_u32(features)?;
    let levels = d.bytes(landmarks)?;
    if levels.iter().any(|o| usize::from(*o) >= octaves.levels) {
        return Err(d.wrong("the octave of a landmark is outside the pyramid"));
    }
    let angles = d.column_f32(landmarks)?;
    if !angles.iter().all(|v| v.is_finite()) {
        return Err(d.wrong("the angle of a landmark is not finite"));
    }
    let descriptors = d.bytes(landmarks.saturating_mul(32))?.as_chunks().0;
    d.end()?;
    let appearances =
        descriptors.iter().zip(levels).zip(angles).map(|((d, level), angle)| (*d, *level, angle));
    Ok(Shown { rows, appearances: appearances.collect() })
}
