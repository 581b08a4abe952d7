//! Triangle meshes of the surface: whole and welded, or block by block.

mod draw;
mod first;
mod overview;
mod samples;
mod table;

pub use draw::draw;
pub(crate) use first::{Cell, FirstCells};
pub use overview::overview;

use crate::block::{BlockKey, KeyHasher, SIDE};
use crate::tsdf::TsdfVolume;
use samples::{CORNERS, JUMP, Samples, corner_index};
use std::collections::HashMap;
use std::hash::BuildHasherDefault;

/// Triangles with shared vertices; positions and normals are in the frame of the field they come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions in metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, towards free space; one for each position.
    pub normals: Vec<[f32; 3]>,
    /// Red, green, blue of each position; empty without colours.
    pub colours: Vec<[u8; 3]>,
    /// Corners of each triangle, counter-clockwise as seen from free space.
    pub triangles: Vec<[u32; 3]>,
}

/// How a surface is extracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshConfig {
    /// Voxels with less weight are left out; one near pixel contributes up to 31.
    pub least_weight: i32,
}

impl Default for MeshConfig {
    fn default() -> Self {
        Self { least_weight: 4 }
    }
}

impl MeshConfig {
    /// For fields of key frames, each of which may be the only one that saw a place: nothing is left out. From 1.5 m on
    /// one pixel of the default noise model weighs less than the default asks for.
    pub fn of_key_frames() -> Self {
        Self { least_weight: 1 }
    }
}

/// No vertex yet.
const NONE: u32 = u32::MAX;

type EdgeTable = HashMap<([i32; 3], usize), u32, BuildHasherDefault<KeyHasher>>;

/// Extracts meshes; reuses its memory from call to call.
#[derive(Clone)]
pub struct Mesher {
    config: MeshConfig,
    samples: Samples,
    /// Vertex on each edge that starts at a corner, by axis.
    vertices: Vec<[u32; 3]>,
    /// Corners whose entry in `vertices` is set.
    set: Vec<usize>,
    /// Vertices on edges that two or more blocks share.
    shared: EdgeTable,
    cells: Cells,
}

/// An edge of a cell among the block's corners: its axis, the numbers of its ends from the cell's own corner on, and where it starts.
#[derive(Clone, Copy)]
struct CellEdge {
    axis: usize,
    from: usize,
    to: usize,
    start: [usize; 3],
}

/// The corners and edges of a cell, and its triangles.
#[derive(Clone)]
struct Cells {
    corners: [usize; 8],
    edges: [CellEdge; 12],
    triangles: &'static [Vec<[table::Edge; 3]>],
}

impl Cells {
    fn new() -> Self {
        let edge = |e: usize| {
            let (axis, corner) = table::edge_start(e as table::Edge);
            let start = corner_at(corner);
            CellEdge {
                axis,
                from: corner_index(start),
                to: corner_index(corner_at(corner | 1 << axis)),
                start,
            }
        };
        Self {
            corners: std::array::from_fn(|i| corner_index(corner_at(i))),
            edges: std::array::from_fn(edge),
            triangles: &table::TRIANGLES,
        }
    }
}

/// Where a corner of a cell lies.
fn corner_at(i: usize) -> [usize; 3] {
    [i & 1, i >> 1 & 1, i >> 2]
}

impl Mesher {
    /// An extractor with empty memory.
    pub fn new(config: MeshConfig) -> Self {
        let vertices = vec![[NONE; 3]; CORNERS * CORNERS * CORNERS];
        let (samples, set, shared) = (Samples::default(), Vec::new(), EdgeTable::default());
        Self { config, samples, vertices, set, shared, cells: Cells::new() }
    }

    /// The whole surface: vertices on block borders are shared, so that it is closed wherever it was seen.
    pub fn whole(&mut self, volume: &TsdfVolume) -> Mesh {
        self.some(volume, volume.changed_since(0))
    }

    /// The surface in the cells of some blocks, welded.
    fn some(&mut self, volume: &TsdfVolume, keys: impl Iterator<Item = BlockKey>) -> Mesh {
        let mut mesh = Mesh::default();
        self.shared.clear();
        self.samples.begin();
        for key in keys {
            self.extract(volume, key, &mut mesh, true);
        }
        mesh.add_normals();
        mesh
    }

    /// The surface in the cells of one block. Its border passes through the same points as the borders of its
    /// neighbours.
    pub fn block(&mut self, volume: &TsdfVolume, key: BlockKey) -> Mesh {
        self.samples.begin();
        self.piece(volume, key)
    }

