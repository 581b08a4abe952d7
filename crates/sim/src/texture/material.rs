//! What a surface is made of: the base coat that fills a canvas.

use super::Canvas;
use super::canvas::whole;
use super::lattice::lattice;
use std::cell::Cell;

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

/// [`lattice`], which remembers the last point.
fn remembered(seed: u64) -> impl Fn(f32, f32) -> f32 {
    let last = Cell::new((f32::NAN, f32::NAN, 0.0));
    move |x, y| {
        if (last.get().0, last.get().1) != (x, y) {
            last.set((x, y, lattice(seed, x as i64, y as i64)));
        }
        last.get().2
    }
}

impl Material {
    /// Coats the whole canvas.
    pub fn coat(self, c: &mut Canvas<'_>) {
        let (noise, (ox, oy), texel) = (c.noise, c.offset, c.texel);
        let plain = [1, 1];
        let seed = (ox as u64) << 20 | oy as u64;
        let tone = remembered(seed);
        match self {
            Material::Plaster(mean) => c.fill(plain, |_, _, f, coarse| {
                let speck = if f > 0.62 {
                    -26.0
                } else if f < -0.62 {
                    18.0
                } else {
                    0.0
                };
                mean + 9.0 * f + 16.0 * coarse + speck
            }),
            Material::Plain(mean) => c.fill(plain, |_, _, _, coarse| mean + 1.2 * coarse),
            Material::Board(mean) => c.fill([8, 3], |_, _, f, coarse| mean + 7.0 * f + 7.0 * coarse),
            Material::Carpet(mean) => c.fill(plain, |_, _, f, coarse| mean + 34.0 * f + 14.0 * coarse),
            Material::Asphalt(mean) => c.fill(plain, |_, _, f, coarse| {
                mean + 20.0 * f + 22.0 * coarse + if f > 0.5 { 28.0 } else { 0.0 }
            }),
            Material::Leaves(mean) => c.fill(plain, |_, _, f, coarse| {
                mean + 52.0 * f + 16.0 * coarse + if f > 0.4 { 26.0 } else { 0.0 }
            }),
            Material::Brick(mean) => {
                let (w, h, joint) = (0.25 / texel, 0.083 / texel, 0.012 / texel);
                c.fill(plain, |fx, fy, f, coarse| {
                    let row = whole(fy / h);
                    let shifted = fx + if row as i64 % 2 == 0 { 0.0 } else { w / 2.0 };
                    let column = whole(shifted / w);
                    let (dx, dy) = (shifted - column * w, fy - row * h);
                    // The distance to the joint's edge, for a ramp of one texel.
                    let inside = (dx - joint).min(w - dx).min(dy - joint).min(h - dy).clamp(-0.5, 0.5) + 0.5;
                    let brick = mean + 62.0 * (tone(column, row) - 0.5) + 12.0 * f;
                    let mortar = mean + 52.0 + 9.0 * f;
                    mortar + (brick - mortar) * inside + 9.0 * coarse
                });
            }
            Material::Tiles(mean, side) => {
                let (s, joint) = (side / texel, 0.007 / texel);
                c.fill(plain, |fx, fy, f, coarse| {
                    let (i, j) = (whole(fx / s), whole(fy / s));
                    let (dx, dy) = (fx - i * s, fy - j * s);
                    let inside = (dx - joint).min(s - dx).min(dy - joint).min(s - dy).clamp(-0.5, 0.5) + 0.5;
                    let tone = tone(i, j);
                    let speck = if f > 0.5 {
                        -34.0
                    } else if f < -0.55 {
                        22.0
                    } else {
                        0.0
                    };
                    let tile = mean + 46.0 * (tone - 0.5) + 10.0 * f + 16.0 * coarse + speck;
                    let grout = mean - 58.0;
                    grout + (tile - grout) * inside
                });
            }
            Material::Panels(mean) => {
                let (s, joint) = (0.6 / texel, 0.015 / texel);
                c.fill(plain, |fx, fy, f, coarse| {
                    let (dx, dy) = (fx - s * whole(fx / s), fy - s * whole(fy / s));
                    let inside = (dx - joint).min(s - dx).min(dy - joint).min(s - dy).clamp(-0.5, 0.5) + 0.5;
                    let panel = mean + 5.0 * f + 9.0 * coarse + if f > 0.55 { -40.0 } else { 0.0 };
                    mean - 55.0 + (panel - mean + 55.0) * inside
                });
            }
            Material::Planks(mean) => {
                let (w, long) = (0.13 / texel, 1.1 / texel);
                let (shift, tone) = (remembered(seed), remembered(seed ^ 9));
                c.fill([2, 2], |fx, fy, f, coarse| {
                    let row = whole(fy / w);
                    let shifted = fx + long * shift(row, 0.0);
                    let column = whole(shifted / long);
                    let (dx, dy) = (shifted - column * long, fy - row * w);
                    let inside = dx.min(long - dx).min(dy).min(w - dy).clamp(-0.5, 0.8) + 0.2;
                    let tone = tone(column, row);
                    let knots = if f > 0.55 { -38.0 } else { 0.0 };
                    let grain = 17.0 * noise.fine(fx as usize / 6 + ox, fy as usize + oy) + 10.0 * coarse;
                    mean - 70.0 + (70.0 + 60.0 * (tone - 0.5) + grain + knots) * inside
                });
            }
            Material::Paper(mean) => {
                let s = 0.16 / texel;
                c.fill(plain, |fx, fy, f, coarse| {
                    let row = whole(fy / s);
                    let shifted = fx + row * s / 2.0;
                    let column = whole(shifted / s);
                    let (dx, dy) = (shifted - column * s - s / 2.0, fy - row * s - s / 2.0);
                    let r = (dx * dx + dy * dy).sqrt();
                    // Faded and stained differently from motif to motif, so that no two are the same.
                    let ink = 70.0 * tone(column, row) - 14.0;
                    let ring = (r - 0.3 * s).abs() - 0.06 * s;
                    let dot = r - 0.1 * s;
                    let cover = (0.5 - ring.min(dot)).clamp(0.0, 1.0);
                    mean - ink * cover + 8.0 * f + 15.0 * coarse
                });
            }
            Material::Sky => c.fill(plain, |_, _, f, coarse| {
                let cloud = coarse + 0.35 * f;
                206.0 + 40.0 * cloud.clamp(-0.9, 1.0)
            }),
        }
    }
}
