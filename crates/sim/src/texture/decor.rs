//! Decoration of a surface: pictures, notices, doors, windows, bookshelves, dirt.

use super::Canvas;
use cairn_random::Random;

/// Paints things on a canvas.
pub(crate) struct Decor;

impl Decor {
    /// A picture in a frame or on paper: areas, discs, triangles and strokes of varying size and tone.
    pub fn picture(c: &mut Canvas<'_>, r: &mut Random, x: f32, y: f32, w: f32, h: f32) {
        let paper = if r.chance(0.6) { r.uniform_f32(195.0, 245.0) } else { r.uniform_f32(25.0, 90.0) };
        c.rect(x + 0.008, y + 0.01, w, h, 60.0, 0.5);
        c.rect(x, y, w, h, paper, 1.0);
        for _ in 0..5 + r.below(12) {
            let s = w.min(h) * r.uniform_f32(0.04, 0.3);
            let (px, py) = (x + r.uniform_f32(0.05, 0.95) * w, y + r.uniform_f32(0.05, 0.95) * h);
            let s = s.min(px - x).min(x + w - px).min(py - y).min(y + h - py).max(0.006);
            let tone = r.uniform_f32(10.0, 250.0);
            match r.below(4) {
                0 => c.disc(px, py, s, tone, 1.0),
                1 => c.rect(px - s, py - s * 0.6, 2.0 * s, 1.2 * s, tone, 1.0),
                2 => {
                    let a = r.uniform_f32(0.0, std::f32::consts::TAU);
                    let corner = |k: f32| (px + s * (a + k).cos(), py + s * (a + k).sin());
                    c.polygon(&[corner(0.0), corner(2.1), corner(4.2)], tone, 1.0);
                }
                _ => c.line((px - s, py), (px + s, py + s * r.uniform_f32(-1.0, 1.0)), s * 0.2, tone, 1.0),
            }
        }
        if r.chance(0.5) {
            let rows = 1 + r.below(4);
            Self::text(c, r, x + 0.06 * w, y + 0.72 * h, 0.86 * w, rows, 0.022, paper);
        }
        if r.chance(0.6) {
            let tone = r.uniform_f32(15.0, 110.0);
            c.frame(x, y, w, h, 0.02_f32.min(0.1 * w), tone);
        }
        c.grain([x, y, x + w, y + h], 5.0);
    }

    /// Lines of blobs that look like writing.
    #[allow(clippy::too_many_arguments)]
    pub fn text(
        c: &mut Canvas<'_>,
        r: &mut Random,
        x: f32,
        y: f32,
        w: f32,
        rows: usize,
        size: f32,
        paper: f32,
    ) {
        let ink = if paper > 128.0 { r.uniform_f32(10.0, 60.0) } else { r.uniform_f32(200.0, 250.0) };
        for row in 0..rows {
            let top = y + row as f32 * size * 1.7;
            let end = x + w * r.uniform_f32(0.55, 1.0);
            let mut px = x;
            while px + size < end {
                let letter = size * r.uniform_f32(0.35, 0.75);
                match r.below(4) {
                    0 => c.rect(px, top, size * 0.2, size, ink, 1.0),
                    1 => {
                        c.rect(px, top, letter, size * 0.22, ink, 1.0);
                        c.rect(px + letter * 0.4, top, size * 0.2, size, ink, 1.0);
                    }
                    2 => c.frame(px, top + size * 0.25, letter, size * 0.75, size * 0.18, ink),
                    _ => c.line((px, top + size), (px + letter, top), size * 0.2, ink, 1.0),
                }
                px += letter + size * if r.chance(0.2) { 0.7 } else { 0.22 };
            }
        }
    }

    /// A notice of paper with writing.
    pub fn notice(c: &mut Canvas<'_>, r: &mut Random, x: f32, y: f32, w: f32, h: f32) {
        let paper = r.uniform_f32(205.0, 248.0);
        c.rect(x + 0.004, y + 0.006, w, h, 70.0, 0.4);
        c.rect(x, y, w, h, paper, 1.0);
        let size = (h * 0.05).clamp(0.008, 0.05);
        Self::text(c, r, x + 0.08 * w, y + 0.07 * h, 0.84 * w, 1, size * 1.8, paper);
        let rows = ((h * 0.7) / (size * 1.7)) as usize;
        Self::text(c, r, x + 0.08 * w, y + 0.25 * h, 0.84 * w, rows, size, paper);
    }

