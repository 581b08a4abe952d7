//! What has changed of the surfaces, from the process that makes them to the one with the pages.

use crate::anchored::{numbers, se3};
use cairn_dense::walk::{ColumnAxes, ColumnTile};
use cairn_dense::{BlockKey, ColumnChange, Mesh, SurfaceChange};
use cairn_geometry::Vec3;
use serde::{Deserialize, Serialize};

/// Numbers in the meshes of a message, about: far fewer than fit.
const AT_ONCE: usize = 200_000;

/// The number of a submap, the key of a block of it, and its mesh: positions and triangles.
type Block = (u32, [i32; 3], Vec<[f32; 3]>, Vec<[u32; 3]>);

/// As [`SurfaceChange`]; poses are seven numbers as in [`crate::message::Anchored`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    submaps: Vec<(u32, [f64; 7])>,
    blocks: Vec<Block>,
    columns: ShownColumns,
}

/// As [`ColumnChange`]: axes with the edge of a cell and the height of a step, tiles that are gone, and tiles with the height of their lower
/// end and their runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct ShownColumns {
    axes: Option<([[f64; 3]; 3], [f64; 2])>,
    gone: Vec<[i32; 2]>,
    tiles: Vec<([i32; 2], i32, Vec<u8>)>,
}

impl ShownColumns {
    fn of(change: ColumnChange) -> Self {
        let axes = change.axes.map(|a| (a.axes.map(|v| [v.x, v.y, v.z]), [a.cell_m, a.step_m]));
        let tiles = change.tiles.into_iter().map(|tile| (tile.at, tile.base, tile.runs));
        Self { axes, gone: change.gone, tiles: tiles.collect() }
    }

    fn into_change(self) -> ColumnChange {
        let axes = self.axes.map(|(axes, [cell_m, step_m])| ColumnAxes {
            axes: axes.map(Vec3::from),
            cell_m,
            step_m,
        });
        let tiles = self.tiles.into_iter().map(|(at, base, runs)| ColumnTile { at, base, runs });
        ColumnChange { axes, gone: self.gone, tiles: tiles.collect() }
    }
}

impl Shown {
    /// In messages that fit, with numbers of submaps that begin at `first`.
    pub fn messages(change: SurfaceChange, first: u32) -> Vec<Self> {
        let submaps: Vec<_> = change.submaps.iter().map(|(n, pose)| (first + n, numbers(pose))).collect();
        let columns = ShownColumns::of(change.columns);
        let mut out = vec![Self { submaps: submaps.clone(), blocks: Vec::new(), columns }];
        let mut length = 0;
        for (number, key, mesh) in change.blocks {
            length += 3 * (mesh.positions.len() + mesh.triangles.len() + 2);
            if length > AT_ONCE {
                let columns = ShownColumns::default();
                out.push(Self { submaps: submaps.clone(), blocks: Vec::new(), columns });
                length = 0;
            }
            if let Some(last) = out.last_mut() {
                last.blocks.push((first + number, key.0, mesh.positions, mesh.triangles));
            }
        }
        out
    }

    /// Back; `None` when a pose is none.
    pub fn into_change(self) -> Option<SurfaceChange> {
        let submaps = self.submaps.iter().map(|(n, pose)| Some((*n, se3(pose)?)));
        let mesh = |(number, key, positions, triangles): Block| {
            (number, BlockKey(key), Mesh { positions, triangles, ..Mesh::default() })
        };
        Some(SurfaceChange {
            submaps: submaps.collect::<Option<_>>()?,
            blocks: self.blocks.into_iter().map(mesh).collect(),
            columns: self.columns.into_change(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se3, So3};

    #[test]
    fn a_large_change_comes_in_messages_and_is_the_same_afterwards() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(1.0, 2.0, 3.0));
        let mesh = Mesh {
            positions: (0..9000).map(|i| [i as f32, 0.5, -1.0]).collect(),
            triangles: vec![[0, 1, 2]; 4000],
            ..Mesh::default()
        };
        let blocks: Vec<_> = (0..20).map(|i| (i % 2, BlockKey([i as i32, -3, 7]), mesh.clone())).collect();
        let tile = ColumnTile { at: [-3, 4], base: -7, runs: [1, 0x45].repeat(256) };
        let axes = Some(ColumnAxes::new(&Vec3::z(), 0.05));
        let columns = ColumnChange { axes, gone: vec![[1, 2]], tiles: vec![tile] };
        let change = SurfaceChange { submaps: vec![(0, Se3::identity()), (1, pose)], blocks, columns };
        let messages = Shown::messages(change.clone(), 1 << 16);
        assert!(messages.len() > 2, "{} messages", messages.len());
        let mut back = SurfaceChange::default();
        for message in messages {
            let bytes = postcard::to_stdvec(&message).expect("bytes");
            assert!(bytes.len() < 4 << 20, "{} bytes", bytes.len());
            let part =
                postcard::from_bytes::<Shown>(&bytes).expect("a message").into_change().expect("poses");
            back.submaps = part.submaps;
            back.blocks.extend(part.blocks);
            back.columns.axes = back.columns.axes.or(part.columns.axes);
            back.columns.gone.extend(part.columns.gone);
            back.columns.tiles.extend(part.columns.tiles);
        }
        assert_eq!(back.columns, change.columns);
        let first = |n: &u32| n + (1 << 16);
        let numbers: Vec<u32> = change.submaps.iter().map(|(n, _)| first(n)).collect();
        assert_eq!(back.submaps.iter().map(|(n, _)| *n).collect::<Vec<_>>(), numbers);
        let blocks: Vec<_> = change.blocks.into_iter().map(|(n, key, mesh)| (first(&n), key, mesh)).collect();
        assert!(back.blocks == blocks);
        assert!((back.submaps[1].1.translation - pose.translation).norm() < 1e-12);
    }
}
