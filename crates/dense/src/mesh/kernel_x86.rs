//! Versions of the loops of [`super::samples`] and [`super::piece`] with the instructions of [`crate::Backend::Avx512`]: the same operations,
//! bit-identical results.
#![allow(unsafe_code)]

use super::Place;
use super::cells::{MOST_TRIANGLES, Triangles};
use super::edges::Edges;
use super::rows::{
    CELL_NUMBERS, CORNERS, LAYER, Layers, List, MOST, NUMBERS, PLACES, Rows, STRIDES, pairs, row_in,
};
use crate::block::SIDE;
use crate::tsdf::{Bits, Planes};
use std::arch::x86_64::*;

/// The corners behind the surface, and the live cells, in rows.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
pub unsafe fn rows(bits: &[&Bits; 8], cells: &Layers, inside: &mut Rows, live: &mut Rows) {
    for z in 0..CORNERS {
        let (next, z_there) = ((z / SIDE) << 2, z % SIDE);
        let layer = |block: usize| bits[next | block].inside[z_there] as i64;
        // Eight rows of a block, and the first of the next along y; the same of the last corners.
        let own = _mm256_cvtepu8_epi16(_mm_set_epi64x(layer(2) & 255, layer(0)));
        let last = _mm_set_epi64x(layer(3) & 1, layer(1) & 0x0101_0101_0101_0101);
        let last = _mm256_slli_epi16::<{ SIDE as i32 }>(_mm256_cvtepu8_epi16(last));
        let to = inside.layer_mut(z);
        // SAFETY: four words.
        unsafe { _mm256_storeu_si256(to.as_mut_ptr().cast(), _mm256_or_si256(own, last)) };
    }
    for (z, &layer) in cells.iter().enumerate() {
        let rows = _mm_cvtepu8_epi16(_mm_cvtsi64_si128(layer as i64));
        // SAFETY: two of four words.
        unsafe { _mm_storeu_si128(live.layer_mut(z).as_mut_ptr().cast(), rows) };
    }
}

/// The cells of a block that the surface passes through, some of their corners inside and some outside; returns the rows along x that have some, and those of which
/// the last is one.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw")]
pub unsafe fn live(bits: &[&Bits; 8], out: &mut Layers) -> [u64; 2] {
    // SAFETY: eight words each.
    let load = |layers: &Layers| unsafe { _mm512_loadu_si512(layers.as_ptr().cast()) };
    let inside = bits.map(|b| load(&b.inside));
    let any = inside.into_iter().fold(_mm512_setzero_si512(), |any, layers| _mm512_or_si512(any, layers));
    if _mm512_test_epi64_mask(any, any) == 0 {
        return [0; 2];
    }
    let seen = bits.map(|b| load(&b.seen));
    let all_seen = corners(&seen, |a, b| _mm512_and_si512(a, b));
    let all_inside = corners(&inside, |a, b| _mm512_and_si512(a, b));
    let any_inside = corners(&inside, |a, b| _mm512_or_si512(a, b));
    let cells = _mm512_and_si512(all_seen, _mm512_andnot_si512(all_inside, any_inside));
    // SAFETY: eight words.
    unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), cells) };
    [_mm512_test_epi8_mask(cells, cells), _mm512_movepi8_mask(cells)]
}

/// For each cell what joins the bits of its eight corners, of which the layers of the eight blocks around it are given.
#[target_feature(enable = "avx512f,avx512bw")]
fn corners(layers: &[__m512i; 8], join: impl Fn(__m512i, __m512i) -> __m512i) -> __m512i {
    let column = |i: usize| join(layers[i], _mm512_alignr_epi64::<1>(layers[i | 4], layers[i]));
    let last = _mm512_set1_epi8(-128);
    let along_x = |own: __m512i, next: __m512i| {
        let after = _mm512_andnot_si512(last, _mm512_srli_epi64::<1>(own));
        let first = _mm512_and_si512(last, _mm512_slli_epi64::<7>(next));
        join(own, _mm512_or_si512(after, first))
    };
    let (near, far) = (along_x(column(0), column(1)), along_x(column(2), column(3)));
    join(near, _mm512_or_si512(_mm512_srli_epi64::<8>(near), _mm512_slli_epi64::<56>(far)))
}

