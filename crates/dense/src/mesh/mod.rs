//! Triangle meshes of the surface: whole and welded, or block by block.

mod cells;
mod depending;
mod draw;
mod edges;
mod first;
#[cfg(target_arch = "x86_64")]
mod kernel_x86;
mod live;
mod overview;
mod piece;
mod pieces;
mod rows;
mod samples;
mod table;

pub use draw::draw;
pub(crate) use first::{Cell, FirstCells};
pub use overview::overview;

use crate::Backend;
use crate::block::{BlockKey, KeyHasher, SIDE};
use crate::grid::{BlockGrid, NO_SLOT};
use crate::tsdf::TsdfVolume;
use cells::{CELLS, Triangles};
use depending::Depending;
use live::Live;
use piece::Buffers;
use rows::{MOST, corner_of};
use samples::Samples;
use std::collections::HashMap;
use std::hash::BuildHasherDefault;

/// Triangles with shared vertices; positions and normals are in the frame of the field they come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions in metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, towards free space; one for each position, or none: the mesh of a block has none, since those at its border
    /// would be those of its own triangles alone.
    pub normals: Vec<[f32; 3]>,
    /// Red, green, blue of each position; empty without colours.
    pub colours: Vec<[u8; 3]>,
    /// Corners of each triangle, counter-clockwise as seen from free space.
    pub triangles: Vec<[u32; 3]>,
}

/// How a surface is extracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshConfig {
    /// Voxels with less weight are left out; one near pixel contributes up to 31, less where its surface is seen at a slant.
    pub least_weight: i32,
}

impl Default for MeshConfig {
    fn default() -> Self {
        Self { least_weight: 8 }
    }
}

impl MeshConfig {
    /// For fields of key frames, each of which may be the only one that saw a place: nothing is left out. From 1.9 m on
    /// one pixel of the default noise model weighs less than the default asks for.
    pub fn of_key_frames() -> Self {
        Self { least_weight: 1 }
    }
}

type EdgeTable = HashMap<([i32; 3], usize), u32, BuildHasherDefault<KeyHasher>>;

/// Extracts meshes; reuses its memory from call to call.
#[derive(Clone)]
pub struct Mesher {
    config: MeshConfig,
    backend: Backend,
    /// Vertices on edges that two or more blocks share.
    shared: EdgeTable,
    depending: Depending,
    /// Room for the mesh of a block.
    buffers: Box<Buffers>,
}

/// Where a corner of a cell lies.
fn corner_at(i: usize) -> [usize; 3] {
    [i & 1, i >> 1 & 1, i >> 2]
}

impl Mesher {
    /// An extractor with empty memory.
    pub fn new(config: MeshConfig) -> Self {
        Self {
            config,
            backend: Backend::best(),
            shared: EdgeTable::default(),
            depending: Depending::default(),
            buffers: Box::default(),
        }
    }

    /// The same with these instructions, when the processor has them.
    pub fn with_backend(mut self, backend: Backend) -> Self {
        self.backend = if backend.available() { backend } else { Backend::Scalar };
        self
    }

    /// The whole surface: vertices on block borders are shared, so that it is closed wherever it was seen.
    pub fn whole(&mut self, volume: &TsdfVolume) -> Mesh {
        let mut mesh = Mesh::default();
        self.add(volume, volume.changed_since(0), &mut mesh);
        mesh.finish();
        mesh
    }

    /// Adds the surface in the cells of some blocks, welded to what was added to this mesh before; an empty one is begun.
    pub(crate) fn add(&mut self, volume: &TsdfVolume, keys: impl Iterator<Item = BlockKey>, mesh: &mut Mesh) {
        let grid = BlockGrid::new(volume);
        // Taken out for the call: the samples are lent at the same time.
        let mut shared = std::mem::take(&mut self.shared);
        if mesh.positions.is_empty() {
            shared.clear();
        }
        for key in keys {
            let place = Place::new(volume, key);
            let mut build = Build { place, volume, mesh: &mut *mesh, shared: &mut shared };
            self.each_cell(volume, grid.around(key), &mut build);
        }
        self.shared = shared;
    }

    /// The surface in the cells of one block, without normals. Its border passes through the same points as the borders of its
    /// neighbours.
    pub fn block(&mut self, volume: &TsdfVolume, key: BlockKey) -> Mesh {
        let slots = BlockGrid::Sparse(volume).around(key);
        let live = Live::find(volume, slots, self.backend);
        live.map_or_else(Mesh::default, |live| {
            self.buffers.mesh(volume, key, &live, self.config, self.backend)
        })
    }

