//! The mesh of one block, built in memory that is used again: nothing is asked for while triangles are written, and what is handed out
//! is no larger than it must be.

use super::samples::Samples;
use super::{Mesh, Place, Sink, Triangles, colour};
use crate::block::SIDE;
use crate::tsdf::TsdfVolume;

/// More than the vertices of any block, one on each edge, and than its triangles; powers of two.
const VERTICES: usize = 2048;
const TRIANGLES: usize = 4096;
const _: () = assert!(3 * SIDE * (SIDE + 1) * (SIDE + 1) < VERTICES && 6 * SIDE * SIDE * SIDE < TRIANGLES);

/// Room for the mesh of a block.
#[derive(Clone)]
pub(super) struct Buffers {
    positions: [[f32; 3]; VERTICES],
    triangles: [[u32; 3]; TRIANGLES],
}

impl Default for Buffers {
    fn default() -> Self {
        Self { positions: [[0.0; 3]; VERTICES], triangles: [[0; 3]; TRIANGLES] }
    }
}

/// Takes the mesh of a block.
pub(super) struct Piece<'a> {
    place: Place,
    volume: &'a TsdfVolume,
    buffers: &'a mut Buffers,
    vertices: usize,
    triangles: usize,
    colours: Vec<[u8; 3]>,
}

impl<'a> Piece<'a> {
    pub fn new(place: Place, volume: &'a TsdfVolume, buffers: &'a mut Buffers) -> Self {
        Self { place, volume, buffers, vertices: 0, triangles: 0, colours: Vec::new() }
    }

    /// The mesh, without normals.
    pub fn end(self) -> Mesh {
        Mesh {
            positions: self.buffers.positions[..self.vertices].to_vec(),
            normals: Vec::new(),
            colours: self.colours,
            triangles: self.buffers.triangles[..self.triangles].to_vec(),
        }
    }
}

impl Sink for Piece<'_> {
    #[inline(always)]
    fn vertex(&mut self, samples: &Samples, axis: usize, from: [usize; 3], part: f32) -> u32 {
        let new = self.vertices;
        self.buffers.positions[new % VERTICES] = self.place.position(axis, from, part);
        if self.volume.config().colour {
            self.colours.push(colour(self.volume, samples, axis, from, part));
        }
        self.vertices += 1;
        new as u32
    }

    #[inline(always)]
    fn cell(&mut self, _: &Samples, _: usize, triangles: &Triangles, vertex: impl Fn(u16) -> u32) {
        let mut put = |at: usize, [a, b, c]: [u16; 3]| {
            self.buffers.triangles[at % TRIANGLES] = [vertex(a), vertex(b), vertex(c)];
        };
        // Most cells have one or two: to write two in any case takes less time than to look.
        put(self.triangles, triangles.first[0]);
        put(self.triangles + 1, triangles.first[1]);
        triangles.rest.iter().enumerate().for_each(|(i, &t)| put(self.triangles + 2 + i, t));
        self.triangles += triangles.count;
    }
}
