//! The 9x9x9 corners of a block's cells as bits, which cells the surface passes through, and the edges that it crosses.
//!
//! A corner's number is `x | y << 4 | z << 8`; a cell and an edge are numbered by their lowest corner. Bits are kept in rows
//! along x, sixteen rows a layer, so that the bits of a set, one after the other, are the numbers of what is in it.

use crate::Backend;
use crate::backend::dispatch;
use crate::block::SIDE;
use crate::pyramid::greater;
use crate::tsdf::{Bits, Planes, STEPS, TsdfVolume};

/// Corners along an edge of the block's grid of cells.
const CORNERS: usize = SIDE + 1;
/// Rows of a layer, and those of all layers.
const LAYER: usize = 16;
const ROWS: usize = CORNERS * LAYER;
/// From a corner to the next along each axis.
pub const STRIDES: [usize; 3] = [1, LAYER, LAYER * LAYER];
/// More than the number of any corner, a power of two.
pub const NUMBERS: usize = LAYER * LAYER * LAYER;

/// Corners of a block's cells, including those that belong to the next blocks.
#[derive(Clone)]
pub struct Samples {
    /// Distance in steps at the corners of live cells; anything at others.
    steps: Box<[f32; NUMBERS]>,
    inside: Rows,
    live: Rows,
    /// The edges of live cells that the surface crosses, by axis.
    pub edges: [Edges; 3],
    /// The live cells, and how many there are.
    cells: Box<List>,
    count: usize,
    /// Slots of the eight blocks that the corners come from: bit 0 of the index selects the next one along x, and so
    /// on.
    pub slots: [Option<u32>; 8],
}

/// Number of a corner.
pub fn corner_number(corner: [usize; 3]) -> usize {
    corner[0] * STRIDES[0] + corner[1] * STRIDES[1] + corner[2] * STRIDES[2]
}

/// The corner with a number.
#[inline(always)]
pub fn corner_of(number: usize) -> [usize; 3] {
    [number & 15, number >> 4 & 15, number >> 8]
}

/// The voxels of a block that does not exist.
const EMPTY: Bits = Bits { seen: [0; SIDE], inside: [0; SIDE] };

/// A set of corners, cells or edges, four rows a word. There are words of nothing before the first and behind the last, so that those
/// around a word can be read without looking where it lies.
#[derive(Clone, Copy)]
struct Rows([u64; LEAD + WORDS + LEAD]);

/// Words of all rows, those of a layer, and those before the first.
const WORDS: usize = ROWS / 4;
const LAYER_WORDS: usize = LAYER / 4;
const LEAD: usize = LAYER_WORDS + 1;

impl Rows {
    const EMPTY: Self = Self([0; LEAD + WORDS + LEAD]);

    /// The rows of a word.
    #[inline(always)]
    fn at(&self, word: usize) -> u64 {
        self.0[LEAD + word]
    }

    /// For each corner the next along y; the next along z; the next along both.
    #[inline(always)]
    fn next(&self, word: usize) -> [u64; 3] {
        let along_y = |word: usize| self.0[word] >> 16 | self.0[word + 1] << 48;
        [along_y(LEAD + word), self.0[LEAD + LAYER_WORDS + word], along_y(LEAD + LAYER_WORDS + word)]
    }

    /// For each corner the one before along y; the one before along z; the one before along both.
    #[inline(always)]
    fn before(&self, word: usize) -> [u64; 3] {
        let along_y = |word: usize| self.0[word] << 16 | self.0[word - 1] >> 48;
        [along_y(LEAD + word), self.0[word + LEAD - LAYER_WORDS], along_y(word + LEAD - LAYER_WORDS)]
    }

    /// One row.
    #[inline(always)]
    fn row(&self, row: usize) -> usize {
        (self.0[LEAD + row / 4] >> (row % 4 * 16) & 0xffff) as usize
    }

