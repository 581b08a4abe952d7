//! Publishing: the index of all tiles by words, and `atlas.json`, which says what there is and what it was made from.

use crate::shelf::Shelf;
use crate::task::{Atlas, Published, Result as Found, Tile};
use crate::{FleetError, place_index};
use serde_json::json;
use std::collections::BTreeMap;

/// Writes index and description; `atlas.json` itself is put in place by whoever runs the step, also where it was done before.
pub(crate) fn publish(shelf: &Shelf, atlases: &[Atlas]) -> Result<Found, FleetError> {
    let mut tiles = Vec::new();
    for (n, atlas) in atlases.iter().enumerate() {
        let bytes = shelf.blob(atlas.tiles.digest)?;
        let list: Vec<(Tile, BTreeMap<u32, f32>)> = postcard::from_bytes(&bytes)
            .map_err(|e| FleetError::damaged(atlas.tiles.digest.to_string(), e))?;
        tiles.extend(list.into_iter().map(|(tile, words)| (n as u32, tile, words)));
    }
    let index = shelf.keep(&place_index::write(&tiles))?;
    let about = json!({
        "made_by": concat!("cairn ", env!("CARGO_PKG_VERSION")),
        "index": index,
        "tiles": tiles.len(),
        "atlases": atlases,
    });
    let bytes =
        serde_json::to_vec_pretty(&about).map_err(|e| FleetError::new("atlas.json", e, "report this"))?;
    Ok(Found::Published(Published { atlas: shelf.keep(&bytes)?, index, tiles: tiles.len() }))
}
