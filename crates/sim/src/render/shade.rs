//! The grey of each pixel: runs of one face, in blocks, with a true division per pixel.

use super::raster::Visibility;
use super::sample::{BLOCK, Filter};
use super::setup::{Plane, Setup, at};
use crate::texture::Texture;

/// The grey level where there is no surface.
const NOTHING: u16 = 200 << 8;

/// Shades the whole image into 256 times the grey level.
#[inline(always)]
pub(crate) fn shade<const AVX2: bool>(
    seen: &Visibility,
    setups: &[Setup],
    textures: &[&Texture],
    out: &mut [u16],
) {
    for y in 0..seen.height {
        let row = y * seen.width;
        let faces = &seen.face[row..row + seen.width];
        let depths = &seen.inverse_depth[row..row + seen.width];
        let line = &mut out[row..row + seen.width];
        let mut x = 0;
        while x < faces.len() {
            let id = faces[x];
            let most = (x + BLOCK).min(faces.len());
            let mut end = x + 1;
            while end < most && faces[end] == id {
                end += 1;
            }
            if id == 0 {
                line[x..end].fill(NOTHING);
            } else {
                let setup = &setups[id as usize - 1];
                let texture = textures[setup.texture];
                block::<AVX2>(setup, texture, (x, y), &depths[x..end], &mut line[x..end]);
            }
            x = end;
        }
    }
}

#[inline(always)]
fn block<const AVX2: bool>(
    setup: &Setup,
    texture: &Texture,
    (x, y): (usize, usize),
    depths: &[f32],
    out: &mut [u16],
) {
    let mut inverse = [1f32; BLOCK];
    inverse[..depths.len()].copy_from_slice(depths);
    let (xf, yf) = (x as f64, y as f64);
    let (u0, v0) = (at(&setup.u, xf, yf) as f32, at(&setup.v, xf, yf) as f32);
    let (du, dv) = (setup.u[0] as f32, setup.v[0] as f32);
    let (mut u, mut v) = ([0f32; BLOCK], [0f32; BLOCK]);
    for i in 0..BLOCK {
        let z = 1.0 / inverse[i];
        u[i] = (u0 + du * i as i32 as f32) * z;
        v[i] = (v0 + dv * i as i32 as f32) * z;
    }
    let middle = depths.len() / 2;
    let filter = footprint(setup, texture, u[middle], v[middle], inverse[middle]);
    let mut grey = [0i32; BLOCK];
    filter.block::<AVX2>(texture, &u, &v, &mut grey);
    for (o, g) in out.iter_mut().zip(&grey) {
        *o = *g as u16;
    }
}

/// The filter where the texture coordinates are `u, v` and the inverse depth is `q`: d(U/q)/dx = (U' - u q') / q.
#[inline(always)]
fn footprint(setup: &Setup, texture: &Texture, u: f32, v: f32, q: f32) -> Filter {
    let inv = 1.0 / q;
    let d = |p: &Plane, k: usize, value: f32| (p[k] as f32 - value * setup.inverse_depth[k] as f32) * inv;
    Filter::new(texture, d(&setup.u, 0, u), d(&setup.v, 0, v), d(&setup.u, 1, u), d(&setup.v, 1, v))
}

/// Shading of a single place, for pixels where several faces meet: 256 times the grey level of one
/// face at one place of the image.
#[inline(always)]
pub(crate) fn shade_one(setup: &Setup, texture: &Texture, x: f64, y: f64) -> u16 {
    let q = (at(&setup.inverse_depth, x, y) as f32).max(1e-6);
    let (u, v) = (at(&setup.u, x, y) as f32 / q, at(&setup.v, x, y) as f32 / q);
    footprint(setup, texture, u, v, q).one(texture, u, v) as u16
}