    /// The words that have members, one bit each.
    #[inline(always)]
    fn words(&self) -> u64 {
        let mut out = 0;
        for word in 0..WORDS {
            out |= u64::from(self.at(word) != 0) << word;
        }
        out
    }

    /// Lists the numbers of the members, and returns how many there are.
    #[inline(always)]
    fn list(&self, out: &mut List) -> usize {
        let (mut count, mut words) = (0, self.words());
        while words != 0 {
            let word = words.trailing_zeros() as usize % WORDS;
            words &= words - 1;
            let mut rest = self.at(word);
            let end = count + rest.count_ones() as usize;
            // Four at a time, whether there are so many or not: to look would take longer.
            while count < end {
                for number in &mut out[count..count + 4] {
                    *number = (64 * word + rest.trailing_zeros() as usize) as u16;
                    rest &= rest.wrapping_sub(1);
                }
                count += 4;
            }
            count = end;
        }
        count
    }
}

/// Numbers of corners, cells or edges; longer by four than the longest.
type List = [u16; SIDE * CORNERS * CORNERS + 4];

/// The edges along an axis that the surface crosses.
#[derive(Clone)]
pub struct Edges {
    numbers: Box<List>,
    /// Where it crosses each, from 0 to 1 between the two corners.
    parts: Box<[f32; SIDE * CORNERS * CORNERS + 4]>,
    count: usize,
}

impl Edges {
    fn new() -> Self {
        let length = [0; SIDE * CORNERS * CORNERS + 4];
        Self { numbers: Box::new(length), parts: Box::new(length.map(f32::from)), count: 0 }
    }

    /// Each with the position on it.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (numbers, parts) = (&self.numbers[..self.count], &self.parts[..self.count]);
        numbers.iter().zip(parts).map(|(&number, &part)| (usize::from(number), part))
    }
}

impl Default for Samples {
    fn default() -> Self {
        Self {
            steps: Box::new([0.0; NUMBERS]),
            inside: Rows::EMPTY,
            live: Rows::EMPTY,
            edges: std::array::from_fn(|_| Edges::new()),
            cells: Edges::new().numbers,
            count: 0,
            slots: [None; 8],
        }
    }
}

impl Samples {
    /// Takes the corners from a block and those that come next, its cells and edges; false when the surface passes through none of
    /// its cells.
    pub fn load(&mut self, volume: &TsdfVolume, slots: [Option<u32>; 8], least_weight: i32) -> bool {
        self.slots = slots;
        let mut bits = [&EMPTY; 8];
        for (bits, slot) in bits.iter_mut().zip(slots) {
            *bits = slot.map_or(&EMPTY, |slot| volume.bits(slot));
        }
        // Most blocks lie in front of the surface: nothing of them is behind it.
        let inside = bits.iter().flat_map(|b| &b.inside).fold(0, |any, layer| any | layer);
        if inside == 0 {
            return false;
        }
        let (bits, inside, live) = (&bits, &mut self.inside, &mut self.live);
        let any =
            dispatch!(Backend::best(), cells(bits: &[&Bits; 8], inside: &mut Rows, live: &mut Rows) -> bool);
        if any {
            self.cross(volume, least_weight);
        }
        any
    }

    /// Finds the edges of live cells that the surface crosses; cells with too little weight at a corner, or with an edge that is torn,
    /// are live no more.
    fn cross(&mut self, volume: &TsdfVolume, least_weight: i32) {
        let mut planes = [None; 8];
        for (planes, slot) in planes.iter_mut().zip(self.slots) {
            *planes = slot.map(|slot| volume.planes(slot));
        }
        let (planes, live, steps) = (&planes, &mut self.live, &mut *self.steps);
        dispatch!(Backend::best(), divide(
            planes: &[Option<&Planes>; 8], least_weight: i32, live: &mut Rows, steps: &mut [f32; NUMBERS]
        ) -> ());
        let samples = &mut *self;
        let torn = dispatch!(Backend::best(), crossings(samples: &mut Samples) -> bool);
        if torn {
            self.tear();
            let samples = &mut *self;
            dispatch!(Backend::best(), crossings(samples: &mut Samples) -> bool);
        }
    }

