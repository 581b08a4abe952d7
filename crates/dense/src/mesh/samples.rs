//! The 9x9x9 corners of a block's cells, those cells that the surface passes through, and the edges that it crosses.

use super::edges::Edges;
#[cfg(target_arch = "x86_64")]
use super::kernel_x86;
use super::live::{Live, bits};
use super::rows::{
    CELL_NUMBERS, CORNERS, LAYER, LAYER_WORDS, Layers, List, MOST, NUMBERS, PLACES, Rows, STRIDES, WORDS,
    row_in,
};
use crate::Backend;
use crate::backend::dispatch;
use crate::block::SIDE;
use crate::grid::NO_SLOT;
use crate::pyramid::greater;
use crate::tsdf::{Bits, Planes, STEPS, TsdfVolume};

/// Corners of a block's cells, including those that belong to the next blocks.
#[derive(Clone)]
pub struct Samples {
    /// Distance in steps at the corners of live cells; anything at others.
    steps: Box<[f32; NUMBERS]>,
    inside: Rows,
    live: Rows,
    /// The corners of live cells that have enough weight.
    enough: Rows,
    /// The edges of live cells that the surface crosses.
    pub edges: Edges,
    /// The same by axis, in rows.
    found: [Rows; 3],
    /// The places of the live cells, and how many there are.
    cells: Box<List>,
    count: usize,
    /// The set of inside corners of each live cell, by its number; anything for others.
    cases: Box<[u8; CELL_NUMBERS]>,
    /// Slots of the eight blocks that the corners come from, see [`Live::slots`].
    pub slots: [u32; 8],
}

impl Default for Samples {
    fn default() -> Self {
        Self {
            steps: Box::new([0.0; NUMBERS]),
            inside: Rows::EMPTY,
            live: Rows::EMPTY,
            enough: Rows::EMPTY,
            edges: Edges::default(),
            found: [Rows::EMPTY; 3],
            cells: Box::new([0; MOST]),
            count: 0,
            cases: Box::new([0; CELL_NUMBERS]),
            slots: [NO_SLOT; 8],
        }
    }
}

impl Samples {
    /// Takes the corners from a block and those that come next, its cells and edges. Cells with too little weight at a corner, or with
    /// an edge that is torn, are live no more.
    pub fn load(&mut self, volume: &TsdfVolume, live: &Live, least_weight: i32, backend: Backend) {
        self.slots = live.slots;
        self.rows(&bits(volume, live.slots), &live.cells, backend);
        let mut planes = [None; 8];
        for (planes, &slot) in planes.iter_mut().zip(&self.slots) {
            if slot != NO_SLOT {
                *planes = Some(volume.planes(slot));
            }
        }
        self.divide(&planes, live, least_weight, backend);
        if self.cross(backend) {
            self.tear();
            self.cross(backend);
        }
    }