    /// A board with notices pinned on it.
    pub fn board(c: &mut Canvas<'_>, r: &mut Random, x: f32, y: f32, w: f32, h: f32) {
        c.rect(x, y, w, h, r.uniform_f32(90.0, 150.0), 1.0);
        c.grain([x, y, x + w, y + h], 14.0);
        c.frame(x, y, w, h, 0.025, r.uniform_f32(30.0, 70.0));
        let mut px = x + 0.05;
        while px + 0.2 < x + w {
            let nw = r.uniform_f32(0.15, 0.28).min(x + w - px - 0.04);
            let nh = nw * r.uniform_f32(1.1, 1.5);
            let py = y + 0.04 + r.uniform_f32(0.0, (h - nh - 0.08).max(0.0));
            if nh < h - 0.06 {
                if r.chance(0.3) {
                    Self::picture(c, r, px, py, nw, nh);
                } else {
                    Self::notice(c, r, px, py, nw, nh);
                }
            }
            px += nw + r.uniform_f32(0.02, 0.1);
        }
    }

    /// A closed door standing on the lower edge of the canvas.
    pub fn door(c: &mut Canvas<'_>, r: &mut Random, x: f32, w: f32, h: f32) {
        let y = c.height_m() - h;
        let leaf = r.uniform_f32(70.0, 170.0);
        let edge = if leaf > 120.0 { leaf - 70.0 } else { leaf + 90.0 };
        c.rect(x - 0.07, y - 0.07, w + 0.14, h + 0.07, edge, 1.0);
        c.rect(x, y, w, h, leaf, 1.0);
        c.grain([x, y, x + w, y + h], 8.0);
        if r.chance(0.6) {
            let tone = leaf - 26.0;
            c.frame(x + 0.12 * w, y + 0.08 * h, 0.76 * w, 0.36 * h, 0.02, tone);
            c.frame(x + 0.12 * w, y + 0.54 * h, 0.76 * w, 0.36 * h, 0.02, tone);
        } else {
            c.rect(x + 0.3 * w, y + 0.12 * h, 0.4 * w, 0.3 * h, 215.0, 1.0);
            c.frame(x + 0.3 * w, y + 0.12 * h, 0.4 * w, 0.3 * h, 0.02, 40.0);
        }
        let side = if r.chance(0.5) { x + 0.08 * w } else { x + 0.86 * w };
        c.disc(side, y + 0.52 * h, 0.035, 30.0, 1.0);
        c.line(
            (side, y + 0.52 * h),
            (side + 0.1 * (x + 0.5 * w - side).signum(), y + 0.52 * h),
            0.025,
            225.0,
            1.0,
        );
        c.disc(side, y + 0.58 * h, 0.014, 20.0, 1.0);
        let sx = x + w + 0.14;
        c.rect(sx, y + 0.32 * h, 0.16, 0.11, 235.0, 1.0);
        Self::text(c, r, sx + 0.015, y + 0.32 * h + 0.015, 0.13, 2, 0.028, 235.0);
    }

