//! The surface as pages draw it: meshes of blocks in the frames of their submaps, and where the submaps are.
//!
//! In: meshes of the blocks that have changed, poses of the submaps. Out: for each page what it lacks ([`Sent`]). A map that
//! is corrected moves the poses of submaps and no vertex. A block whose mesh changes by less than [`MOVED`] keeps the one it
//! has: what noise jiggles is not sent again.

mod sent;
mod work;

pub(crate) use sent::Sent;
pub(crate) use work::SurfaceWork;

use cairn_dense::{BlockKey, Mesh};
use cairn_geometry::Se3;
use std::collections::BTreeMap;

/// Units of a voxel's edge in which vertices are sent: a block is 8 voxels wide, and its cells reach half a voxel farther.
const UNITS: f32 = 4096.0;
/// A mesh is another one when a vertex has moved by this many units, a quarter of a voxel.
const MOVED: u16 = 1024;
/// A submap has another pose when it has moved by this: metres, and elements of the rotation matrix.
const MOVED_POSE: [f32; 2] = [1e-3, 5e-4];
/// Voxels along the edge of a block (see [`BlockKey`]).
const SIDE: f32 = 8.0;

/// A submap's pose in the map: rows of the rotation, each followed by its part of the translation.
type Pose = [f32; 12];
/// A block: the number of its submap, and its key there.
type Name = (u32, [i32; 3]);

/// The mesh of a block.
#[derive(Clone, Debug, PartialEq)]
struct Piece {
    /// From the corner of the block, in units of 1/4096 of a voxel.
    positions: Vec<[u16; 3]>,
    triangles: Vec<[u16; 3]>,
    /// Tenths of a second from the beginning until this block had a surface.
    born: u32,
    version: u64,
}

impl Piece {
    /// A mesh in whole numbers; `None` where it has no triangle or is not that of this block.
    fn of(mesh: &Mesh, key: BlockKey, voxel_m: f32) -> Option<Self> {
        let unit = voxel_m / UNITS;
        let corner = key.0.map(|k| k as f32 * SIDE * voxel_m);
        let mut positions = Vec::with_capacity(mesh.positions.len());
        for p in &mesh.positions {
            let at: [f32; 3] = std::array::from_fn(|i| ((p[i] - corner[i]) / unit).round());
            if !at.iter().all(|v| (0.0..=f32::from(u16::MAX)).contains(v)) {
                return None;
            }
            positions.push(at.map(|v| v as u16));
        }
        let corners = mesh.triangles.iter().map(|t| t.map(u16::try_from));
        let triangles: Option<Vec<[u16; 3]>> =
            corners.map(|[a, b, c]| Some([a.ok()?, b.ok()?, c.ok()?])).collect();
        let triangles = triangles.filter(|t| !t.is_empty() && t.len() <= usize::from(u16::MAX))?;
        Some(Self { positions, triangles, born: 0, version: 0 })
    }

    fn is_near(&self, other: &Self) -> bool {
        let near = |(a, b): (&[u16; 3], &[u16; 3])| (0..3).all(|i| a[i].abs_diff(b[i]) < MOVED);
        self.triangles == other.triangles
            && self.positions.len() == other.positions.len()
            && self.positions.iter().zip(&other.positions).all(near)
    }
}

/// A submap: where it is, and the meshes of its blocks.
#[derive(Clone, Debug)]
struct Part {
    pose: Pose,
    pieces: BTreeMap<[i32; 3], Piece>,
}

/// The surface of all submaps.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    voxel_m: f32,
    parts: BTreeMap<u32, Part>,
    /// What has changed, in the order in which it did: each block once.
    changes: BTreeMap<u64, Name>,
    /// The change at which a block was without a surface again, by its name; blocks that have one are not in it.
    empty: BTreeMap<Name, u64>,
    version: u64,
    /// Where the camera was last: what is near is sent first.
    camera: [f32; 3],
}

impl Surface {
    /// Where the camera is in the map.
    pub fn camera_at(&mut self, camera: [f32; 3]) {
        self.camera = camera;
    }

    /// The voxels of all submaps have this size, metres.
    pub fn voxels(&mut self, voxel_m: f32) {
        self.voxel_m = voxel_m;
    }

    /// A submap is here.
    pub fn place(&mut self, submap: u32, world_from_submap: &Se3) {
        let pose = rows(world_from_submap);
        let part = self.parts.entry(submap).or_insert_with(|| Part { pose, pieces: BTreeMap::new() });
        let moved = (0..12).any(|i| {
            let least = MOVED_POSE[usize::from(i % 4 != 3)];
            (pose[i] - part.pose[i]).abs() > least
        });
        if moved {
            part.pose = pose;
        }
    }

    /// Only these submaps are left.
    pub fn keep(&mut self, is_left: impl Fn(u32) -> bool) {
        self.parts.retain(|id, _| is_left(*id));
        self.changes.retain(|_, (id, _)| is_left(*id));
        self.empty.retain(|(id, _), _| is_left(*id));
    }

    /// The mesh of a block of a submap that is here; an empty one takes the block away. `now` is in tenths of a second.
    pub fn set(&mut self, submap: u32, key: BlockKey, mesh: &Mesh, now: u32) {
        let piece = Piece::of(mesh, key, self.voxel_m);
        let Some(part) = self.parts.get_mut(&submap) else { return };
        let (name, before) = ((submap, key.0), part.pieces.get(&key.0));
        match (before, &piece) {
            (None, None) => return,
            (Some(old), Some(new)) if old.is_near(new) => return,
            _ => {}
        }
        let born = before.map_or(now, |old| old.born);
        let last = before.map(|old| old.version).or_else(|| self.empty.remove(&name));
        if let Some(last) = last {
            self.changes.remove(&last);
        }
        self.version += 1;
        let version = self.version;
        self.changes.insert(version, name);
        match piece {
            Some(piece) => drop(part.pieces.insert(key.0, Piece { born, version, ..piece })),
            None => {
                part.pieces.remove(&key.0);
                self.empty.insert(name, version);
            }
        }
    }

    fn piece(&self, (submap, key): &Name) -> Option<&Piece> {
        self.parts.get(submap)?.pieces.get(key)
    }

    /// Distance of a block's middle from the camera, metres.
    fn away(&self, (submap, key): &Name) -> f32 {
        let Some(part) = self.parts.get(submap) else { return f32::MAX };
        let middle = key.map(|k| (k as f32 + 0.5) * SIDE * self.voxel_m);
        let squared = (0..3).map(|row| {
            let [a, b, c, t] = std::array::from_fn(|i| part.pose[4 * row + i]);
            (a * middle[0] + b * middle[1] + c * middle[2] + t - self.camera[row]).powi(2)
        });
        squared.sum::<f32>().sqrt()
    }
}

fn rows(pose: &Se3) -> Pose {
    let (r, t) = (pose.rotation.matrix(), pose.translation);
    std::array::from_fn(|i| if i % 4 == 3 { t[i / 4] } else { r[(i / 4, i % 4)] } as f32)
}