    /// The corners behind the surface, and the live cells, in rows.
    fn rows(&mut self, bits: &[&Bits; 8], cells: &Layers, backend: Backend) {
        let (inside, live) = (&mut self.inside, &mut self.live);
        match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::rows(bits, cells, inside, live) },
            _ => {
                dispatch!(backend, rows(bits: &[&Bits; 8], cells: &Layers, inside: &mut Rows, live: &mut Rows) -> ())
            }
        }
    }

    /// Distances at the corners of live cells, and which have enough weight.
    fn divide(&mut self, planes: &[Option<&Planes>; 8], live: &Live, least_weight: i32, backend: Backend) {
        self.enough.clear();
        let (enough, steps) = (&mut self.enough, &mut *self.steps);
        match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe {
                kernel_x86::divide(planes, &live.rows, least_weight, steps, enough);
            },
            _ => {
                let rows = &live.rows;
                dispatch!(backend, divide_rows(planes: &[Option<&Planes>; 8], rows: &[u64; 8], least_weight: i32, steps: &mut [f32; NUMBERS], enough: &mut Rows) -> ())
            }
        }
    }

    /// Lists the live cells and the edges of them that the surface crosses, and finds where; true where one is torn.
    fn cross(&mut self, backend: Backend) -> bool {
        let samples = &mut *self;
        dispatch!(backend, crossings(samples: &mut Samples) -> ());
        self.list_cells(backend);
        self.edges.count = 0;
        for (axis, found) in self.found.iter().enumerate() {
            self.edges.count = list(found, axis, &mut self.edges.places, self.edges.count, backend);
        }
        let (edges, steps) = (&mut self.edges, &*self.steps);
        let widest = match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::divide_edges(steps, edges) },
            _ => divide_edges(steps, edges),
        };
        widest > JUMP
    }

    /// Takes the cells out that have an edge which is torn.
    fn tear(&mut self) {
        let mut torn = [Rows::EMPTY; 3];
        for (place, _) in self.edges.iter() {
            let (axis, edge) = (place % 4, place / 4);
            let jump = (self.step(edge) - self.step(edge + STRIDES[axis])).abs();
            *torn[axis].at_mut(edge / 64) |= u64::from(jump > JUMP) << (edge % 64);
        }
        for word in 0..WORDS {
            let ([x, y, z], [along_x, along_y, along_z]) =
                (torn.each_ref().map(|t| t.at(word)), torn.each_ref().map(|t| t.next(word)));
            let x = x | along_x[0] | along_x[1] | along_x[2];
            let (y, z) = (y | along_y[1], z | along_z[0]);
            *self.live.at_mut(word) &= !(x | y | y >> 1 | z | z >> 1);
        }
    }

    /// Distance at a corner of a live cell.
    #[inline(always)]
    pub fn step(&self, corner: usize) -> f32 {
        self.steps[corner % NUMBERS]
    }

    /// Lists the live cells, and finds the set of inside corners of each.
    fn list_cells(&mut self, backend: Backend) {
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx512 {
            let Self { inside, live, cells, cases, .. } = self;
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            let count = unsafe { kernel_x86::cells(inside, live, cells, cases) };
            self.count = count;
            return;
        }
        self.count = list(&self.live, 0, &mut self.cells, 0, backend);
        for &place in &self.cells[..self.count] {
            let number = place as usize / 4 % CELL_NUMBERS;
            let (row, x) = (number / LAYER, number % LAYER);
            let pair = |row: usize| self.inside.row(row) >> x & 3;
            let all = pair(row) | pair(row + 1) << 2 | pair(row + LAYER) << 4 | pair(row + LAYER + 1) << 6;
            self.cases[number] = all as u8;
        }
    }

    /// The places of the live cells.
    pub fn cells(&self) -> &[u32] {
        &self.cells[..self.count]
    }

    /// The sets of inside corners by the numbers of live cells.
    pub fn cases(&self) -> &[u8; CELL_NUMBERS] {
        &self.cases
    }
}

/// Four bytes, each in a row of its own.
#[inline(always)]
fn spread(bytes: u64) -> u64 {
    let pairs = (bytes | bytes << 16) & 0x0000_ffff_0000_ffff;
    (pairs | pairs << 8) & 0x00ff_00ff_00ff_00ff
}

/// Corners from 8x8x8 of the block, and the first of the next along each axis.
#[inline(always)]
fn widened(out: &mut Rows, layers: impl Fn(usize, usize) -> u64) {
    for z in 0..CORNERS {
        let (next, layer) = ((z / SIDE) << 2, z % SIDE);
        let (own, x) = (layers(next, layer), layers(next | 1, layer) & 0x0101_0101_0101_0101);
        let (y, both) = (layers(next | 2, layer), layers(next | 3, layer));
        let word = LAYER_WORDS * z;
        *out.at_mut(word) = spread(own & 0xffff_ffff) | spread(x & 0xffff_ffff) << SIDE;
        *out.at_mut(word + 1) = spread(own >> 32) | spread(x >> 32) << SIDE;
        *out.at_mut(word + 2) = y & 255 | (both & 1) << SIDE;
    }
}

/// The corners behind the surface, and the live cells, in rows.
#[inline(always)]
fn rows(bits: &[&Bits; 8], cells: &Layers, inside: &mut Rows, live: &mut Rows) {
    widened(inside, |block, z| bits[block].inside[z]);
    for (z, layer) in cells.iter().enumerate() {
        *live.at_mut(LAYER_WORDS * z) = spread(layer & 0xffff_ffff);
        *live.at_mut(LAYER_WORDS * z + 1) = spread(layer >> 32);
    }
}