    /// A window with bars, bright or dark panes and a sill.
    pub fn window(c: &mut Canvas<'_>, r: &mut Random, x: f32, y: f32, w: f32, h: f32) {
        let pane = if r.chance(0.5) { r.uniform_f32(190.0, 235.0) } else { r.uniform_f32(35.0, 80.0) };
        let bar = if pane > 128.0 { r.uniform_f32(40.0, 100.0) } else { r.uniform_f32(190.0, 240.0) };
        c.rect(x - 0.05, y - 0.05, w + 0.1, h + 0.1, bar, 1.0);
        c.rect(x, y, w, h, pane, 1.0);
        for _ in 0..3 + r.below(4) {
            // Reflections, or things behind the glass.
            let (bw, bh) = (w * r.uniform_f32(0.05, 0.3), h * r.uniform_f32(0.1, 0.6));
            let tone = (pane + r.uniform_f32(-60.0, 60.0)).clamp(10.0, 250.0);
            c.rect(x + r.uniform_f32(0.0, 1.0) * (w - bw), y + h - bh, bw, bh, tone, 0.8);
        }
        c.rect(x + w / 2.0 - 0.02, y, 0.04, h, bar, 1.0);
        c.rect(x, y + 0.38 * h, w, 0.04, bar, 1.0);
        c.frame(x, y, w, h, 0.03, bar - 20.0);
        c.rect(x - 0.1, y + h + 0.05, w + 0.2, 0.05, 200.0, 1.0);
        c.rect(x - 0.1, y + h + 0.1, w + 0.2, 0.015, 60.0, 0.7);
    }

    /// Shelves filled with books over the whole canvas.
    pub fn books(c: &mut Canvas<'_>, r: &mut Random, wood: f32) {
        let (w, h) = (c.width_m(), c.height_m());
        c.rect(0.0, 0.0, w, h, 28.0, 1.0);
        let rows = ((h / 0.36) as usize).max(1);
        let pitch = h / rows as f32;
        for row in 0..rows {
            let floor = (row + 1) as f32 * pitch - 0.015;
            let mut x = 0.03;
            while x < w - 0.06 {
                if r.chance(0.06) {
                    x += r.uniform_f32(0.05, 0.2);
                    continue;
                }
                let thick = r.uniform_f32(0.015, 0.055).min(w - 0.03 - x);
                let tall = (pitch - 0.05) * r.uniform_f32(0.6, 0.98);
                let tone = r.uniform_f32(35.0, 235.0);
                c.rect(x, floor - tall, thick, tall, tone, 1.0);
                c.rect(
                    x + thick * 0.2,
                    floor - tall * r.uniform_f32(0.6, 0.9),
                    thick * 0.6,
                    tall * 0.16,
                    255.0 - tone,
                    0.9,
                );
                c.rect(x, floor - tall, 0.003, tall, 15.0, 0.7);
                x += thick + 0.002;
            }
            c.rect(0.0, floor - 0.005, w, 0.025, wood, 1.0);
        }
        c.frame(0.0, 0.0, w, h, 0.03, wood);
        c.grain([0.0, 0.0, w, h], 6.0);
    }

    /// Spots, scratches and stickers all over, `per_m2` of them on a square metre.
    pub fn wear(c: &mut Canvas<'_>, r: &mut Random, per_m2: f32, contrast: f32) {
        let (w, h) = (c.width_m(), c.height_m());
        let n = (w * h * per_m2) as usize;
        for _ in 0..n {
            let (x, y) = (r.uniform_f32(0.0, w), r.uniform_f32(0.0, h));
            let dark = if r.chance(0.7) { 128.0 - contrast } else { 128.0 + contrast };
            let size = 0.006 * (1.0 / r.uniform_f32(0.04, 1.0)).powf(0.9);
            match r.below(5) {
                0 | 1 => c.disc(x, y, size, dark, 0.7),
                2 => {
                    let (s, t) = (size * r.uniform_f32(0.6, 2.0), size * r.uniform_f32(0.6, 2.0));
                    let a = r.uniform_f32(0.0, std::f32::consts::PI);
                    let (ux, uy) = (a.cos() * s, a.sin() * s);
                    let (vx, vy) = (-a.sin() * t, a.cos() * t);
                    let k = [
                        (x - ux - vx, y - uy - vy),
                        (x + ux - vx, y + uy - vy),
                        (x + ux + vx, y + uy + vy),
                        (x - ux + vx, y - uy + vy),
                    ];
                    c.polygon(&k, dark, 0.8);
                }
                _ => {
                    let a = r.uniform_f32(0.0, std::f32::consts::TAU);
                    let len = size * r.uniform_f32(2.0, 7.0);
                    c.line(
                        (x, y),
                        (x + len * a.cos(), y + len * a.sin()),
                        (size * 0.35).max(0.005),
                        dark,
                        0.7,
                    );
                }
            }
        }
    }
}
