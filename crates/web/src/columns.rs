//! Columns as pages draw them: what is free and what is occupied above each cell of the ground, in tiles.
//!
//! In: tiles that have changed. Out: for each page what it lacks.
//!
//! A message is little-endian: kind 4, whether the page begins anew (one byte each), two bytes of nothing; two directions in the
//! ground and up in the map, the edge of a cell and the height of a step in metres (eleven 32-bit floats); then lists, each with its
//! count (32 bits) in front: tiles that are gone (two signed numbers of 32 bits: their places in edges of a tile), and tiles: place,
//! height of the lower end in steps (32 bits, signed), tenths of a second from the beginning until it was there (32 bits), and the
//! runs of 16 x 16 cells as [`ColumnTile`] has them.

use cairn_dense::ColumnChange;
use cairn_dense::walk::{ColumnAxes, ColumnTile};
use std::collections::BTreeMap;

const KIND: u8 = 4;
/// Bytes of a message without its lists, of a tile that is gone, and of a tile without its runs.
const HEAD: usize = 4 + 44 + 8;
const GONE: usize = 8;
const TILE: usize = 16;

struct Kept {
    tile: ColumnTile,
    born: u32,
    version: u64,
}

/// All tiles.
#[derive(Default)]
pub(crate) struct Columns {
    axes: Option<ColumnAxes>,
    /// Another whenever all begins anew.
    begun: u64,
    tiles: BTreeMap<[i32; 2], Kept>,
    version: u64,
}

impl Columns {
    /// Takes what has changed; `now` is in tenths of a second.
    pub fn take(&mut self, change: ColumnChange, now: u32) {
        if let Some(axes) = change.axes {
            let (begun, version) = (self.begun + 1, self.version);
            *self = Self { axes: Some(axes), begun, version, ..Self::default() };
        }
        change.gone.iter().for_each(|at| drop(self.tiles.remove(at)));
        for tile in change.tiles {
            self.version += 1;
            let born = self.tiles.get(&tile.at).map_or(now, |kept| kept.born);
            self.tiles.insert(tile.at, Kept { tile, born, version: self.version });
        }
    }
}

/// What a page has of them.
#[derive(Default)]
pub(crate) struct SentColumns {
    begun: u64,
    has: BTreeMap<[i32; 2], u64>,
}

impl SentColumns {
    /// The next message of at most `room` bytes; `None` where nothing is to be sent or nothing fits. What has waited longest is first.
    pub fn message(&mut self, columns: &Columns, room: usize) -> Option<Vec<u8>> {
        let axes = columns.axes?;
        let is_new = self.begun != columns.begun;
        let has = if is_new { BTreeMap::new() } else { std::mem::take(&mut self.has) };
        let (stays, goes): (BTreeMap<_, _>, BTreeMap<_, _>) =
            has.into_iter().partition(|(at, _)| columns.tiles.contains_key(at));
        let most = room.saturating_sub(HEAD) / GONE;
        let gone: Vec<[i32; 2]> = goes.keys().copied().take(most).collect();
        self.has = stays.into_iter().chain(goes.into_iter().skip(most)).collect();
        let mut waiting: Vec<&Kept> =
            columns.tiles.values().filter(|k| self.has.get(&k.tile.at) != Some(&k.version)).collect();
        waiting.sort_by_key(|kept| kept.version);
        let mut length = HEAD + GONE * gone.len();
        let fits = |kept: &&&Kept| {
            length += TILE + kept.tile.runs.len();
            length <= room
        };
        let tiles: Vec<&Kept> = waiting.iter().take_while(fits).copied().collect();
        if (gone.is_empty() && tiles.is_empty() && !(is_new && self.begun > 0)) || room < HEAD {
            return None;
        }
        self.begun = columns.begun;
        let mut out = vec![KIND, u8::from(is_new), 0, 0];
        let floats = axes.axes.iter().flat_map(|axis| axis.iter()).chain([&axes.cell_m, &axes.step_m]);
        floats.for_each(|v| out.extend((*v as f32).to_le_bytes()));
        out.extend((gone.len() as u32).to_le_bytes());
        gone.iter().flatten().for_each(|v| out.extend(v.to_le_bytes()));
        out.extend((tiles.len() as u32).to_le_bytes());
        for Kept { tile, born, version } in tiles {
            tile.at.iter().chain([&tile.base]).for_each(|v| out.extend(v.to_le_bytes()));
            out.extend(born.to_le_bytes());
            out.extend(&tile.runs);
            self.has.insert(tile.at, *version);
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_dense::walk::ColumnAxes;
    use cairn_geometry::Vec3;

    /// A tile with `steps` of something above each cell.
    fn tile(at: [i32; 2], steps: u8) -> ColumnTile {
        ColumnTile { at, base: -3, runs: [2, 1, 0x80 | (steps - 1)].repeat(256) }
    }

    fn change(tiles: Vec<ColumnTile>, gone: Vec<[i32; 2]>) -> ColumnChange {
        ColumnChange { axes: None, gone, tiles }
    }

    /// What a viewer has of each tile: the upper end of the span in its first cell.
    fn seen(page: &cairn_view::Columns) -> Vec<([i32; 2], i32)> {
        page.tiles.iter().map(|(at, tile)| (*at, tile.cells[0][0].ends[1])).collect()
    }

    #[test]
    fn page_that_takes_the_messages_has_the_columns() {
        let (mut columns, mut sent, mut page) =
            (Columns::default(), SentColumns::default(), cairn_view::Columns::default());
        assert_eq!(sent.message(&columns, usize::MAX), None);
        let axes = Some(ColumnAxes::new(&-Vec3::y(), 0.05));
        columns.take(
            ColumnChange {
                axes,
                tiles: (0..9).map(|k| tile([k, -k], 4)).collect(),
                ..change(vec![], vec![])
            },
            5,
        );
        // Two at a time, each as large as there is room.
        let mut messages = 0;
        while let Some(message) = sent.message(&columns, 2000) {
            assert!(message.len() <= 2000, "{} bytes", message.len());
            page.take(&message).unwrap();
            messages += 1;
        }
        assert_eq!((messages, page.tiles.len(), page.axes[2]), (5, 9, [0.0, -1.0, 0.0]));
        columns.take(change(vec![tile([3, -3], 9)], vec![[0, 0], [1, -1]]), 8);
        page.take(&sent.message(&columns, usize::MAX).unwrap()).unwrap();
        assert_eq!(sent.message(&columns, usize::MAX), None, "nothing has changed");
        let expected: Vec<_> = (2..9).map(|k| ([k, -k], if k == 3 { 8 } else { 3 })).collect();
        assert_eq!(seen(&page), expected);
        assert_eq!(page.tiles[&[3, -3]].born_s, 0.5, "it was there before");
        // Gravity is found: all begins anew, for a page that comes later too.
        let axes = Some(ColumnAxes::new(&Vec3::z(), 0.05));
        columns.take(ColumnChange { axes, ..change(vec![tile([7, 7], 2)], vec![]) }, 9);
        let mut late = cairn_view::Columns::default();
        for (sent, page) in [(&mut sent, &mut page), (&mut SentColumns::default(), &mut late)] {
            page.take(&sent.message(&columns, usize::MAX).unwrap()).unwrap();
            assert_eq!((seen(page), page.axes[2]), (vec![([7, 7], 1)], [0.0, 0.0, 1.0]));
        }
    }
}
