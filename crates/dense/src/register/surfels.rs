//! Points with normals of a surface, about evenly spread: one for each small cube of voxels that the surface passes
//! through, taken from distances and gradients near zero.

use crate::block::{BlockKey, KeyHasher, SIDE, VOXELS};
use crate::tsdf::{Planes, STEPS, TsdfVolume};
use std::collections::HashMap;
use std::hash::BuildHasherDefault;

/// Points and unit normals (towards free space), in metres of the field's frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Surfels {
    pub points: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Edge of the cubes in metres.
    pub cell_m: f32,
}

/// The surface inside one cube so far.
#[derive(Clone, Copy, Default)]
struct Cell {
    point: [f32; 3],
    normal: [f32; 3],
    count: f32,
}

/// Mean normals shorter than this belong to thin or rugged places whose direction means nothing.
const LEAST_NORMAL: f32 = 0.7;
/// A gradient this many times that of a surface seen head-on belongs to a silhouette.
const STEEP: f32 = 2.5;

/// The surfels of a field in cubes of at most `cell_m` (a power of two of voxels, so that blocks hold whole cubes).
pub(super) fn surfels(volume: &TsdfVolume, cell_m: f64) -> Surfels {
    let voxel = volume.config().voxel_m;
    let side = [8usize, 4, 2, 1].into_iter().find(|&s| s as f64 * voxel <= cell_m * 1.001).unwrap_or(1);
    let per_edge = SIDE / side;
    let mut out = Surfels { cell_m: (side as f64 * voxel) as f32, ..Surfels::default() };
    let mut cells = vec![Cell::default(); per_edge * per_edge * per_edge];
    let least = (side * side) as f32 * 0.35;
    for (key, slot) in volume.slots() {
        cells.fill(Cell::default());
        collect(volume.planes(slot), volume.config().band_voxels as f32, side, &mut cells);
        let corner = key.0.map(|v| (v * SIDE as i32) as f32);
        for cell in cells.iter().filter(|c| c.count >= least) {
            let mean = cell.normal.map(|v| v / cell.count);
            let length = mean.iter().map(|v| v * v).sum::<f32>().sqrt();
            if length < LEAST_NORMAL {
                continue;
            }
            out.normals.push(mean.map(|v| v / length));
            let voxel = voxel as f32;
            out.points.push(std::array::from_fn(|i| (corner[i] + cell.point[i] / cell.count) * voxel));
        }
    }
    out
}

/// Adds the voxels of a block within about half a voxel of the surface to its cubes; positions in voxels from the
/// block's corner.
fn collect(planes: &Planes, band_voxels: f32, side: usize, cells: &mut [Cell]) {
    let per_edge = SIDE / side;
    // A surface seen head-on has this gradient, in steps a voxel.
    let plain = STEPS as f32 / band_voxels;
    let steps = |i: usize| (planes.weight[i] > 0).then(|| planes.sum[i] as f32 / planes.weight[i] as f32);
    for i in 0..VOXELS {
        if planes.weight[i] <= 0 || planes.sum[i].abs() as f32 > plain * planes.weight[i] as f32 {
            continue;
        }
        let local = [i & 7, i >> 3 & 7, i >> 6];
        let gradient: [Option<f32>; 3] = std::array::from_fn(|axis| {
            let stride = 1usize << (3 * axis);
            let low = if local[axis] > 0 { i - stride } else { i };
            let high = if local[axis] + 1 < SIDE { i + stride } else { i };
            Some((steps(high)? - steps(low)?) / ((high - low) / stride) as f32)
        });
        let [Some(x), Some(y), Some(z)] = gradient else { continue };
        let length = (x * x + y * y + z * z).sqrt();
        if length < 0.3 * plain || length > STEEP * plain {
            continue;
        }
        let normal = [x, y, z].map(|v| v / length);
        let away = steps(i).unwrap_or(0.0) / length;
        if away.abs() > 0.75 {
            continue;
        }
        let [cx, cy, cz] = local.map(|v| v / side);
        let cell = &mut cells[cx + per_edge * (cy + per_edge * cz)];
        for k in 0..3 {
            cell.point[k] += local[k] as f32 + 0.5 - away * normal[k];
            cell.normal[k] += normal[k];
        }
        cell.count += 1.0;
    }
}

/// Points by cubes of one size: the numbers of those in a cube lie one after another.
pub(super) struct Cubes {
    by_side: f32,
    order: Vec<u32>,
    ranges: HashMap<BlockKey, [u32; 2], BuildHasherDefault<KeyHasher>>,
    /// Occupied cubes in a fixed order.
    keys: Vec<BlockKey>,
}

impl Cubes {
    pub fn new(points: &[[f32; 3]], side_m: f32) -> Self {
        let by_side = 1.0 / side_m;
        let mut sorted: Vec<(BlockKey, u32)> =
            points.iter().enumerate().map(|(i, p)| (key(p, by_side), i as u32)).collect();
        sorted.sort_unstable();
        let mut out = Self {
            by_side,
            order: sorted.iter().map(|s| s.1).collect(),
            ranges: HashMap::default(),
            keys: Vec::new(),
        };
        let mut begin = 0;
        for group in sorted.chunk_by(|a, b| a.0 == b.0) {
            let end = begin + group.len() as u32;
            out.ranges.insert(group[0].0, [begin, end]);
            out.keys.push(group[0].0);
            begin = end;
        }
        out
    }

    /// Occupied cubes, each with the numbers of its points.
    pub fn occupied(&self) -> impl Iterator<Item = (BlockKey, &[u32])> {
        self.keys.iter().map(|&key| (key, self.of(key)))
    }

    /// Numbers of the points in a cube.
    pub fn of(&self, key: BlockKey) -> &[u32] {
        self.ranges.get(&key).map_or(&[], |r| &self.order[r[0] as usize..r[1] as usize])
    }

    /// Numbers of the points in the cube of a place and in the 26 around it.
    pub fn around(&self, p: &[f32; 3]) -> impl Iterator<Item = u32> + '_ {
        let key = key(p, self.by_side);
        (0..27).flat_map(move |i| self.of(key.offset([i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])).iter().copied())
    }
}

/// The cube of a point; a diverged pose may have moved it anywhere.
fn key(p: &[f32; 3], by_side: f32) -> BlockKey {
    BlockKey(p.map(|v| (v * by_side).floor().clamp(-1e9, 1e9) as i32))
}
