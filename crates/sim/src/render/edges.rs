//! Anti-aliasing where faces meet in a pixel: eight samples of which face is nearest, each face shaded once.
//!
//! The sample pattern is the eight-rooks pattern usual for multisampling.

use super::raster::Visibility;
use super::sample::LANES;
use super::setup::{Setup, at};
use super::shade::{Spot, shade_spots};
use crate::texture::Texture;

const SAMPLES: usize = 8;
const DX: [f32; SAMPLES] = [0.0625, -0.0625, 0.3125, -0.1875, -0.3125, -0.4375, 0.1875, 0.4375];
const DY: [f32; SAMPLES] = [-0.1875, 0.1875, 0.0625, -0.3125, 0.3125, -0.0625, 0.4375, -0.4375];
/// The middle of each set of samples, given as bits.
const MIDDLE: [[f32; 2]; 1 << SAMPLES] = middles();
/// Maximum number of faces in one pixel.
const MOST: usize = 6;

const fn middles() -> [[f32; 2]; 1 << SAMPLES] {
    let mut out = [[0.0; 2]; 1 << SAMPLES];
    let mut set = 1;
    while set < out.len() {
        let (mut x, mut y, mut i) = (0.0, 0.0, 0);
        while i < SAMPLES {
            if set >> i & 1 == 1 {
                (x, y) = (x + DX[i], y + DY[i]);
            }
            i += 1;
        }
        let n = set.count_ones() as f32;
        out[set] = [x / n, y / n];
        set += 1;
    }
    out
}

/// Shades every pixel that has another face beside, above or below it, where a face covers a sample; `out` is 256 times the grey
/// level.
#[inline(always)]
pub(crate) fn smooth(seen: &Visibility, setups: &[Setup], textures: &[Texture], out: &mut [u16]) {
    let (w, h) = (seen.width, seen.height);
    let mut mark = vec![false; w];
    let mut spots = Vec::new();
    for y in 0..h {
        let row = &seen.face[y * w..(y + 1) * w];
        let above = &seen.face[y.saturating_sub(1) * w..][..w];
        let below = &seen.face[(y + 1).min(h - 1) * w..][..w];
        for (((m, a), b), c) in mark.iter_mut().zip(row).zip(above).zip(below) {
            *m = (a != b) | (a != c);
        }
        for ((m, a), b) in mark.iter_mut().zip(row).zip(&row[1..]) {
            *m |= a != b;
        }
        for ((m, a), b) in mark[1..].iter_mut().zip(row).zip(&row[1..]) {
            *m |= a != b;
        }
        for (k, marks) in mark.chunks(16).enumerate() {
            if marks.contains(&true) {
                for x in (16 * k..).zip(marks).filter_map(|(x, m)| m.then_some(x)) {
                    pixel([above, row, below], setups, x, y, &mut spots);
                }
            }
        }
        if spots.len() > 64 * LANES || y + 1 == h {
            for spots in spots.chunks_mut(LANES) {
                shade_spots(spots, setups, textures);
            }
            for spots in spots.chunk_by(|a, b| a.pixel == b.pixel) {
                let (sum, covered) =
                    spots.iter().fold((0, 0), |(s, n), spot| (s + spot.weight * spot.grey, n + spot.weight));
                out[spots[0].pixel as usize] = ((sum + covered / 2) / covered) as u16;
            }
            spots.clear();
        }
    }
}

/// Where to shade the faces that cover samples of a pixel, each weighted by how many; `rows` are that of the pixel and those beside.
#[inline(always)]
fn pixel(rows: [&[u32]; 3], setups: &[Setup], x: usize, y: usize, spots: &mut Vec<Spot>) {
    let (mut ids, mut count, mut before) = ([0u32; MOST], 0, 0);
    for row in rows {
        for id in [row[x.saturating_sub(1)], row[x], row[(x + 1).min(row.len() - 1)]] {
            if id != before && id != 0 && count < MOST && !ids[..count].contains(&id) {
                ids[count] = id;
                count += 1;
            }
            before = id;
        }
    }
    let mut best = [0f32; SAMPLES];
    let mut sets = [0u32; MOST];
    for k in 0..count {
        let nearer = nearer(&setups[ids[k] as usize - 1], x, y, &mut best);
        sets[..k].iter_mut().for_each(|set| *set &= !nearer);
        sets[k] = nearer;
    }
    let pixel = (y * rows[0].len() + x) as u32;
    for (&face, &set) in ids.iter().zip(&sets).filter(|(_, set)| **set != 0) {
        // Shaded at the centroid of its own samples, so that the face is not sampled outside its edges.
        let [dx, dy] = MIDDLE[set as usize];
        let at = [x as f32 + dx, y as f32 + dy];
        spots.push(Spot { pixel, weight: set.count_ones(), face, at, grey: 0 });
    }
}

/// The samples, as bits, that a face covers nearer than the best inverse depths so far.
#[inline(always)]
fn nearer(s: &Setup, x: usize, y: usize, best: &mut [f32; SAMPLES]) -> u32 {
    let mut inside = [f32::MAX; SAMPLES];
    for e in &s.edges {
        let base = e[0] * x as f32 + e[1] * y as f32 + e[2];
        for i in 0..SAMPLES {
            let d = base + e[0] * DX[i] + e[1] * DY[i];
            inside[i] = if d < inside[i] { d } else { inside[i] };
        }
    }
    let base = at(&s.inverse_depth, x as f64, y as f64) as f32;
    let [gx, gy] = s.slopes[0];
    let mut set = 0;
    for i in 0..SAMPLES {
        let q = base + gx * DX[i] + gy * DY[i];
        let nearer = (inside[i] >= 0.0) & (q > best[i]);
        best[i] = if nearer { q } else { best[i] };
        set |= u32::from(nearer) << i;
    }
    set
}