/// Lists the places of cells or edges along an axis behind the first `count` of a list, and returns how many it has then.
fn list(rows: &Rows, axis: usize, out: &mut List, count: usize, backend: Backend) -> usize {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx512 {
        #[allow(unsafe_code)]
        // SAFETY: a backend is only chosen when the processor has its instructions.
        return unsafe { kernel_x86::list(rows, axis, out, count) };
    }
    dispatch!(backend, list_plainly(rows: &Rows, axis: usize, out: &mut List, count: usize) -> usize)
}

#[inline(always)]
fn list_plainly(rows: &Rows, axis: usize, out: &mut List, count: usize) -> usize {
    rows.list(axis, out, count)
}

/// Finds the edges of live cells between a corner inside and one outside. Cells with a corner of too little weight are live no more.
#[inline(always)]
fn crossings(samples: &mut Samples) {
    let Samples { inside, enough, live, found, .. } = samples;
    for word in 0..LAYER_WORDS * SIDE {
        let [y, z, both] = enough.next(word);
        let all = enough.at(word) & y & z & both;
        *live.at_mut(word) &= all & all >> 1;
    }
    for word in 0..WORDS {
        let (own, here) = (inside.at(word), live.at(word));
        let ([next_y, next_z, _], [y, z, both]) = (inside.next(word), live.before(word));
        *found[0].at_mut(word) = (own ^ own >> 1) & (here | y | z | both);
        // An edge along y or z belongs to the cells on both sides along x, too.
        *found[1].at_mut(word) = (own ^ next_y) & (here | z | (here | z) << 1);
        *found[2].at_mut(word) = (own ^ next_z) & (here | y | (here | y) << 1);
    }
}

/// Numbers edges, and finds where the surface crosses them; returns the greatest difference of the distances at both ends.
fn divide_edges(steps: &[f32; NUMBERS], edges: &mut Edges) -> f32 {
    let mut widest = 0.0f32;
    let Edges { places, parts, count, numbers, .. } = edges;
    for (i, (part, &place)) in parts.iter_mut().zip(&places[..*count]).enumerate() {
        numbers[place as usize % PLACES] = i as u16;
        let (number, axis) = (place as usize / 4, place as usize % 4);
        let (a, b) = (steps[number % NUMBERS], steps[(number + STRIDES[axis]) % NUMBERS]);
        *part = a / (a - b);
        widest = greater(widest, (a - b).abs());
    }
    widest
}

/// Distances of the rows of corners that are needed, eight of a block and the first of the next along x, and which corners have
/// enough weight.
#[inline(always)]
fn divide_rows(
    planes: &[Option<&Planes>; 8],
    rows: &[u64; 8],
    least_weight: i32,
    steps: &mut [f32; NUMBERS],
    enough: &mut Rows,
) {
    for (block, (planes, mut rest)) in planes.iter().zip(*rows).enumerate() {
        let Some(planes) = planes else { continue };
        while rest != 0 {
            let there = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (from, row) = (SIDE * there, row_in(block, there));
            let to = &mut steps[LAYER * row..][..LAYER];
            let bits = if block & 1 == 0 {
                divide_row::<SIDE>(planes, from, least_weight, to)
            } else {
                divide_row::<1>(planes, from, least_weight, &mut to[SIDE..]) << SIDE
            };
            *enough.at_mut(row / 4) |= bits << (row % 4 * 16);
        }
    }
}

/// Distances of `N` corners side by side, and a bit for each with enough weight.
#[inline(always)]
fn divide_row<const N: usize>(planes: &Planes, from: usize, least_weight: i32, to: &mut [f32]) -> u64 {
    let (sum, weight, to) = (&planes.sum[from..][..N], &planes.weight[from..][..N], &mut to[..N]);
    for i in 0..N {
        to[i] = sum[i] as f32 / weight[i].max(1) as f32;
    }
    (0..N).fold(0, |bits, i| bits | u64::from(weight[i] >= least_weight) << i)
}

/// Neighbouring distances that differ by more than this belong to two surfaces, one behind the other: there is no
/// surface between them.
const JUMP: f32 = 1.25 * STEPS as f32;
