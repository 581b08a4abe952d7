//! Which face is seen at each pixel centre: spans of convex polygons against a buffer of inverse depths.

use super::sample::LANES;
use super::setup::Setup;

/// For every pixel the inverse depth and one plus the index of the face; 0 where there is nothing.
pub(crate) struct Visibility {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Inverse depth in 1/m; 0 where there is nothing. After those of the image `LANES` more, so that as many can be read anywhere.
    pub inverse_depth: Vec<f32>,
    /// One plus the index into the setups.
    pub face: Vec<u32>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl Visibility {
    /// Nothing seen.
    pub fn new(width: usize, height: usize) -> Self {
        let n = width * height;
        Self {
            width,
            height,
            inverse_depth: vec![0.0; n + LANES],
            face: vec![0; n],
            left: vec![0.0; height],
            right: vec![0.0; height],
        }
    }

    /// Clears the buffers.
    pub fn clear(&mut self) {
        self.inverse_depth.fill(0.0);
        self.face.fill(0);
    }

    /// Draws one face.
    #[inline(always)]
    pub fn draw(&mut self, setup: &Setup, id: u32) {
        let Some((first, end)) = self.scan(&setup.outline[..setup.corners]) else { return };
        let [gx, gy, g0] = setup.inverse_depth;
        for y in first..end {
            // A pixel belongs to the face when its centre does; a centre on the left edge is in, on the right out.
            let x0 = ceil_in(self.left[y], self.width);
            let x1 = ceil_in(self.right[y], self.width);
            if x0 >= x1 {
                continue;
            }
            let base = (gx * x0 as f64 + gy * y as f64 + g0) as f32;
            let row = y * self.width;
            let depths = &mut self.inverse_depth[row + x0..row + x1];
            let faces = &mut self.face[row + x0..row + x1];
            span(depths, faces, base, gx as f32, id);
        }
    }

    /// Fills left and right ends per row; the rows are `first..end`.
    #[inline(always)]
    fn scan(&mut self, outline: &[(f64, f64)]) -> Option<(usize, usize)> {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for p in outline {
            low = low.min(p.1);
            high = high.max(p.1);
        }
        let limit = self.height;
        let (first, end) = (ceil_in(low, limit), ceil_in(high, limit));
        if first >= end {
            return None;
        }
        self.left[first..end].fill(f64::MAX);
        self.right[first..end].fill(f64::MIN);
        for (i, &a) in outline.iter().enumerate() {
            let b = outline[(i + 1) % outline.len()];
            // The same order of corners for both faces at an edge: the same rounding, no gap between them.
            let (a, b) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            let (y0, y1) = (ceil_in(a.1, limit), ceil_in(b.1, limit));
            if y0 >= y1 {
                continue;
            }
            let slope = (b.0 - a.0) / (b.1 - a.1);
            for y in y0..y1 {
                let x = a.0 + (y as f64 - a.1) * slope;
                self.left[y] = self.left[y].min(x);
                self.right[y] = self.right[y].max(x);
            }
        }
        Some((first, end))
    }
}

/// `v` rounded up to a whole number, clamped to `0..=limit`.
#[inline(always)]
fn ceil_in(v: f64, limit: usize) -> usize {
    let v = v.clamp(-1.0, limit as f64 + 1.0);
    let whole = v as i64;
    let up = whole + i64::from(v > whole as f64);
    up.clamp(0, limit as i64) as usize
}

/// Keeps the nearer of the present content and a face with linear inverse depth.
#[inline(always)]
fn span(depths: &mut [f32], faces: &mut [u32], base: f32, step: f32, id: u32) {
    for (i, (z, f)) in depths.iter_mut().zip(faces.iter_mut()).enumerate() {
        let inverse = base + step * i as i32 as f32;
        let nearer = inverse > *z;
        *z = z.max(inverse);
        *f = if nearer { id } else { *f };
    }
}
