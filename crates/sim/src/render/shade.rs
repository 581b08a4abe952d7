//! The grey of each pixel: runs of one face, each with one filter, with a true division per pixel.

use super::raster::Visibility;
use super::sample::{Filters, LANES};
use super::setup::{Setup, at};
use crate::texture::Texture;

/// The grey level where there is no surface.
const NOTHING: u16 = 200 << 8;
/// A pixel that has no grey yet; no grey is as much.
pub(crate) const UNSHADED: u16 = u16::MAX;
/// Most pixels of a run.
const RUN: usize = 16;

/// Shades what is not shaded yet, as 256 times the grey level. As in the buffer of inverse depths, `LANES` values more follow those
/// of the image.
#[inline(always)]
pub(crate) fn shade<const AVX2: bool>(
    seen: &Visibility,
    setups: &[Setup],
    textures: &[Texture],
    out: &mut [u16],
) {
    let mut runs = Vec::with_capacity(seen.width);
    for y in 0..seen.height {
        let row = y * seen.width;
        let faces = &seen.face[row..row + seen.width];
        runs.clear();
        let mut x = 0;
        while x < faces.len() {
            let id = faces[x];
            let most = (x + RUN).min(faces.len());
            let mut end = x + 1;
            while end < most && faces[end] == id {
                end += 1;
            }
            if id == 0 {
                let open = out[row + x..row + end].iter_mut().filter(|o| **o == UNSHADED);
                open.for_each(|o| *o = NOTHING);
            } else if out[row + x..row + end].contains(&UNSHADED) {
                runs.push((x, end - x));
            }
            x = end;
        }
        for runs in runs.chunks(LANES) {
            several::<AVX2>(seen, setups, textures, y, runs, out);
        }
    }
}

/// Shades up to `LANES` runs of a row, each given by its first pixel and its length.
#[inline(always)]
fn several<const AVX2: bool>(
    seen: &Visibility,
    setups: &[Setup],
    textures: &[Texture],
    y: usize,
    runs: &[(usize, usize)],
    out: &mut [u16],
) {
    let row = y * seen.width;
    let mut of = [&setups[0]; LANES];
    let (mut begin, mut middle, mut q) = ([[0f32; LANES]; 2], [[0f32; LANES]; 2], [1f32; LANES]);
    for (i, &(x, length)) in runs.iter().enumerate() {
        let s = &setups[seen.face[row + x] as usize - 1];
        of[i] = s;
        q[i] = seen.inverse_depth[row + x + length / 2];
        for k in 0..2 {
            begin[k][i] = at(&s.texture_over_depth[k], x as f64, y as f64) as f32;
            middle[k][i] = begin[k][i] + s.slopes[1 + k][0] * (length / 2) as f32;
        }
    }
    for i in 0..LANES {
        let z = 1.0 / q[i];
        middle.iter_mut().for_each(|m| m[i] *= z);
    }
    let filters = footprints(&of, textures, &middle, &q);
    for (i, &(x, length)) in runs.iter().enumerate() {
        let s = of[i];
        for first in (0..length).step_by(LANES) {
            let pixel = row + x + first;
            let q = &seen.inverse_depth[pixel..pixel + LANES];
            let mut uv = [[0f32; LANES]; 2];
            for j in 0..LANES {
                let z = 1.0 / q[j];
                for k in 0..2 {
                    uv[k][j] = (begin[k][i] + s.slopes[1 + k][0] * (first + j) as i32 as f32) * z;
                }
            }
            let grey = filters.block::<AVX2>(i, &textures[s.texture], &uv);
            let out = &mut out[pixel..pixel + LANES];
            for j in 0..LANES {
                let open = (out[j] == UNSHADED) & (j + first < length);
                out[j] = if open { grey[j] as u16 } else { out[j] };
            }
        }
    }
}

/// The filters where the texture coordinates are `uv` and the inverse depth is `q`: d(U/q)/dx = (U' - u q') / q.
#[inline(always)]
fn footprints(
    of: &[&Setup; LANES],
    textures: &[Texture],
    uv: &[[f32; LANES]; 2],
    q: &[f32; LANES],
) -> Filters {
    let mut slopes = [[[0f32; LANES]; 2]; 3];
    let mut last = [0; LANES];
    for (i, s) in of.iter().enumerate() {
        last[i] = textures[s.texture].levels.len() as i32 - 1;
        for (out, slopes) in slopes.iter_mut().zip(&s.slopes) {
            (out[0][i], out[1][i]) = (slopes[0], slopes[1]);
        }
    }
    let [by_q, by_u, by_v] = &slopes;
    let mut derivatives = [[0f32; LANES]; 4];
    for i in 0..LANES {
        let inv = 1.0 / q[i];
        for k in 0..2 {
            derivatives[2 * k][i] = (by_u[k][i] - uv[0][i] * by_q[k][i]) * inv;
            derivatives[2 * k + 1][i] = (by_v[k][i] - uv[1][i] * by_q[k][i]) * inv;
        }
    }
    Filters::new(&derivatives, &last)
}

/// A place of the image and the face to be seen there.
#[derive(Clone, Copy)]
pub(crate) struct Spot {
    /// The pixel that the place is in.
    pub pixel: u32,
    /// Its weight in this pixel.
    pub weight: u32,
    /// One plus the index of the face.
    pub face: u32,
    /// The place in the image.
    pub at: [f32; 2],
    /// 256 times the grey level there.
    pub grey: u32,
}

/// Shades up to `LANES` single places.
#[inline(always)]
pub(crate) fn shade_spots(spots: &mut [Spot], setups: &[Setup], textures: &[Texture]) {
    let mut of = [&setups[0]; LANES];
    let (mut uv, mut q) = ([[0f32; LANES]; 2], [1f32; LANES]);
    for (i, spot) in spots.iter().enumerate() {
        let s = &setups[spot.face as usize - 1];
        of[i] = s;
        let [x, y] = spot.at.map(f64::from);
        q[i] = at(&s.inverse_depth, x, y) as f32;
        for k in 0..2 {
            uv[k][i] = at(&s.texture_over_depth[k], x, y) as f32;
        }
    }
    for i in 0..LANES {
        q[i] = q[i].max(1e-6);
        uv.iter_mut().for_each(|c| c[i] /= q[i]);
    }
    let filters = footprints(&of, textures, &uv, &q);
    for (i, spot) in spots.iter_mut().enumerate() {
        spot.grey = filters.one(i, &textures[of[i].texture], uv[0][i], uv[1][i]) as u32;
    }
}