    /// The surface in the cells of each block that depends on what has changed since a revision of the field, as
    /// [`Self::block`] gives it; empty where there is none any more.
    pub fn changed<'a>(
        &'a mut self,
        volume: &'a TsdfVolume,
        revision: u64,
    ) -> impl Iterator<Item = (BlockKey, Mesh)> + 'a {
        self.samples.begin();
        let keys = Self::affected(volume.changed_since(revision));
        keys.into_iter().map(|key| (key, self.piece(volume, key)))
    }

    fn piece(&mut self, volume: &TsdfVolume, key: BlockKey) -> Mesh {
        let mut mesh = Mesh::default();
        self.extract(volume, key, &mut mesh, false);
        mesh.add_normals();
        mesh
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

    fn extract(&mut self, volume: &TsdfVolume, key: BlockKey, mesh: &mut Mesh, weld: bool) {
        // Taken out for the call: the corners' vertices are lent at the same time.
        let mut shared = std::mem::take(&mut self.shared);
        let place = Place::new(volume, key);
        self.each_cell(volume, key, &mut Build { place, volume, mesh, shared: &mut shared, weld });
        self.shared = shared;
    }

    /// Hands each cell of a block that the surface passes through to a sink, vertices before the triangles that use them.
    fn each_cell(&mut self, volume: &TsdfVolume, key: BlockKey, sink: &mut impl Sink) {
        if !self.samples.load(volume, key, self.config.least_weight) {
            return;
        }
        let Self { samples, vertices, set, cells, .. } = self;
        let cells: &Cells = cells;
        samples.live_cells(|cell, case| {
            let base = corner_index(cell);
            let steps = |offset: usize| samples.steps[base + offset];
            let edges = &cells.edges;
            let triangles = &cells.triangles[case];
            // Where all corners are about as far from the surface no edge is torn.
            let corners = cells.corners.map(steps);
            let (low, high) = corners.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
            let is_torn = |&e: &table::Edge| {
                let edge = &edges[e as usize];
                (steps(edge.from) - steps(edge.to)).abs() > JUMP
            };
            if high - low > JUMP && triangles.iter().flatten().any(is_torn) {
                return;
            }
            sink.cell(cell, &corners);
            for triangle in triangles {
                let corners = triangle.map(|e| {
                    let edge = &edges[e as usize];
                    let known = &mut vertices[base + edge.from][edge.axis];
                    if *known == NONE {
                        let part = steps(edge.from) / (steps(edge.from) - steps(edge.to));
                        let from = std::array::from_fn(|k| cell[k] + edge.start[k]);
                        *known = sink.vertex(samples, edge.axis, from, part);
                        set.push(base + edge.from);
                    }
                    *known
                });
                sink.triangle(corners);
            }
        });
        self.set.drain(..).for_each(|i| self.vertices[i] = [NONE; 3]);
    }
}

/// Takes the surface in a block, cell by cell.
trait Sink {
    /// The next cell, by its lowest corner among the block's, with the distances at its corners in steps.
    fn cell(&mut self, _cell: [usize; 3], _corners: &[f32; 8]) {}

    /// Number of a vertex on an edge; `part` is its position between the two corners, from 0 to 1. Each edge of a block is asked
    /// for once.
    fn vertex(&mut self, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32;

    /// A triangle of the last cell, by its vertices.
    fn triangle(&mut self, corners: [u32; 3]);
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
    fn voxel(&self, corner: [usize; 3]) -> [i32; 3] {
        std::array::from_fn(|i| self.key.0[i] * SIDE as i32 + corner[i] as i32)
    }

    /// Position of a vertex in metres: computed from the corner's whole number of voxels, so that neighbouring blocks agree on
    /// the borders to the last bit.
    fn position(&self, axis: usize, from: [usize; 3], part: f32) -> [f32; 3] {
        let whole = self.voxel(from);
        std::array::from_fn(|i| (whole[i] as f32 + 0.5 + if i == axis { part } else { 0.0 }) * self.voxel_m)
    }
}

/// Adds a block to a mesh.
struct Build<'a> {
    place: Place,
    volume: &'a TsdfVolume,
    mesh: &'a mut Mesh,
    shared: &'a mut EdgeTable,
    weld: bool,
}

impl Sink for Build<'_> {
    fn vertex(&mut self, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32 {
        let new = self.mesh.positions.len() as u32;
        if self.weld && from.iter().any(|&c| c == 0 || c == SIDE) {
            let known = *self.shared.entry((self.place.voxel(from), axis)).or_insert(new);
            if known != new {
                return known;
            }
        }
        self.mesh.positions.push(self.place.position(axis, from, part));
        if self.volume.config().colour {
            let mut to = from;
            to[axis] += 1;
            self.mesh.colours.push(self.colour(samples, from, to, part));
        }
        new
    }

    fn triangle(&mut self, corners: [u32; 3]) {
        self.mesh.triangles.push(corners);
    }
}

impl Build<'_> {
    /// Mean colour of the two voxels, weighted by nearness.
    fn colour(&self, samples: &Samples, from: [usize; 3], to: [usize; 3], part: f32) -> [u8; 3] {
        let mut sum = [0.0f32; 3];
        let mut total = 0.0f32;
        for (corner, share) in [(from, 1.0 - part), (to, part)] {
            let next = corner.map(|c| c / SIDE);
            let slot = samples.slots[next[0] | next[1] << 1 | next[2] << 2];
            let Some(colours) = slot.and_then(|s| self.volume.colours(s)) else { continue };
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
}

impl Mesh {
    /// Normals as the mean over the triangles around each vertex, weighted by area.
    fn add_normals(&mut self) {
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
