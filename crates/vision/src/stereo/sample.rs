//! Bilinear sampling of a warped patch with positions in 1/65536 pixel; portable Rust here, AVX2 in `sample_avx2`,
//! bit-identical.

use super::lattice::Lattice;
use super::patch::{PADDED, Patch, RADIUS, SIDE};
use crate::orb::Backend;
use cairn_sensor::GrayImage;

/// Samples the patch around `centre`; `None` where it is partly outside the image.
pub(super) fn sample(
    image: &GrayImage,
    centre: [f64; 2],
    affine: &[f32; 4],
    out: &mut Patch,
    backend: Backend,
) -> Option<()> {
    let lattice = Lattice::new(image, centre, affine)?;
    #[cfg(target_arch = "x86_64")]
    if backend.has_avx2() {
        super::sample_avx2::sample(image, &lattice, out);
        return Some(());
    }
    let _ = backend;
    sample_scalar(image, &lattice, out);
    Some(())
}

fn sample_scalar(image: &GrayImage, l: &Lattice, out: &mut Patch) {
    let data = image.data();
    let stride = image.width();
    let [a, b, c, d] = l.step;
    let value = |px: i32, py: i32| {
        let at = (py >> 16) as usize * stride + (px >> 16) as usize;
        let (fx, fy) = ((px >> 8) & 0xff, (py >> 8) & 0xff);
        let upper = &data[at..at + 2];
        let lower = &data[at + stride..at + stride + 2];
        let top = upper[0] as i32 * (256 - fx) + upper[1] as i32 * fx;
        let bottom = lower[0] as i32 * (256 - fx) + lower[1] as i32 * fx;
        ((top << 8) + (bottom - top) * fy) as f32 * (1.0 / 65536.0)
    };
    for (j, row) in out.chunks_exact_mut(SIDE).take(SIDE).enumerate() {
        let dj = j as i32 - RADIUS;
        let mut px = l.x - RADIUS * a + dj * b;
        let mut py = l.y - RADIUS * c + dj * d;
        for v in row {
            *v = value(px, py);
            px += a;
            py += c;
        }
    }
    // The value that vector code writes to the padding.
    out[SIDE * SIDE..PADDED].fill(value(l.x, l.y));
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    fn noise(rng: &mut Random, w: usize, h: usize) -> GrayImage {
        GrayImage::from_vec(w, h, (0..w * h).map(|_| rng.below(256) as u8).collect()).unwrap()
    }

    #[test]
    fn backends_are_bit_identical() {
        let mut rng = Random::new(51);
        if !Backend::Avx2.available() {
            println!("skipped: no AVX2 on this machine");
            return;
        }
        let image = noise(&mut rng, 61, 47);
        let (mut inside, mut outside) = (0, 0);
        for _ in 0..20_000 {
            let centre = [rng.uniform(-3.0, 64.0), rng.uniform(-3.0, 50.0)];
            let affine = std::array::from_fn(|k| {
                (rng.uniform(-0.6, 0.6) + if k == 0 || k == 3 { 1.0 } else { 0.0 }) as f32
            });
            let (mut a, mut b) = ([0.0; PADDED], [1.0; PADDED]);
            let first = sample(&image, centre, &affine, &mut a, Backend::Scalar);
            assert_eq!(first, sample(&image, centre, &affine, &mut b, Backend::Avx2));
            if first.is_some() {
                assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
                inside += 1;
            } else {
                outside += 1;
            }
        }
        assert!(inside > 1000 && outside > 1000, "{inside} {outside}");
    }

    #[test]
    fn ramp_is_sampled_exactly() {
        let data = (0..40 * 40).map(|i| (2 * (i % 40) + 3 * (i / 40)) as u8).collect();
        let image = GrayImage::from_vec(40, 40, data).unwrap();
        let mut out = [0.0; PADDED];
        for backend in [Backend::Scalar, Backend::detect()] {
            sample(&image, [20.25, 18.5], &[1.0, 0.125, -0.25, 0.75], &mut out, backend).unwrap();
            for j in 0..SIDE {
                for i in 0..SIDE {
                    let (di, dj) = (i as f32 - RADIUS as f32, j as f32 - RADIUS as f32);
                    let (x, y) = (20.25 + di + 0.125 * dj, 18.5 - 0.25 * di + 0.75 * dj);
                    assert!((out[j * SIDE + i] - (2.0 * x + 3.0 * y)).abs() < 0.02);
                }
            }
        }
    }
}