    /// Takes the cells out that have an edge which is torn.
    fn tear(&mut self) {
        let mut torn = [Rows::EMPTY; 3];
        for (axis, torn) in torn.iter_mut().enumerate() {
            for (edge, _) in self.edges[axis].iter() {
                let jump = (self.step(edge) - self.step(edge + STRIDES[axis])).abs();
                torn.0[LEAD + edge / 64] |= u64::from(jump > JUMP) << (edge % 64);
            }
        }
        for word in 0..WORDS {
            let ([x, y, z], [along_x, along_y, along_z]) =
                (torn.each_ref().map(|t| t.at(word)), torn.each_ref().map(|t| t.next(word)));
            let x = x | along_x[0] | along_x[1] | along_x[2];
            let (y, z) = (y | along_y[1], z | along_z[0]);
            self.live.0[LEAD + word] &= !(x | y | y >> 1 | z | z >> 1);
        }
    }

    /// Distance at a corner of a live cell.
    #[inline(always)]
    pub fn step(&self, corner: usize) -> f32 {
        self.steps[corner % NUMBERS]
    }

    /// Each live cell, and the set of its inside corners.
    #[inline(always)]
    pub fn live_cells(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.cells[..self.count].iter().map(|&number| {
            let number = usize::from(number);
            let (row, x) = (number / LAYER % (LAYER * SIDE), number % LAYER);
            let pair = |row: usize| self.inside.row(row) >> x & 3;
            (number, pair(row) | pair(row + 1) << 2 | pair(row + LAYER) << 4 | pair(row + LAYER + 1) << 6)
        })
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
        let words = &mut out.0[LEAD + LAYER_WORDS * z..][..3];
        words[0] = spread(own & 0xffff_ffff) | spread(x & 0xffff_ffff) << SIDE;
        words[1] = spread(own >> 32) | spread(x >> 32) << SIDE;
        words[2] = y & 255 | (both & 1) << SIDE;
    }
}

/// The corners behind the surface, and the cells that it passes through: all corners seen, some inside and some outside. False
/// where there is no such cell.
#[inline(always)]
fn cells(bits: &[&Bits; 8], inside: &mut Rows, live: &mut Rows) -> bool {
    let mut seen = Rows::EMPTY;
    widened(&mut seen, |block, z| bits[block].seen[z]);
    widened(inside, |block, z| bits[block].inside[z]);
    let mut any_live = 0;
    for word in 0..LAYER_WORDS * SIDE {
        let ([y, z, both], [y_in, z_in, both_in]) = (seen.next(word), inside.next(word));
        let all_seen = seen.at(word) & y & z & both;
        let all_inside = inside.at(word) & y_in & z_in & both_in;
        let any_inside = inside.at(word) | y_in | z_in | both_in;
        // No corners are seen behind the last row and column: no cell begins there.
        let live_cells =
            all_seen & all_seen >> 1 & (any_inside | any_inside >> 1) & !(all_inside & all_inside >> 1);
        live.0[LEAD + word] = live_cells;
        any_live |= live_cells;
    }
    any_live != 0
}