    /// The surface in the cells of each block that depends on what has changed since a revision of the field, as
    /// [`Self::block`] gives it; empty where the surface passes through none of its cells.
    pub fn changed<'a>(
        &'a mut self,
        volume: &'a TsdfVolume,
        revision: u64,
    ) -> impl Iterator<Item = (BlockKey, Mesh)> + 'a {
        let Self { config, backend, depending, buffers, .. } = self;
        let (config, backend) = (*config, *backend);
        let mut blocks = depending.find(volume, revision).iter();
        let mut mesh =
            move |(key, live): (BlockKey, Live)| (key, buffers.mesh(volume, key, &live, config, backend));
        // One behind: what a block needs comes while the one before is meshed.
        let mut waiting: Option<(BlockKey, Live)> = None;
        std::iter::from_fn(move || {
            for &(key, slots) in blocks.by_ref() {
                let Some(live) = Live::find(volume, slots, backend) else {
                    return Some((key, Mesh::default()));
                };
                if let Some(before) = waiting.replace((key, live)) {
                    return Some(mesh(before));
                }
            }
            waiting.take().map(&mut mesh)
        })
    }

    /// Blocks whose mesh depends on one of the changed blocks: these and the ones before them along each axis,
    /// sorted, without duplicates.
    pub fn affected(changed: impl Iterator<Item = BlockKey>) -> Vec<BlockKey> {
        let before =
            |key: BlockKey| (0..8).map(move |i: i32| key.offset([-(i & 1), -(i >> 1 & 1), -(i >> 2)]));
        let mut out: Vec<BlockKey> = changed.flat_map(before).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// Hands each cell of a block that the surface passes through to a sink, all vertices of the block before.
    fn each_cell(&mut self, volume: &TsdfVolume, slots: [u32; 8], sink: &mut impl Sink) {
        let Some(live) = Live::find(volume, slots, self.backend) else { return };
        let Buffers { samples, vertices, .. } = &mut *self.buffers;
        samples.load(volume, &live, self.config.least_weight, self.backend);
        for ((place, part), vertex) in samples.edges.iter().zip(vertices.iter_mut()) {
            *vertex = sink.vertex(samples, place % 4, corner_of(place / 4), part);
        }
        for &place in samples.cells() {
            let cell = place as usize / 4;
            let vertex = |edge: u16| {
                vertices[usize::from(samples.edges.number(place as usize + usize::from(edge))) % MOST]
            };
            sink.cell(samples, cell, &CELLS[usize::from(samples.cases()[cell])], vertex);
        }
    }
}

/// Takes the surface in a block: vertices, then cells.
trait Sink {
    /// Number of a vertex on an edge; `part` is its position between the two corners, from 0 to 1. Each edge of a block is asked
    /// for once.
    fn vertex(&mut self, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32;

    /// A cell, by the number of its lowest corner, with its triangles: their corners by places, of which `vertex` gives the number.
    fn cell(&mut self, samples: &Samples, cell: usize, triangles: &Triangles, vertex: impl Fn(u16) -> u32);
}

/// Where a block lies.
struct Place {
    key: BlockKey,
    voxel_m: f32,
}

impl Place {
    fn new(volume: &TsdfVolume, key: BlockKey) -> Self {
        Self { key, voxel_m: volume.config().voxel_m as f32 }
    }

    /// The voxel at a corner.
    #[inline(always)]
    fn voxel(&self, corner: [usize; 3]) -> [i32; 3] {
        let at = |i: usize| self.key.0[i] * SIDE as i32 + corner[i] as i32;
        [at(0), at(1), at(2)]
    }

    /// Position of a vertex in metres: computed from the corner's whole number of voxels, so that neighbouring blocks agree on
    /// the borders to the last bit.
    #[inline(always)]
    fn position(&self, axis: usize, from: [usize; 3], part: f32) -> [f32; 3] {
        let [x, y, z] = self.voxel(from);
        let at = |whole: i32, along: usize| {
            (whole as f32 + 0.5 + if along == axis { part } else { 0.0 }) * self.voxel_m
        };
        [at(x, 0), at(y, 1), at(z, 2)]
    }
}

/// Adds a block to a mesh, welded to those before.
struct Build<'a> {
    place: Place,
    volume: &'a TsdfVolume,
    mesh: &'a mut Mesh,
    /// The vertices that blocks share.
    shared: &'a mut EdgeTable,
}

impl Sink for Build<'_> {
    fn vertex(&mut self, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32 {
        let new = self.mesh.positions.len() as u32;
        if from.iter().any(|&c| c == 0 || c == SIDE) {
            let known = *self.shared.entry((self.place.voxel(from), axis)).or_insert(new);
            if known != new {
                return known;
            }
        }
        self.mesh.positions.push(self.place.position(axis, from, part));
        if self.volume.config().colour {
            self.mesh.colours.push(colour(self.volume, samples, axis, from, part));
        }
        new
    }

    fn cell(&mut self, _: &Samples, _: usize, triangles: &Triangles, vertex: impl Fn(u16) -> u32) {
        self.mesh.triangles.extend(triangles.iter().map(|[a, b, c]| [vertex(a), vertex(b), vertex(c)]));
    }
}

/// Mean colour of the two voxels of an edge, weighted by nearness.
fn colour(volume: &TsdfVolume, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> [u8; 3] {
    let mut to = from;
    to[axis] += 1;
    let mut sum = [0.0f32; 3];
    let mut total = 0.0f32;
    for (corner, share) in [(from, 1.0 - part), (to, part)] {
        let next = corner.map(|c| c / SIDE);
        let slot = samples.slots[next[0] | next[1] << 1 | next[2] << 2];
        let Some(colours) = Some(slot).filter(|&s| s != NO_SLOT).and_then(|s| volume.colours(s)) else {
            continue;
        };
        let i = crate::block::index(corner.map(|c| c % SIDE));
        let count = colours.planes[3][i];
        if count > 0 {
            // A voxel exactly at the surface still takes a little of the other's colour.
            let share = (share + 1e-3) / count as f32;
            (0..3).for_each(|k| sum[k] += share * colours.planes[k][i] as f32);
            total += share * count as f32;
        }
    }
    sum.map(|s| if total > 0.0 { (s / total + 0.5) as u8 } else { 128 })
}

impl Mesh {
    /// Gives a mesh that was built by [`Mesher::add`] its normals: the mean over the triangles around each vertex, weighted by area.
    pub(crate) fn finish(&mut self) {
        self.normals.clear();
        self.normals.resize(self.positions.len(), [0.0; 3]);
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let (u, v): ([f32; 3], [f32; 3]) =
                (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            for &i in t {
                (0..3).for_each(|k| self.normals[i as usize][k] += n[k]);
            }
        }
        for n in &mut self.normals {
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            *n = if length > 0.0 { n.map(|v| v / length) } else { [0.0, 0.0, 1.0] };
        }
    }
}

#[cfg(test)]
mod tests;