/// Distances of the rows of corners that are needed, two at a time, and which corners have enough weight.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512dq,avx512vl,bmi1")]
pub unsafe fn divide(
    planes: &[Option<&Planes>; 8],
    rows: &[u64; 8],
    least_weight: i32,
    steps: &mut [f32; NUMBERS],
    enough: &mut Rows,
) {
    let (least, one) = (_mm512_set1_epi32(least_weight), _mm512_set1_epi32(1));
    for block in (0..8).step_by(2) {
        if let Some(planes) = planes[block] {
            let mut pairs = pairs(rows[block]);
            while pairs != 0 {
                let there = pairs.trailing_zeros() as usize;
                pairs &= pairs - 1;
                let (from, row) = (SIDE * there, row_in(block, there));
                let (sum, weight) =
                    (&planes.sum[from..from + 2 * SIDE], &planes.weight[from..from + 2 * SIDE]);
                let to = &mut steps[LAYER * row..][..LAYER + SIDE];
                // SAFETY: sixteen numbers each, and room for eight and eight.
                unsafe {
                    let sum = _mm512_loadu_si512(sum.as_ptr().cast());
                    let weight = _mm512_loadu_si512(weight.as_ptr().cast());
                    let bits = u64::from(_mm512_cmpge_epi32_mask(weight, least));
                    *enough.at_mut(row / 4) |= (bits & 255 | bits >> SIDE << 16) << (row % 4 * 16);
                    let weight = _mm512_cvtepi32_ps(_mm512_max_epi32(weight, one));
                    let both = _mm512_div_ps(_mm512_cvtepi32_ps(sum), weight);
                    _mm256_storeu_ps(to.as_mut_ptr(), _mm512_castps512_ps256(both));
                    _mm256_storeu_ps(to.as_mut_ptr().add(LAYER), _mm512_extractf32x8_ps::<1>(both));
                }
            }
        }
        if let Some(planes) = planes[block | 1] {
            let mut rest = rows[block | 1];
            while rest != 0 {
                let there = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let (from, row) = (SIDE * there, row_in(block, there));
                let (sum, weight) = (planes.sum[from], planes.weight[from]);
                steps[LAYER * row + SIDE] = sum as f32 / weight.max(1) as f32;
                *enough.at_mut(row / 4) |= u64::from(weight >= least_weight) << (row % 4 * 16 + SIDE);
            }
        }
    }
}

/// [`Rows::list`], and anything in the fifteen behind the last.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,bmi1,popcnt")]
pub unsafe fn list(rows: &Rows, axis: usize, out: &mut List, mut count: usize) -> usize {
    let mut words = words(rows);
    while words != 0 {
        let word = words.trailing_zeros() as usize;
        words &= words - 1;
        count = list_word(rows.at(word), 256 * word + axis, out, count);
    }
    count
}

/// The words of a set that have members.
#[target_feature(enable = "avx512f")]
fn words(rows: &Rows) -> u64 {
    rows.eights().enumerate().fold(0, |words, (i, eight)| {
        // SAFETY: eight words.
        let eight = unsafe { _mm512_loadu_si512(eight.as_ptr().cast()) };
        words | u64::from(_mm512_test_epi64_mask(eight, eight)) << (8 * i)
    })
}

