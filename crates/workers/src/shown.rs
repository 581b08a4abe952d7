//! What has changed of the surfaces, from the process that makes them to the one with the pages.

use crate::anchored::{numbers, se3};
use cairn_dense::{BlockKey, Mesh, SurfaceChange};
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
}

impl Shown {
    /// In messages that fit, with numbers of submaps that begin at `first`.
    pub fn messages(change: SurfaceChange, first: u32) -> Vec<Self> {
        let submaps: Vec<_> = change.submaps.iter().map(|(n, pose)| (first + n, numbers(pose))).collect();
        let mut out = vec![Self { submaps: submaps.clone(), blocks: Vec::new() }];
        let mut length = 0;
        for (number, key, mesh) in change.blocks {
            length += 3 * (mesh.positions.len() + mesh.triangles.len() + 2);
            if length > AT_ONCE {
                out.push(Self { submaps: submaps.clone(), blocks: Vec::new() });
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
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se3, So3, Vec3};

    #[test]
    fn a_large_change_comes_in_messages_and_is_the_same_afterwards() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.1, 0.2, 0.3)), Vec3::new(1.0, 2.0, 3.0));
        let mesh = Mesh {
            positions: (0..9000).map(|i| [i as f32, 0.5, -1.0]).collect(),
            triangles: vec![[0, 1, 2]; 4000],
            ..Mesh::default()
        };
        let blocks: Vec<_> = (0..20).map(|i| (i % 2, BlockKey([i as i32, -3, 7]), mesh.clone())).collect();
        let change = SurfaceChange { submaps: vec![(0, Se3::identity()), (1, pose)], blocks };
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
        }
        let first = |n: &u32| n + (1 << 16);
        let numbers: Vec<u32> = change.submaps.iter().map(|(n, _)| first(n)).collect();
        assert_eq!(back.submaps.iter().map(|(n, _)| *n).collect::<Vec<_>>(), numbers);
        let blocks: Vec<_> = change.blocks.into_iter().map(|(n, key, mesh)| (first(&n), key, mesh)).collect();
        assert!(back.blocks == blocks);
        assert!((back.submaps[1].1.translation - pose.translation).norm() < 1e-12);
    }
}
