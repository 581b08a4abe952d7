//! Versions of the loops of [`super::samples`] and [`super::piece`] with the instructions of [`crate::Backend::Avx512`]: the same operations,
//! bit-identical results.
#![allow(unsafe_code)]

use super::cells::{MOST_TRIANGLES, MOST_VERTICES, Triangles};
use super::live::source;
use super::rows::{CELL_NUMBERS, CORNERS, LAYER, LAYER_WORDS, List, MOST, NUMBERS, Rows};
use super::{Place, VertexTable};
use crate::block::SIDE;
use crate::tsdf::Planes;
use std::arch::x86_64::*;

/// Distances of the rows of corners that are needed, and which corners have enough weight.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512vl,bmi1")]
pub unsafe fn divide(
    planes: &[Option<&Planes>; 8],
    rows: &[[u32; CORNERS]; 2],
    least_weight: i32,
    steps: &mut [f32; NUMBERS],
    enough: &mut Rows,
) {
    let (least, one) = (_mm256_set1_epi32(least_weight), _mm256_set1_epi32(1));
    for (z, (mut rows, last)) in rows[0].into_iter().zip(rows[1]).enumerate() {
        while rows != 0 {
            let y = rows.trailing_zeros() as usize;
            rows &= rows - 1;
            let (block, from) = source(y, z);
            let row = y + LAYER * z;
            let to = &mut steps[LAYER * row..][..CORNERS];
            let mut bits = 0;
            if let Some(planes) = planes[block] {
                let (sum, weight) = (&planes.sum[from..from + SIDE], &planes.weight[from..from + SIDE]);
                // SAFETY: eight numbers each.
                unsafe {
                    let sum = _mm256_loadu_si256(sum.as_ptr().cast());
                    let weight = _mm256_loadu_si256(weight.as_ptr().cast());
                    bits = u64::from(_mm256_cmpge_epi32_mask(weight, least));
                    let weight = _mm256_cvtepi32_ps(_mm256_max_epi32(weight, one));
                    _mm256_storeu_ps(to.as_mut_ptr(), _mm256_div_ps(_mm256_cvtepi32_ps(sum), weight));
                }
            }
            if let Some(planes) = planes[block | 1].filter(|_| last >> y & 1 == 1) {
                to[SIDE] = planes.sum[from] as f32 / planes.weight[from].max(1) as f32;
                bits |= u64::from(planes.weight[from] >= least_weight) << SIDE;
            }
            *enough.at_mut(row / 4) |= bits << (row % 4 * 16);
        }
    }
}

/// Where the surface crosses edges along an axis, and anything in the fifteen behind the last; returns the greatest difference of the
/// distances at both ends.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f")]
pub unsafe fn divide_edges(
    steps: &[f32; NUMBERS],
    numbers: &List,
    count: usize,
    stride: usize,
    parts: &mut [f32; MOST],
) -> f32 {
    assert!(count + 15 < MOST);
    let (mask, stride) = (_mm512_set1_epi32(NUMBERS as i32 - 1), _mm512_set1_epi32(stride as i32));
    let mut widest = _mm512_setzero_ps();
    for i in (0..count).step_by(16) {
        let lanes = u16::MAX >> 16usize.saturating_sub(count - i).min(15);
        // SAFETY: sixteen numbers and parts are there, and steps for all of the numbers.
        unsafe {
            let number = _mm512_cvtepu16_epi32(_mm256_loadu_si256(numbers.as_ptr().add(i).cast()));
            let next = _mm512_and_si512(_mm512_add_epi32(number, stride), mask);
            let a = _mm512_i32gather_ps::<4>(_mm512_and_si512(number, mask), steps.as_ptr());
            let b = _mm512_i32gather_ps::<4>(next, steps.as_ptr());
            let jump = _mm512_sub_ps(a, b);
            _mm512_storeu_ps(parts.as_mut_ptr().add(i), _mm512_div_ps(a, jump));
            widest = _mm512_mask_max_ps(widest, lanes, widest, _mm512_abs_ps(jump));
        }
    }
    _mm512_reduce_max_ps(widest)
}