/// Lists the members of a word, of which the first has this place.
#[inline]
#[target_feature(enable = "avx512f,bmi1,popcnt")]
fn list_word(bits: u64, place: usize, out: &mut List, mut count: usize) -> usize {
    let first = _mm512_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56, 60);
    let members = _mm512_add_epi32(first, _mm512_set1_epi32(place as i32));
    assert!(count + 64 < MOST);
    for row in 0..4 {
        let bits = (bits >> (16 * row)) as u16;
        let members = _mm512_add_epi32(members, _mm512_set1_epi32(64 * row));
        let members = _mm512_maskz_compress_epi32(bits, members);
        // SAFETY: room for sixteen, since a word has 64.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().add(count).cast(), members) };
        count += bits.count_ones() as usize;
    }
    count
}

/// Lists live cells, with anything in the fifteen behind the last, and finds the set of inside corners of each, by its number; returns
/// how many there are.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw,bmi1,popcnt")]
pub unsafe fn cells(inside: &Rows, live: &Rows, out: &mut List, cases: &mut [u8; CELL_NUMBERS]) -> usize {
    let (mut words, mut count) = (words(live), 0);
    while words != 0 {
        let word = words.trailing_zeros() as usize % (CELL_NUMBERS / 64);
        words &= words - 1;
        count = list_word(live.at(word), 256 * word, out, count);
        let (own, [y, z, both]) = (inside.at(word), inside.next(word));
        let mut sets = _mm512_setzero_si512();
        for (k, corners) in [own, own >> 1, y, y >> 1, z, z >> 1, both, both >> 1].into_iter().enumerate() {
            sets = _mm512_mask_add_epi8(sets, corners, sets, _mm512_set1_epi8((1u8 << k) as i8));
        }
        // SAFETY: 64 bytes.
        unsafe { _mm512_storeu_si512(cases[64 * word..][..64].as_mut_ptr().cast(), sets) };
    }
    count
}

/// [`STRIDES`] by the lowest two bits of a place.
const STEPS_ALONG: [usize; 4] = [STRIDES[0], STRIDES[1], STRIDES[2], 0];

/// Numbers edges, and finds where the surface crosses them, and anything in the fifteen behind the last; returns the greatest difference of
/// the distances at both ends.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f")]
pub unsafe fn divide_edges(steps: &[f32; NUMBERS], edges: &mut Edges) -> f32 {
    let Edges { places, parts, jumps, count, numbers } = edges;
    assert!(*count + 15 < MOST);
    // One by one: gathering sixteen at once takes longer.
    for (i, &place) in places[..*count].iter().enumerate() {
        let (place, axis) = (place as usize % PLACES, place as usize % 4);
        numbers[place] = i as u16;
        parts[i] = steps[place / 4];
        jumps[i] = parts[i] - steps[(place / 4 + STEPS_ALONG[axis]) % NUMBERS];
    }
    let mut widest = _mm512_setzero_ps();
    for i in (0..*count).step_by(16) {
        let lanes = u16::MAX >> 16usize.saturating_sub(*count - i).min(15);
        // SAFETY: sixteen are there.
        unsafe {
            let jump = _mm512_loadu_ps(jumps.as_ptr().add(i));
            let part = _mm512_div_ps(_mm512_loadu_ps(parts.as_ptr().add(i)), jump);
            _mm512_storeu_ps(parts.as_mut_ptr().add(i), part);
            widest = _mm512_mask_max_ps(widest, lanes, widest, _mm512_abs_ps(jump));
        }
    }
    _mm512_reduce_max_ps(widest)
}

/// Where the numbers of the three registers that sixteen positions fill come from: of x and y (sixteen each), and of z.
const FROM: [([i32; 16], [i32; 16], u16); 3] = {
    let mut out = [([0; 16], [0; 16], 0); 3];
    let mut i = 0;
    while i < 48 {
        let (point, axis) = (i / 3, i % 3);
        let (first, second, mask) = &mut out[i / 16];
        first[i % 16] = (point + if axis == 1 { 16 } else { 0 }) as i32;
        second[i % 16] = point as i32;
        if axis == 2 {
            *mask |= 1 << (i % 16);
        }
        i += 1;
    }
    out
};

