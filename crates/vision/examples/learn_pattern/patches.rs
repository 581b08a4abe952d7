//! Pairs of views of the same corner: blurred values at all points of the pattern's disc, rotated to the corner's
//! orientation.

use super::scene::{Rng, SIDE, Scene};

/// Radius of the pattern in pixels.
pub const RADIUS: i32 = 15;
/// Width in pixels of the image border in which no corner is detected.
const BORDER: usize = 24;
const IMAGE: usize = 256;

/// The pattern's disc: all points that a test may compare.
pub fn disc() -> Vec<[i8; 2]> {
    let all = (-RADIUS..=RADIUS).flat_map(|y| (-RADIUS..=RADIUS).map(move |x| [x, y]));
    all.filter(|[x, y]| x * x + y * y <= RADIUS * RADIUS).map(|p| p.map(|c| c as i8)).collect()
}

/// Values of many corners in two views: `views[view][point][corner]`.
pub struct Patches {
    pub corners: usize,
    pub views: [Vec<Vec<u8>>; 2],
}

/// Renders two views of each of `scenes` scenes and collects the corners visible in both.
pub fn collect(scenes: u64) -> Patches {
    let points = disc();
    let mut views = [vec![Vec::new(); points.len()], vec![Vec::new(); points.len()]];
    for seed in 0..scenes {
        let scene = Scene::new(seed + 1);
        let mut rng = Rng::new(seed + 1_000_000);
        let half = IMAGE as f64 / 2.0 - 0.5;
        let first =
            View::new(scene.image(IMAGE, &mut rng, |x, y| [x - half + SIDE / 2.0, y - half + SIDE / 2.0]));
        // The second view is rotated, scaled by up to the ratio of neighbouring pyramid levels, and slightly sheared.
        let ([c, s], scale, shear) = (rng.direction(), rng.real(0.87, 1.15), rng.real(-0.12, 0.12));
        let to_scene = [[c / scale, (shear * c - s) / scale], [s / scale, (shear * s + c) / scale]];
        let second = View::new(scene.image(IMAGE, &mut rng, |x, y| {
            let (x, y) = (x - half, y - half);
            to_scene.map(|row| row[0] * x + row[1] * y + SIDE / 2.0)
        }));
        let det = to_scene[0][0] * to_scene[1][1] - to_scene[0][1] * to_scene[1][0];
        for [x, y] in first.corners() {
            let (dx, dy) = (x as f64 - half, y as f64 - half);
            // Half a pixel of localisation noise.
            let u = (to_scene[1][1] * dx - to_scene[0][1] * dy) / det + half + 0.5 * rng.normal();
            let v = (to_scene[0][0] * dy - to_scene[1][0] * dx) / det + half + 0.5 * rng.normal();
            let inside = |c: f64| c.round() >= BORDER as f64 && c.round() < (IMAGE - BORDER) as f64;
            if inside(u) && inside(v) {
                first.sample(x, y, &points, &mut views[0]);
                second.sample(u.round() as usize, v.round() as usize, &points, &mut views[1]);
            }
        }
    }
    Patches { corners: views[0][0].len(), views }
}

struct View {
    image: Vec<u8>,
    blurred: Vec<u8>,
}

impl View {
    fn new(image: Vec<u8>) -> Self {
        Self { blurred: blur(&image), image }
    }

    fn at(&self, x: usize, y: usize) -> f64 {
        self.image[y * IMAGE + x] as f64
    }

    /// The strongest corner of each cell of 14 x 14 pixels, by the smaller eigenvalue of the structure tensor (Shi and
    /// Tomasi 1994).
    fn corners(&self) -> Vec<[usize; 2]> {
        let mut out = vec![];
        for y0 in (BORDER..IMAGE - BORDER - 14).step_by(14) {
            for x0 in (BORDER..IMAGE - BORDER - 14).step_by(14) {
                let pixels = (0..14 * 14).map(|i| [x0 + i % 14, y0 + i / 14]);
                let best = pixels
                    .map(|[x, y]| (self.strength(x, y), [x, y]))
                    .fold((0.0, [0, 0]), |a, b| if b.0 > a.0 { b } else { a });
                if best.0 > 2000.0 {
                    out.push(best.1);
                }
            }
        }
        out
    }

    fn strength(&self, x: usize, y: usize) -> f64 {
        let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
        for v in y - 2..=y + 2 {
            for u in x - 2..=x + 2 {
                let gx = self.at(u + 1, v) - self.at(u - 1, v);
                let gy = self.at(u, v + 1) - self.at(u, v - 1);
                (a, b, c) = (a + gx * gx, b + gx * gy, c + gy * gy);
            }
        }
        (a + c) / 2.0 - ((a - c) * (a - c) / 4.0 + b * b).sqrt()
    }

    /// Appends the blurred values around a corner, rotated by its intensity centroid angle.
    fn sample(&self, x: usize, y: usize, points: &[[i8; 2]], out: &mut [Vec<u8>]) {
        let (mut m10, mut m01) = (0.0, 0.0);
        for &[dx, dy] in points {
            let value = self.at(x.wrapping_add_signed(dx as isize), y.wrapping_add_signed(dy as isize));
            (m10, m01) = (m10 + dx as f64 * value, m01 + dy as f64 * value);
        }
        let norm = (m10 * m10 + m01 * m01).sqrt();
        let (c, s) = if norm > 0.0 { (m10 / norm, m01 / norm) } else { (1.0, 0.0) };
        for (&[dx, dy], out) in points.iter().zip(out) {
            let (dx, dy) = (dx as f64, dy as f64);
            let u = x.wrapping_add_signed((dx * c - dy * s).round() as isize);
            let v = y.wrapping_add_signed((dx * s + dy * c).round() as isize);
            out.push(self.blurred[v * IMAGE + u]);
        }
    }
}

/// The extractor's Gaussian blur (7 x 7, sigma 2) with replicated edges.
fn blur(image: &[u8]) -> Vec<u8> {
    const KERNEL: [u32; 7] = [9, 17, 24, 28, 24, 17, 9];
    let pass = |source: &[u8], step: [isize; 2]| -> Vec<u8> {
        let clamp = |c: usize, d: isize| (c as isize + d).clamp(0, IMAGE as isize - 1) as usize;
        let pixel = |i: usize| {
            let sum: u32 = (0..7)
                .map(|k| {
                    let d = k as isize - 3;
                    let at = clamp(i / IMAGE, d * step[1]) * IMAGE + clamp(i % IMAGE, d * step[0]);
                    KERNEL[k] * source[at] as u32
                })
                .sum();
            ((sum + 64) >> 7) as u8
        };
        (0..source.len()).map(pixel).collect()
    };
    pass(&pass(image, [0, 1]), [1, 0])
}
