//! What only some key frames have, in a saved map: a part for each 64 key frames of which one has any. Programs that do not know
//! these parts leave them out.

use super::container::Parts;
use super::error::StoreError;
use super::layout::CHUNK;
use crate::KeyFrame;

/// The parts, with their names; `encode` gives that of a chunk, `None` where none of it has any.
pub(super) fn encode(
    prefix: &str,
    key_frames: &[&KeyFrame],
    encode: impl Fn(&[&KeyFrame]) -> Option<Vec<u8>>,
) -> Vec<(String, Vec<u8>)> {
    let chunks = key_frames.chunks(CHUNK).enumerate();
    chunks.filter_map(|(i, chunk)| Some((format!("{prefix}{i}"), encode(chunk)?))).collect()
}

/// Gives key frames what is in the parts that there are; `read` takes the name and the bytes of one.
pub(super) fn read(
    prefix: &str,
    parts: &Parts,
    key_frames: &mut [KeyFrame],
    read: impl Fn(&str, &[u8], &mut [KeyFrame]) -> Result<(), StoreError>,
) -> Result<(), StoreError> {
    for i in 0..key_frames.len().div_ceil(CHUNK) {
        let name = format!("{prefix}{i}");
        if parts.names().any(|n| n == name) {
            read(&name, &parts.get(&name)?, key_frames)?;
        }
    }
    Ok(())
}
