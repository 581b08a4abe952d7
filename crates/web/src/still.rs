//! A map that does not change, as messages for a viewer on the same machine: those that pages get, all at once.

use crate::columns::{Columns, SentColumns};
use crate::surface::{Sent, Surface};
use cairn_dense::{BlockKey, ColumnChange, Mesh};
use cairn_geometry::Se3;
use cairn_session::{Drawn, View};
use std::time::Instant;

/// What is shown of the depth of a map.
#[derive(Debug, Default)]
pub struct StillSurface {
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// The meshes of its blocks in the map, and tenths of a second from the beginning until each had a surface.
    pub blocks: Vec<(BlockKey, Mesh, u32)>,
    /// The columns.
    pub columns: ColumnChange,
}

/// The messages of a map; `docs/view.md` says how a viewer is told them.
pub fn still(view: &View, surface: StillSurface) -> Vec<Vec<u8>> {
    let mut out = vec![Drawn::of(view, &Drawn::default()).message(None)];
    let mut shown = Surface::default();
    shown.voxels(surface.voxel_m as f32);
    shown.place(0, &Se3::identity());
    for (key, mesh, born) in &surface.blocks {
        shown.set(0, *key, mesh, *born);
    }
    if !surface.blocks.is_empty() {
        out.extend(Sent::beside(Instant::now()).message(&shown, usize::MAX, Instant::now()));
    }
    let mut columns = Columns::default();
    columns.take(surface.columns, 0);
    out.extend(SentColumns::default().message(&columns, usize::MAX));
    out
}
