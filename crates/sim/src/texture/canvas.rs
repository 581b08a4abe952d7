//! A surface to paint on, in metres: x to the right and y down as its viewer sees it.
//!
//! Every shape is drawn with the coverage of its edge over a texel, so that painting adds no aliasing.

use super::{Noise, Texture, mips::MAX_SIDE};

/// Eight-bit paint over a rectangle of some metres.
pub(crate) struct Canvas<'a> {
    /// Width in texels.
    pub width: usize,
    /// Height in texels.
    pub height: usize,
    /// Metres per texel.
    pub texel: f32,
    /// Offset into the noise, so that each surface has its own.
    pub offset: (usize, usize),
    /// The world's noise.
    pub noise: &'a Noise,
    pixels: Vec<u8>,
}

/// The whole part of a number from 0 to 2^22, as compilers turn it into vector instructions.
#[inline(always)]
pub(super) fn whole(v: f32) -> f32 {
    const ROUND: f32 = 8_388_608.0;
    let nearest = v + ROUND - ROUND;
    nearest - if nearest > v { 1.0 } else { 0.0 }
}

/// The whole part of a number, from 0 to 255.
#[inline(always)]
fn byte(v: f32) -> u8 {
    const ROUND: f32 = 8_388_608.0;
    ((whole(v.clamp(0.0, 255.0)) + ROUND).to_bits() & 255) as u8
}

impl<'a> Canvas<'a> {
    /// An area of `width` by `height` metres; the texel grows where the side would pass the sampler's limit.
    pub fn new(width: f64, height: f64, texel: f64, offset: (usize, usize), noise: &'a Noise) -> Self {
        let texel = texel.max(width.max(height) / (MAX_SIDE - 8) as f64);
        let (w, h) = ((width / texel).ceil().max(1.0) as usize, (height / texel).ceil().max(1.0) as usize);
        Self { width: w, height: h, texel: texel as f32, offset, noise, pixels: vec![128; w * h] }
    }

    /// Width in metres.
    pub fn width_m(&self) -> f32 {
        self.width as f32 * self.texel
    }

    /// Height in metres.
    pub fn height_m(&self) -> f32 {
        self.height as f32 * self.texel
    }

    /// Paints every texel from its middle, in texels, and the fine and coarse noise there, each of which is stretched along x so many
    /// times.
    pub fn fill(&mut self, stretch: [usize; 2], value: impl Fn(f32, f32, f32, f32) -> f32) {
        let (width, (ox, oy), noise) = (self.width, self.offset, self.noise);
        let (mut fine, mut coarse, mut short) = (vec![0.0; width], vec![0.0; width], vec![0.0; width]);
        for (y, row) in self.pixels.chunks_exact_mut(width).enumerate() {
            let mut stretched = |out: &mut [f32], by: usize, make: &dyn Fn(&mut [f32])| {
                if by == 1 {
                    return make(out);
                }
                let short = &mut short[..width.div_ceil(by)];
                make(short);
                out.chunks_mut(by).zip(short).for_each(|(out, v)| out.fill(*v));
            };
            stretched(&mut fine, stretch[0], &|out| noise.fine_row(ox, y + oy, out));
            stretched(&mut coarse, stretch[1], &|out| noise.coarse_row(ox, y + oy, out));
            let fy = y as i32 as f32 + 0.5;
            for (x, ((p, f), c)) in row.iter_mut().zip(&fine).zip(&coarse).enumerate() {
                *p = byte(value(x as i32 as f32 + 0.5, fy, *f, *c));
            }
        }
    }

    /// Paints the inside of a shape, given as a signed distance in metres (negative inside), within a box.
    pub fn shape(&mut self, bounds: [f32; 4], value: f32, alpha: f32, distance: impl Fn(f32, f32) -> f32) {
        let t = self.texel;
        let clamp = |v: f32, n: usize| (v / t).clamp(0.0, n as f32) as usize;
        let (x0, y0) = (clamp(bounds[0] - t, self.width), clamp(bounds[1] - t, self.height));
        let (x1, y1) = (clamp(bounds[2] + 2.0 * t, self.width), clamp(bounds[3] + 2.0 * t, self.height));
        for y in y0..y1 {
            let row = &mut self.pixels[y * self.width..(y + 1) * self.width];
            for (p, x) in row[x0.min(x1)..x1].iter_mut().zip(x0 as i32..) {
                let d = distance((x as f32 + 0.5) * t, (y as i32 as f32 + 0.5) * t);
                let cover = (0.5 - d / t).clamp(0.0, 1.0) * alpha;
                let old = f32::from(*p);
                let new = byte(old + (value - old) * cover + 0.5);
                *p = if cover > 0.0 { new } else { *p };
            }
        }
    }