/// The edges of live cells between a corner inside and one outside, and where the surface crosses them; true where one is torn.
#[inline(always)]
fn crossings(samples: &mut Samples) -> bool {
    let Samples { steps, inside, live, edges, cells, count, .. } = samples;
    *count = live.list(cells);
    let mut found = [Rows::EMPTY; 3];
    for word in 0..WORDS {
        let (own, here) = (inside.at(word), live.at(word));
        let ([next_y, next_z, _], [y, z, both]) = (inside.next(word), live.before(word));
        found[0].0[LEAD + word] = (own ^ own >> 1) & (here | y | z | both);
        // An edge along y or z belongs to the cells on both sides along x, too.
        found[1].0[LEAD + word] = (own ^ next_y) & (here | z | (here | z) << 1);
        found[2].0[LEAD + word] = (own ^ next_z) & (here | y | (here | y) << 1);
    }
    let mut widest = 0.0f32;
    for (axis, (found, edges)) in found.iter().zip(edges).enumerate() {
        edges.count = found.list(&mut edges.numbers);
        let numbers = &edges.numbers[..edges.count];
        for (part, &number) in edges.parts.iter_mut().zip(numbers) {
            let number = usize::from(number);
            let (a, b) = (steps[number % NUMBERS], steps[(number + STRIDES[axis]) % NUMBERS]);
            *part = a / (a - b);
            widest = greater(widest, (a - b).abs());
        }
    }
    widest > JUMP
}

/// Distances at the corners of live cells, row by row: eight of a block and the first of the next along x. Cells with a corner of too
/// little weight are live no more.
#[inline(always)]
fn divide(planes: &[Option<&Planes>; 8], least_weight: i32, live: &mut Rows, steps: &mut [f32; NUMBERS]) {
    let (mut needed, mut enough) = (Rows::EMPTY, Rows::EMPTY);
    for word in 0..WORDS {
        let [y, z, both] = live.before(word);
        needed.0[LEAD + word] = live.at(word) | y | z | both;
    }
    let (mut rows, mut count) = ([0; ROWS + 1], 0);
    for row in 0..ROWS {
        rows[count] = row as u8;
        count += usize::from(needed.row(row) != 0);
    }
    let rows = &rows[..count];
    // All of them are asked for before the first is waited for: few are near to the processor.
    for &row in rows {
        let (block, from) = source(row);
        [block, block | 1].iter().filter_map(|&block| planes[block]).for_each(|planes| fetch(planes, from));
    }
    for &row in rows {
        let (block, from) = source(row);
        let row = usize::from(row);
        let to = &mut steps[LAYER * row..][..CORNERS];
        let mut bits = 0;
        if let Some(planes) = planes[block] {
            let (sum, weight) = (&planes.sum[from..from + SIDE], &planes.weight[from..from + SIDE]);
            for i in 0..SIDE {
                to[i] = sum[i] as f32 / weight[i].max(1) as f32;
            }
            for i in 0..SIDE {
                bits |= u32::from(weight[i] >= least_weight) << i;
            }
        }
        if let Some(planes) = planes[block | 1] {
            to[SIDE] = planes.sum[from] as f32 / planes.weight[from].max(1) as f32;
            bits |= u32::from(planes.weight[from] >= least_weight) << SIDE;
        }
        enough.0[LEAD + row / 4] |= u64::from(bits) << (row % 4 * 16);
    }
    for word in 0..LAYER_WORDS * SIDE {
        let [y, z, both] = enough.next(word);
        let all = enough.at(word) & y & z & both;
        live.0[LEAD + word] &= all & all >> 1;
    }
}

/// The block that a row of corners comes from, and its first voxel there.
#[inline(always)]
fn source(row: u8) -> (usize, usize) {
    let (y, z) = (usize::from(row) % LAYER, usize::from(row) / LAYER);
    ((y / SIDE) << 1 | (z / SIDE) << 2, SIDE * (y % SIDE + SIDE * (z % SIDE)))
}

/// Asks for distances and weights from a voxel on, so that they are near when they are read.
#[inline(always)]
fn fetch(planes: &Planes, from: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let (sum, weight) = (&planes.sum[from], &planes.weight[from]);
        #[allow(unsafe_code)]
        // SAFETY: a hint; nothing is read or written.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(sum).cast());
            _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(weight).cast());
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (planes, from);
}

/// Neighbouring distances that differ by more than this belong to two surfaces, one behind the other: there is no
/// surface between them.
const JUMP: f32 = 1.25 * STEPS as f32;
