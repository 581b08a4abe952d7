//! The first cell of the surface on the ray of each pixel of a pinhole: where ray casts begin.

use super::cells::Triangles;
use super::draw::{Corner, Raster, check};
use super::rows::{corner_number, corner_of};
use super::samples::Samples;
use super::{Mesher, Place, Sink, corner_at};
use crate::block::BlockKey;
use crate::grid::BlockGrid;
use crate::view::Box2;
use crate::{DenseError, TsdfVolume};
use cairn_geometry::Se3;
use cairn_sensor::Camera;

/// A cell between eight voxel centres that the surface passes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cell {
    /// Distances at its corners in steps of the truncation distance; x varies fastest, then y, then z.
    pub steps: [f32; 8],
    /// Centre of its lowest voxel, in voxels.
    pub low: [f32; 3],
}

/// What [`Mesher::first_cells`] finds.
pub(crate) struct FirstCells {
    cells: Vec<Cell>,
    /// For each pixel the bits of the inverse depth of the nearest triangle (they have the order of the numbers), then the
    /// index of its cell; 0 without any.
    nearest: Vec<u64>,
}

impl FirstCells {
    /// Cell and depth along the optical axis that a pixel sees.
    #[inline(always)]
    pub fn at(&self, pixel: usize) -> Option<(&Cell, f32)> {
        let seen = self.nearest[pixel];
        let inverse = f32::from_bits((seen >> 32) as u32);
        self.cells.get(seen as u32 as usize).filter(|_| seen != 0).map(|cell| (cell, 1.0 / inverse))
    }

    /// One cell for each pixel, and their depths; 0 for none.
    #[cfg(test)]
    pub fn of(cells: Vec<Cell>, depths: &[f32]) -> Self {
        let seen = |(i, &z): (usize, &f32)| u64::from((1.0 / z).to_bits()) << 32 | i as u64;
        let nearest = depths.iter().enumerate().map(|d| if *d.1 > 0.0 { seen(d) } else { 0 }).collect();
        Self { cells, nearest }
    }
}

impl Mesher {
    /// Draws the triangles in view of a pinhole, and keeps the cell of the nearest for each pixel.
    ///
    /// # Errors
    /// An invalid camera, or one whose lens distorts; a pose that is not finite.
    pub(crate) fn first_cells(
        &mut self,
        volume: &TsdfVolume,
        camera: &Camera,
        volume_from_camera: &Se3,
        farthest_m: f64,
    ) -> Result<FirstCells, DenseError> {
        check(camera, volume_from_camera)?;
        let side = crate::block::SIDE as f64 * volume.config().voxel_m;
        let boxes = Box2::new(camera, volume_from_camera, side);
        let in_view = |key| boxes.of(key).filter(|(_, _, depth)| f64::from(depth[0]) < farthest_m);
        let mut keys: Vec<(f32, BlockKey)> =
            volume.changed_since(0).filter_map(|key| Some((in_view(key)?.2[0], key))).collect();
        // Nearest first: what is hidden is then hardly ever written.
        keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut out = FirstCells { cells: Vec::new(), nearest: vec![0; camera.width * camera.height] };
        let raster = Raster::new(camera, volume_from_camera);
        let (mut corners, grid) = (Vec::new(), BlockGrid::new(volume));
        for (_, key) in keys {
            corners.clear();
            let place = Place::new(volume, key);
            let steps = [0.0; 8];
            let mut sink =
                Draw { place, raster: &raster, corners: &mut corners, out: &mut out, cell: None, steps };
            self.each_cell(volume, grid.around(key), &mut sink);
        }
        Ok(out)
    }
}

/// Draws a block.
struct Draw<'a> {
    place: Place,
    raster: &'a Raster,
    corners: &'a mut Vec<Corner>,
    out: &'a mut FirstCells,
    /// The last cell: its lowest corner, until it is among the cells kept.
    cell: Option<[usize; 3]>,
    steps: [f32; 8],
}

impl Sink for Draw<'_> {
    fn vertex(&mut self, _: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32 {
        self.corners.push(self.raster.project(&self.place.position(axis, from, part)));
        (self.corners.len() - 1) as u32
    }

    fn cell(&mut self, samples: &Samples, cell: usize, triangles: &Triangles, vertex: impl Fn(u16) -> u32) {
        self.cell = Some(corner_of(cell));
        self.steps = std::array::from_fn(|i| samples.step(cell + corner_number(corner_at(i))));
        for corners in triangles.iter() {
            self.triangle(corners.map(&vertex));
        }
    }
}

impl Draw<'_> {
    fn triangle(&mut self, corners: [u32; 3]) {
        let Self { raster, corners: known, out: FirstCells { cells, nearest }, .. } = self;
        let number = (cells.len() - usize::from(self.cell.is_none())) as u64;
        let mut written = false;
        // Without a branch: on surfaces of small cells it would be mispredicted at every other pixel.
        raster.pixels(corners.map(|i| &known[i as usize]), |at, inverse, _| {
            let seen = u64::from(inverse.to_bits()) << 32 | number;
            let is_nearer = seen > nearest[at] | u64::from(u32::MAX);
            nearest[at] = if is_nearer { seen } else { nearest[at] };
            written |= is_nearer;
        });
        if let Some(lowest) = self.cell.take_if(|_| written) {
            let low = self.place.voxel(lowest).map(|v| v as f32 + 0.5);
            cells.push(Cell { steps: self.steps, low });
        }
    }
}