    /// An upright rectangle by its corner and size.
    pub fn rect(&mut self, x: f32, y: f32, w: f32, h: f32, value: f32, alpha: f32) {
        let (cx, cy, rx, ry) = (x + w / 2.0, y + h / 2.0, w / 2.0, h / 2.0);
        self.shape([x, y, x + w, y + h], value, alpha, |px, py| {
            ((px - cx).abs() - rx).max((py - cy).abs() - ry)
        });
    }

    /// The outline of a rectangle, of the given thickness, drawn inside it.
    pub fn frame(&mut self, x: f32, y: f32, w: f32, h: f32, thick: f32, value: f32) {
        self.rect(x, y, w, thick, value, 1.0);
        self.rect(x, y + h - thick, w, thick, value, 1.0);
        self.rect(x, y + thick, thick, h - 2.0 * thick, value, 1.0);
        self.rect(x + w - thick, y + thick, thick, h - 2.0 * thick, value, 1.0);
    }

    /// A filled circle.
    pub fn disc(&mut self, x: f32, y: f32, r: f32, value: f32, alpha: f32) {
        self.shape([x - r, y - r, x + r, y + r], value, alpha, |px, py| (px - x).hypot(py - y) - r);
    }

    /// A straight stroke with round ends.
    pub fn line(&mut self, a: (f32, f32), b: (f32, f32), thick: f32, value: f32, alpha: f32) {
        let r = thick / 2.0;
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let inv = 1.0 / (dx * dx + dy * dy).max(1e-12);
        let bounds = [a.0.min(b.0) - r, a.1.min(b.1) - r, a.0.max(b.0) + r, a.1.max(b.1) + r];
        self.shape(bounds, value, alpha, |px, py| {
            let k = (((px - a.0) * dx + (py - a.1) * dy) * inv).clamp(0.0, 1.0);
            (px - a.0 - k * dx).hypot(py - a.1 - k * dy) - r
        });
    }

    /// A convex polygon whose corners go clockwise on the surface (x right, y down).
    pub fn polygon(&mut self, corners: &[(f32, f32)], value: f32, alpha: f32) {
        let mut b = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
        for &(x, y) in corners {
            b = [b[0].min(x), b[1].min(y), b[2].max(x), b[3].max(y)];
        }
        self.shape(b, value, alpha, |px, py| {
            let mut d = f32::MIN;
            for (i, &(ax, ay)) in corners.iter().enumerate() {
                let (bx, by) = corners[(i + 1) % corners.len()];
                let (ex, ey) = (bx - ax, by - ay);
                d = d.max(((px - ax) * ey - (py - ay) * ex) / ex.hypot(ey).max(1e-9));
            }
            d
        });
    }

    /// Adds fine grain of an amplitude in grey levels within a box in metres, so that painted things are not flat.
    pub fn grain(&mut self, bounds: [f32; 4], amplitude: f32) {
        let t = self.texel;
        let clamp = |v: f32, n: usize| (v / t).clamp(0.0, n as f32) as usize;
        let (x0, y0) = (clamp(bounds[0], self.width), clamp(bounds[1], self.height));
        let (x1, y1) = (clamp(bounds[2], self.width), clamp(bounds[3], self.height));
        let (ox, oy) = self.offset;
        let mut fine = vec![0.0; x1.saturating_sub(x0)];
        for y in y0..y1 {
            self.noise.fine_row(x0 + ox + 77, y + oy + 31, &mut fine);
            let row = &mut self.pixels[y * self.width + x0..][..fine.len()];
            for (p, fine) in row.iter_mut().zip(&fine) {
                *p = byte(f32::from(*p) + amplitude * fine);
            }
        }
    }

    /// Multiplies by light, given at points in metres and interpolated between nodes 0.2 m apart.
    pub fn light(&mut self, light: impl Fn(f32, f32) -> f32) {
        let cell = ((0.2 / self.texel) as usize).max(4);
        let (nx, ny) = (self.width.div_ceil(cell) + 1, self.height.div_ceil(cell) + 1);
        let metres = |i: usize| (i * cell) as f32 * self.texel;
        let nodes: Vec<f32> = (0..nx * ny).map(|i| light(metres(i % nx), metres(i / nx))).collect();
        let mut row_nodes = vec![0f32; nx];
        for (y, row) in self.pixels.chunks_exact_mut(self.width).enumerate() {
            let (j, g) = (y / cell, (y % cell) as f32 / cell as f32);
            for (i, r) in row_nodes.iter_mut().enumerate() {
                let (a, b) = (nodes[j * nx + i], nodes[(j + 1) * nx + i]);
                *r = a + (b - a) * g;
            }
            for (i, cells) in row.chunks_mut(cell).enumerate() {
                let (mut v, step) = (row_nodes[i], (row_nodes[i + 1] - row_nodes[i]) / cell as f32);
                for p in cells {
                    *p = byte(f32::from(*p) * v + 0.5);
                    v += step;
                }
            }
        }
    }

    /// The finished texture.
    pub fn finish(self) -> Texture {
        Texture::new(self.width, self.height, &self.pixels)
    }
}