/// Positions of the vertices on edges, as [`Place::position`] has them, and anything in the sixteen behind the last.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f")]
pub unsafe fn positions(place: &Place, edges: &Edges, out: &mut [[f32; 3]; MOST]) {
    assert!(edges.count + 16 < MOST);
    let low = place.voxel([0; 3]).map(|v| _mm512_set1_epi32(v));
    let (half, voxel) = (_mm512_set1_ps(0.5), _mm512_set1_ps(place.voxel_m));
    let (corners, axes) = (_mm512_set1_epi32(15), _mm512_set1_epi32(3));
    for i in (0..edges.count).step_by(16) {
        // SAFETY: sixteen edges are there, and room for their vertices.
        unsafe {
            let place = _mm512_loadu_si512(edges.places.as_ptr().add(i).cast());
            let part = _mm512_loadu_ps(edges.parts.as_ptr().add(i));
            let axis = _mm512_and_si512(place, axes);
            let corner = [
                _mm512_and_si512(_mm512_srli_epi32::<2>(place), corners),
                _mm512_and_si512(_mm512_srli_epi32::<6>(place), corners),
                _mm512_srli_epi32::<10>(place),
            ];
            let mut at = [half; 3];
            for (k, at) in at.iter_mut().enumerate() {
                let whole = _mm512_cvtepi32_ps(_mm512_add_epi32(low[k], corner[k]));
                let centre = _mm512_add_ps(whole, half);
                let along = _mm512_cmpeq_epi32_mask(axis, _mm512_set1_epi32(k as i32));
                *at = _mm512_mul_ps(_mm512_mask_add_ps(centre, along, centre, part), voxel);
            }
            let to: *mut f32 = out.as_mut_ptr().add(i).cast();
            for (r, (first, second, mask)) in FROM.iter().enumerate() {
                let first = _mm512_loadu_si512(first.as_ptr().cast());
                let second = _mm512_loadu_si512(second.as_ptr().cast());
                let mixed = _mm512_permutex2var_ps(at[0], first, at[1]);
                let mixed = _mm512_mask_permutexvar_ps(mixed, *mask, second, at[2]);
                _mm512_storeu_ps(to.add(16 * r), mixed);
            }
        }
    }
}

/// The triangles of live cells, of which the sets of inside corners are `cases` by their numbers; returns how many. The numbers of
/// the edges around a cell are in four places of eight: they are read at once, and put in the order of its triangles.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw")]
pub unsafe fn triangles(
    cells: &[u32],
    cases: &[u8; CELL_NUMBERS],
    all: &[Triangles; 256],
    edges: &Edges,
    out: &mut [[u32; 3]; MOST_TRIANGLES],
) -> usize {
    assert!(5 * cells.len() + 6 < MOST_TRIANGLES);
    let mut count = 0;
    for &place in cells {
        let number = place as usize / 4 % CELL_NUMBERS;
        let triangles = &all[usize::from(cases[number])];
        // SAFETY: the table is longer by a layer and a row than what is numbered; no cell has more than five triangles.
        unsafe {
            let at = edges.numbers.as_ptr().add(4 * number);
            let pair = |corner: usize| _mm_loadu_si128(at.add(4 * corner).cast());
            let all = _mm512_castsi128_si512(pair(0));
            let all = _mm512_inserti32x4::<1>(all, pair(LAYER));
            let all = _mm512_inserti32x4::<2>(all, pair(LAYER * LAYER));
            let all = _mm512_inserti32x4::<3>(all, pair(LAYER * LAYER + LAYER));
            // The lanes, and their count, which is none of them.
            let lanes = _mm256_load_si256(std::ptr::from_ref(triangles).cast());
            let numbers = _mm512_permutexvar_epi16(_mm512_castsi256_si512(lanes), all);
            let numbers = _mm512_cvtepu16_epi32(_mm512_castsi512_si256(numbers));
            _mm512_storeu_si512(out.as_mut_ptr().add(count).cast(), numbers);
        }
        count += usize::from(triangles.count);
    }
    count
}
