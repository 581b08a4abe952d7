//! What a surface is made of: the base coat that fills a canvas.

use super::Canvas;
use super::lattice::lattice;

/// A base coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Material {
    /// Painted wall with stains and specks.
    Plaster(f32),
    /// A wall with almost no texture.
    Plain(f32),
    /// Bricks 24 by 7.5 cm.
    Brick(f32),
    /// Square floor tiles of this side in metres.
    Tiles(f32, f32),
    /// Planks along x.
    Planks(f32),
    /// Strong fine grain.
    Carpet(f32),
    /// Stone with pebbles.
    Asphalt(f32),
    /// Grass and leaves.
    Leaves(f32),
    /// Wooden or painted board with faint grain.
    Board(f32),
    /// Ceiling panels of 0.6 m.
    Panels(f32),
    /// Wallpaper with a repeated motif.
    Paper(f32),
    /// Sky with clouds.
    Sky,
}

/// The whole part of a number from 0.
fn whole(v: f32) -> f32 {
    v as i32 as f32
}

impl Material {
    /// Coats the whole canvas.
    pub fn coat(self, c: &mut Canvas<'_>) {
        let (noise, (ox, oy), texel) = (c.noise, c.offset, c.texel);
        let fine = |x: usize, y: usize| noise.fine(x + ox, y + oy);
        let coarse = |x: usize, y: usize| noise.coarse(x + ox, y + oy);
        let seed = (ox as u64) << 20 | oy as u64;
        match self {
            Material::Plaster(mean) => c.fill(|x, y| {
                let f = fine(x, y);
                let speck = if f > 0.62 {
                    -26.0
                } else if f < -0.62 {
                    18.0
                } else {
                    0.0
                };
                mean + 9.0 * f + 16.0 * coarse(x, y) + speck
            }),
            Material::Plain(mean) => c.fill(|x, y| mean + 1.2 * coarse(x, y)),
            Material::Board(mean) => c.fill(|x, y| mean + 7.0 * fine(x / 8, y) + 7.0 * coarse(x / 3, y)),
            Material::Carpet(mean) => c.fill(|x, y| mean + 34.0 * fine(x, y) + 14.0 * coarse(x, y)),
            Material::Asphalt(mean) => c.fill(|x, y| {
                let f = fine(x, y);
                mean + 20.0 * f + 22.0 * coarse(x, y) + if f > 0.5 { 28.0 } else { 0.0 }
            }),
            Material::Leaves(mean) => c.fill(|x, y| {
                let f = fine(x, y);
                mean + 52.0 * f + 16.0 * coarse(x, y) + if f > 0.4 { 26.0 } else { 0.0 }
            }),
            Material::Brick(mean) => {
                let (w, h, joint) = (0.25 / texel, 0.083 / texel, 0.012 / texel);
                c.fill(|x, y| {
                    let (fx, fy) = (x as f32 + 0.5, y as f32 + 0.5);
                    let row = whole(fy / h);
                    let shifted = fx + if row as i64 % 2 == 0 { 0.0 } else { w / 2.0 };
                    let column = whole(shifted / w);
                    let (dx, dy) = (shifted - column * w, fy - row * h);
                    // The distance to the joint's edge, for a ramp of one texel.
                    let inside = (dx - joint).min(w - dx).min(dy - joint).min(h - dy).clamp(-0.5, 0.5) + 0.5;
                    let brick =
                        mean + 62.0 * (lattice(seed, column as i64, row as i64) - 0.5) + 12.0 * fine(x, y);
                    let mortar = mean + 52.0 + 9.0 * fine(x, y);
                    mortar + (brick - mortar) * inside + 9.0 * coarse(x, y)
                });
            }
            Material::Tiles(mean, side) => {
                let (s, joint) = (side / texel, 0.007 / texel);
                c.fill(|x, y| {
                    let (fx, fy) = (x as f32 + 0.5, y as f32 + 0.5);
                    let (i, j) = (whole(fx / s), whole(fy / s));
                    let (dx, dy) = (fx - i * s, fy - j * s);
                    let inside = (dx - joint).min(s - dx).min(dy - joint).min(s - dy).clamp(-0.5, 0.5) + 0.5;
                    let tone = lattice(seed, i as i64, j as i64);
                    let f = fine(x, y);
                    let speck = if f > 0.5 {
                        -34.0
                    } else if f < -0.55 {
                        22.0
                    } else {
                        0.0
                    };
                    let tile = mean + 46.0 * (tone - 0.5) + 10.0 * f + 16.0 * coarse(x, y) + speck;
                    let grout = mean - 58.0;
                    grout + (tile - grout) * inside
                });
            }
            Material::Panels(mean) => {
                let (s, joint) = (0.6 / texel, 0.015 / texel);
                c.fill(|x, y| {
                    let (fx, fy) = (x as f32 + 0.5, y as f32 + 0.5);
                    let (dx, dy) = (fx - s * whole(fx / s), fy - s * whole(fy / s));
                    let inside = (dx - joint).min(s - dx).min(dy - joint).min(s - dy).clamp(-0.5, 0.5) + 0.5;
                    let f = fine(x, y);
                    let panel = mean + 5.0 * f + 9.0 * coarse(x, y) + if f > 0.55 { -40.0 } else { 0.0 };
                    mean - 55.0 + (panel - mean + 55.0) * inside
                });
            }
            Material::Planks(mean) => {
                let (w, long) = (0.13 / texel, 1.1 / texel);
                c.fill(|x, y| {
                    let fy = y as f32 + 0.5;
                    let row = whole(fy / w);
                    let shifted = x as f32 + 0.5 + long * lattice(seed, row as i64, 0);
                    let column = whole(shifted / long);
                    let (dx, dy) = (shifted - column * long, fy - row * w);
                    let inside = dx.min(long - dx).min(dy).min(w - dy).clamp(-0.5, 0.8) + 0.2;
                    let tone = lattice(seed ^ 9, column as i64, row as i64);
                    let knots = if noise.fine(x / 2 + ox, y + oy) > 0.55 { -38.0 } else { 0.0 };
                    let grain = 17.0 * noise.fine(x / 6 + ox, y + oy) + 10.0 * coarse(x / 2, y);
                    mean - 70.0 + (70.0 + 60.0 * (tone - 0.5) + grain + knots) * inside
                });
            }
            Material::Paper(mean) => {
                let s = 0.16 / texel;
                c.fill(|x, y| {
                    let (fx, fy) = (x as f32 + 0.5, y as f32 + 0.5);
                    let row = whole(fy / s);
                    let shifted = fx + row * s / 2.0;
                    let column = whole(shifted / s);
                    let (dx, dy) = (shifted - column * s - s / 2.0, fy - row * s - s / 2.0);
                    let r = (dx * dx + dy * dy).sqrt();
                    // Faded and stained differently from motif to motif, so that no two are the same.
                    let ink = 70.0 * lattice(seed, column as i64, row as i64) - 14.0;
                    let ring = (r - 0.3 * s).abs() - 0.06 * s;
                    let dot = r - 0.1 * s;
                    let cover = (0.5 - ring.min(dot)).clamp(0.0, 1.0);
                    mean - ink * cover + 8.0 * fine(x, y) + 15.0 * coarse(x, y)
                });
            }
            Material::Sky => c.fill(|x, y| {
                let cloud = coarse(x, y) + 0.35 * fine(x, y);
                206.0 + 40.0 * cloud.clamp(-0.9, 1.0)
            }),
        }
    }
}