/// The set of inside corners of each live cell, by its number.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw")]
pub unsafe fn cases(inside: &Rows, live: &Rows, out: &mut [u8; CELL_NUMBERS]) {
    for (word, out) in out.chunks_exact_mut(64).enumerate().take(LAYER_WORDS * SIDE) {
        if live.at(word) == 0 {
            continue;
        }
        let (own, [y, z, both]) = (inside.at(word), inside.next(word));
        let mut sets = _mm512_setzero_si512();
        for (k, corners) in [own, own >> 1, y, y >> 1, z, z >> 1, both, both >> 1].into_iter().enumerate() {
            sets = _mm512_mask_add_epi8(sets, corners, sets, _mm512_set1_epi8((1u8 << k) as i8));
        }
        // SAFETY: 64 bytes.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), sets) };
    }
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

/// Positions of the vertices on edges along an axis, as [`Place::position`] has them, from the number `first` on; anything in the sixteen
/// behind the last.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f")]
pub unsafe fn positions(
    place: &Place,
    axis: usize,
    (numbers, parts, count): (&List, &[f32; MOST], usize),
    out: &mut [[f32; 3]; MOST_VERTICES],
    first: usize,
) {
    assert!(count + 15 < MOST && first + count + 16 < MOST_VERTICES);
    let low = place.voxel([0; 3]).map(|v| _mm512_set1_epi32(v));
    let (mask, half, voxel) = (_mm512_set1_epi32(15), _mm512_set1_ps(0.5), _mm512_set1_ps(place.voxel_m));
    for i in (0..count).step_by(16) {
        // SAFETY: sixteen edges are there, and room for their vertices.
        unsafe {
            let number = _mm512_cvtepu16_epi32(_mm256_loadu_si256(numbers.as_ptr().add(i).cast()));
            let part = _mm512_loadu_ps(parts.as_ptr().add(i));
            let corner = [
                _mm512_and_si512(number, mask),
                _mm512_and_si512(_mm512_srli_epi32::<4>(number), mask),
                _mm512_srli_epi32::<8>(number),
            ];
            let mut at = [half; 3];
            for (k, at) in at.iter_mut().enumerate() {
                let whole = _mm512_cvtepi32_ps(_mm512_add_epi32(low[k], corner[k]));
                let centre = _mm512_add_ps(whole, half);
                let crossing = if k == axis { _mm512_add_ps(centre, part) } else { centre };
                *at = _mm512_mul_ps(crossing, voxel);
            }
            let to: *mut f32 = out.as_mut_ptr().add(first + i).cast();
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
/// the vertices around a cell are in four places of eight: they are read at once, and put in the order of its triangles.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512vl")]
pub unsafe fn triangles(
    cells: &[u16],
    cases: &[u8; CELL_NUMBERS],
    all: &[Triangles; 256],
    vertices: &VertexTable,
    out: &mut [[u32; 3]; MOST_TRIANGLES],
) -> usize {
    assert!(5 * cells.len() + 6 < MOST_TRIANGLES);
    let mut count = 0;
    for &cell in cells {
        let cell = usize::from(cell) % CELL_NUMBERS;
        let triangles = &all[usize::from(cases[cell])];
        // SAFETY: the table is longer by a layer and a row than what is numbered; no cell has more than five triangles.
        unsafe {
            let at = vertices.as_ptr().add(4 * cell);
            let pair = |corner: usize| _mm256_loadu_si256(at.add(4 * corner).cast());
            let lower = _mm512_inserti64x4::<1>(_mm512_castsi256_si512(pair(0)), pair(LAYER));
            let upper = _mm512_castsi256_si512(pair(LAYER * LAYER));
            let upper = _mm512_inserti64x4::<1>(upper, pair(LAYER * LAYER + LAYER));
            let lanes = _mm512_cvtepu8_epi32(_mm_loadu_si128(triangles.lanes.as_ptr().cast()));
            let numbers = _mm512_permutex2var_epi32(lower, lanes, upper);
            _mm512_storeu_si512(out.as_mut_ptr().add(count).cast(), numbers);
        }
        count += triangles.count;
    }
    count
}
