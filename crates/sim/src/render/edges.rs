//! Anti-aliasing where faces meet in a pixel: eight samples of which face is nearest, each face shaded once.
//!
//! The sample pattern is the eight-rooks pattern usual for multisampling.

use super::raster::Visibility;
use super::setup::{Setup, at};
use super::shade::shade_one;
use crate::texture::Texture;

const SAMPLES: usize = 8;
const DX: [f32; SAMPLES] = [0.0625, -0.0625, 0.3125, -0.1875, -0.3125, -0.4375, 0.1875, 0.4375];
const DY: [f32; SAMPLES] = [-0.1875, 0.1875, 0.0625, -0.3125, 0.3125, -0.0625, 0.4375, -0.4375];
/// Maximum number of faces in one pixel.
const MOST: usize = 6;

/// Smooths every pixel that has another face beside, above or below it; `out` is 256 times the grey level.
#[inline(always)]
pub(crate) fn smooth(seen: &Visibility, setups: &[Setup], textures: &[&Texture], out: &mut [u16]) {
    let (w, h) = (seen.width, seen.height);
    let mut mark = vec![false; w];
    for y in 0..h {
        let row = &seen.face[y * w..(y + 1) * w];
        let above = &seen.face[y.saturating_sub(1) * w..][..w];
        let below = &seen.face[(y + 1).min(h - 1) * w..][..w];
        for (((m, a), b), c) in mark.iter_mut().zip(row).zip(above).zip(below) {
            *m = (a != b) | (a != c);
        }
        for x in 0..w - 1 {
            let edge = row[x] != row[x + 1];
            mark[x] |= edge;
            mark[x + 1] |= edge;
        }
        for x in 0..w {
            if mark[x]
                && let Some(grey) = pixel(seen, setups, textures, x, y)
            {
                out[y * w + x] = grey;
            }
        }
    }
}

/// The mean over the samples that a face covers; `None` where only one face is near.
#[inline(always)]
fn pixel(seen: &Visibility, setups: &[Setup], textures: &[&Texture], x: usize, y: usize) -> Option<u16> {
    let mut ids = [0u32; MOST];
    let mut count = 0;
    let rows = y.saturating_sub(1)..=(y + 1).min(seen.height - 1);
    for yy in rows {
        for xx in x.saturating_sub(1)..=(x + 1).min(seen.width - 1) {
            let id = seen.face[yy * seen.width + xx];
            if id != 0 && count < MOST && !ids[..count].contains(&id) {
                ids[count] = id;
                count += 1;
            }
        }
    }
    let (xf, yf) = (x as f32, y as f32);
    let mut best = [0f32; SAMPLES];
    let mut owner = [usize::MAX; SAMPLES];
    for (k, &id) in ids[..count].iter().enumerate() {
        let s = &setups[id as usize - 1];
        let mut inside = [f32::MAX; SAMPLES];
        for e in &s.edges {
            let base = e[0] * xf + e[1] * yf + e[2];
            for i in 0..SAMPLES {
                inside[i] = inside[i].min(base + e[0] * DX[i] + e[1] * DY[i]);
            }
        }
        let base = at(&s.inverse_depth, x as f64, y as f64) as f32;
        let (gx, gy) = (s.inverse_depth[0] as f32, s.inverse_depth[1] as f32);
        for i in 0..SAMPLES {
            let q = base + gx * DX[i] + gy * DY[i];
            if inside[i] >= 0.0 && q > best[i] {
                best[i] = q;
                owner[i] = k;
            }
        }
    }
    let (mut sum, mut covered) = (0u32, 0u32);
    for (k, &id) in ids[..count].iter().enumerate() {
        let (mut n, mut mx, mut my) = (0u32, 0f32, 0f32);
        for i in 0..SAMPLES {
            if owner[i] == k {
                n += 1;
                mx += DX[i];
                my += DY[i];
            }
        }
        if n > 0 {
            let s = &setups[id as usize - 1];
            // Shaded at the centroid of its own samples, so that the face is not sampled outside its edges.
            let (px, py) = (f64::from(xf + mx / n as f32), f64::from(yf + my / n as f32));
            sum += n * u32::from(shade_one(s, textures[s.texture], px, py));
            covered += n;
        }
    }
    (covered > 0).then(|| ((sum + covered / 2) / covered) as u16)
}
