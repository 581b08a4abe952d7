//! Tests of the whole extractor on synthetic images.

use super::*;
use cairn_random::Random;
use cairn_sensor::GrayImage;

fn noise(w: usize, h: usize, seed: u64) -> GrayImage {
    let mut random = Random::new(seed);
    GrayImage::from_vec(w, h, (0..w * h).map(|_| random.below(256) as u8).collect()).unwrap()
}

/// A continuous scene of overlapping boxes with soft edges; boxes are indexed by the cells they can cover.
struct Scene(Vec<Vec<[f64; 7]>>);

const CELL: f64 = 32.0;
const CELLS: usize = 40;

impl Scene {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut unit = || random.unit();
        let mut cells = vec![Vec::new(); CELLS * CELLS];
        for _ in 0..900 {
            let (s, c) = (unit() * 3.2).sin_cos();
            let at = [unit() * 900.0 - 150.0, unit() * 900.0 - 150.0];
            let half = [4.0 + unit() * 22.0, 4.0 + unit() * 22.0];
            let shape = [at[0], at[1], half[0], half[1], s, c, unit() * 255.0];
            for y in cell(at[1] - 38.0)..=cell(at[1] + 38.0) {
                for x in cell(at[0] - 38.0)..=cell(at[0] + 38.0) {
                    cells[y * CELLS + x].push(shape);
                }
            }
        }
        Self(cells)
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let mut value = 100.0;
        for &[cx, cy, a, b, s, c, tone] in &self.0[cell(y) * CELLS + cell(x)] {
            let (dx, dy) = (x - cx, y - cy);
            let inside = (a - (c * dx + s * dy).abs()).min(b - (c * dy - s * dx).abs());
            value += (tone - value) * (inside + 0.5).clamp(0.0, 1.0);
        }
        value
    }

    /// The image whose pixel `p` shows the scene at `scene_from_image(p)`.
    fn image(&self, w: usize, h: usize, scene_from_image: impl Fn(f64, f64) -> [f64; 2]) -> GrayImage {
        let pixel = |i: usize| {
            let mut sum = 0.0;
            for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                let [x, y] = scene_from_image((i % w) as f64 + dx, (i / w) as f64 + dy);
                sum += self.at(x, y);
            }
            (sum / 4.0).round() as u8
        };
        GrayImage::from_vec(w, h, (0..w * h).map(pixel).collect()).unwrap()
    }
}

/// Cell of a coordinate; the scene begins at -256.
fn cell(c: f64) -> usize {
    (((c + 256.0) / CELL).max(0.0) as usize).min(CELLS - 1)
}

fn extract(image: &GrayImage, config: OrbConfig, backend: Backend) -> Features {
    let mut out = Features::default();
    OrbExtractor::with_backend(config, backend).extract(image, &mut out);
    out
}

fn default(image: &GrayImage) -> Features {
    extract(image, OrbConfig::default(), Backend::detect())
}

#[test]
fn backends_are_bit_identical() {
    let vectors: Vec<Backend> = Backend::every().into_iter().filter(|b| *b != Backend::Scalar).collect();
    if !vectors.contains(&Backend::Avx512) {
        println!("skipped: of AVX2 and AVX-512 this machine has {vectors:?}");
    }
    let mut images = vec![];
    for (w, h) in [(33, 33), (34, 61), (63, 64), (65, 40), (97, 131), (128, 96), (223, 57), (301, 199)] {
        images.push(noise(w, h, (w * h) as u64));
    }
    images.push(Scene::new(5).image(320, 240, |x, y| [x, y]));
    // Only 0 and 255: every difference saturates.
    let mut hard = noise(190, 150, 3);
    hard.data_mut().iter_mut().for_each(|v| *v = if *v < 110 { 0 } else { 255 });
    images.push(hard);
    images.push(GrayImage::from_vec(100, 80, vec![0; 8000]).unwrap());
    images.push(GrayImage::from_vec(100, 80, vec![255; 8000]).unwrap());
    for image in &images {
        for (factor, fast_low) in [(1.2, 7), (1.2, 0), (1.05, 7), (1.6, 7), (1.41, 254)] {
            let config = OrbConfig { factor, fast_low, features: 700, ..OrbConfig::default() };
            let mut scalar = OrbExtractor::with_backend(config, Backend::Scalar);
            let (mut a, mut b) = (Features::default(), Features::default());
            scalar.extract(image, &mut a);
            let all = vectors.iter().flat_map(|backend| [(*backend, false), (*backend, true)]);
            for (backend, two_threads) in all.chain([(Backend::Scalar, true)]) {
                let vector = OrbExtractor::with_backend(config, backend);
                let mut vector = vector.with_two_threads(two_threads);
                vector.extract(image, &mut b);
                assert_eq!(scalar.pyramid().levels(), vector.pyramid().levels());
                assert_eq!(a, b, "{backend:?}, {} x {}, factor {factor}", image.width(), image.height());
            }
        }
    }
}

#[test]
fn small_or_flat_images_give_no_features() {
    for (w, h) in [(0, 0), (1, 1), (7, 300), (32, 32), (32, 640), (640, 31)] {
        assert!(default(&noise(w, h, 1)).is_empty(), "{w} x {h}");
    }
    for value in [0, 255] {
        assert!(default(&GrayImage::from_vec(640, 480, vec![value; 640 * 480]).unwrap()).is_empty());
    }
    let wild = OrbConfig { features: 0, levels: 0, factor: f64::NAN, fast_high: 0, fast_low: 255 };
    assert!(extract(&noise(100, 100, 1), wild, Backend::detect()).is_empty());
    let wild = OrbConfig { levels: 999, factor: 1e9, ..OrbConfig::default() };
    assert!(!extract(&noise(100, 100, 1), wild, Backend::detect()).is_empty());
}

#[test]
fn feature_count_respects_the_limit() {
    let image = Scene::new(1).image(640, 480, |x, y| [x, y]);
    for features in [1, 7, 100, 333, 1000] {
        let n = extract(&image, OrbConfig { features, ..OrbConfig::default() }, Backend::detect()).len();
        assert!(n <= features && n * 100 >= features * 99, "{n} of {features}");
    }
}

#[test]
fn reused_extractor_equals_a_new_one() {
    let (a, b) = (Scene::new(1).image(320, 240, |x, y| [x, y]), noise(200, 300, 9));
    let mut used = OrbExtractor::new(OrbConfig::default());
    let mut out = Features::default();
    for image in [&a, &b, &a, &noise(20, 20, 1), &b] {
        used.extract(image, &mut out);
        assert_eq!(out, default(image));
    }
}

#[test]
fn low_contrast_image_gives_corners() {
    let mut image = Scene::new(2).image(320, 240, |x, y| [x, y]);
    image.data_mut().iter_mut().for_each(|v| *v = 100 + *v / 12);
    let found = default(&image);
    assert!(found.len() > 100, "{}", found.len());
    assert!(found.response.iter().all(|&r| r <= 22.0));
}

#[test]
fn features_are_distributed_over_the_image() {
    // Contrast falls by a factor of sixteen from left to right.
    let mut image = Scene::new(3).image(640, 480, |x, y| [x, y]);
    for y in 0..480 {
        for (x, v) in image.row_mut(y).iter_mut().enumerate() {
            *v = (128.0 + (*v as f64 - 128.0) * 0.0625f64.powf(x as f64 / 640.0)) as u8;
        }
    }
    let filled = |points: &[[f32; 2]]| {
        let mut cells = [0usize; 8 * 6];
        for p in points {
            cells[(p[1] / 80.0) as usize * 8 + (p[0] / 80.0) as usize] += 1;
        }
        (cells.iter().filter(|&&n| n > 0).count(), *cells.iter().max().unwrap())
    };
    let spread = default(&image).raw;
    // For comparison: the same number of the strongest corners, wherever they are.
    let all = extract(&image, OrbConfig { features: 100_000, ..OrbConfig::default() }, Backend::detect());
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|&a, &b| all.response[b].total_cmp(&all.response[a]));
    let strongest: Vec<_> = order.iter().take(spread.len()).map(|&i| all.raw[i]).collect();
    let ((here, most), (there, most_there)) = (filled(&spread), filled(&strongest));
    println!(
        "{here} of 48 cells have a feature (at most {most}); taking the strongest corners only: {there} ({most_there})"
    );
    assert!(here >= 40 && here >= there + 8, "{here} {there}");
    assert!(most < most_there, "{most} {most_there}");
}

/// Repeatability: the share of features of `a` whose best descriptor match in `b` lies at the position given by
/// `b_from_a`, and the median error of those positions in pixels.
fn repeatability(
    a: &Features,
    b: &Features,
    b_from_a: impl Fn([f32; 2]) -> [f64; 2],
    size: [f64; 2],
) -> (f64, f64) {
    let (mut visible, mut errors) = (0, vec![]);
    for i in 0..a.len() {
        let p = b_from_a(a.raw[i]);
        if p[0] < 60.0 || p[1] < 60.0 || p[0] > size[0] - 60.0 || p[1] > size[1] - 60.0 {
            continue;
        }
        visible += 1;
        let best = best_two_of(&a.descriptors[i], &b.descriptors);
        let q = b.raw[best.index as usize];
        let error = (q[0] as f64 - p[0]).hypot(q[1] as f64 - p[1]);
        if error < 3.0 {
            errors.push(error);
        }
    }
    errors.sort_by(f64::total_cmp);
    (errors.len() as f64 / visible as f64, errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN))
}

#[test]
fn features_repeat_after_rotation_and_scaling() {
    let scene = Scene::new(4);
    let (w, h) = (480, 480);
    let reference = default(&scene.image(w, h, |x, y| [x + 60.0, y + 60.0]));
    for (degrees, scale, least) in [
        (0.0f64, 1.0f64, 0.99),
        (25.0, 1.0, 0.8),
        (90.0, 1.0, 0.92),
        (180.0, 1.0, 0.9),
        (0.0, 1.3, 0.78),
        (-40.0, 0.8, 0.65),
    ] {
        let (s, c) = degrees.to_radians().sin_cos();
        let centre = 239.5;
        // Image pixel to scene, and the inverse for reference pixels.
        let rotated = scene.image(w, h, |x, y| {
            let (x, y) = ((x - centre) / scale, (y - centre) / scale);
            [c * x - s * y + centre + 60.0, s * x + c * y + centre + 60.0]
        });
        let there = |p: [f32; 2]| {
            let (x, y) = ((p[0] as f64 - centre) * scale, (p[1] as f64 - centre) * scale);
            [c * x + s * y + centre, -s * x + c * y + centre]
        };
        let (share, error) = repeatability(&reference, &default(&rotated), there, [w as f64, h as f64]);
        println!(
            "rotated {degrees}, scaled {scale}: {:.1} % repeated, median error {error:.3} px",
            share * 100.0
        );
        assert!(share > least, "{degrees} {scale}: {share}");
        assert!(error < 0.5, "{degrees} {scale}: {error}");
    }
}

#[test]
fn orientations_rotate_with_the_image() {
    let scene = Scene::new(4);
    // A rotation by 90 degrees preserves the pixel grid of level 0, but not those of other levels.
    let one = OrbConfig { levels: 1, ..OrbConfig::default() };
    let a = extract(&scene.image(320, 320, |x, y| [x, y]), one, Backend::detect());
    let b = extract(&scene.image(320, 320, |x, y| [319.0 - y, x]), one, Backend::detect());
    let mut checked = 0;
    for (p, angle) in a.raw.iter().zip(&a.angle) {
        // Scene position (x, y) appears at (y, 319 - x).
        let q = [p[1], 319.0 - p[0]];
        if let Some(j) = b.raw.iter().position(|r| (r[0] - q[0]).hypot(r[1] - q[1]) < 0.05) {
            let turn = (b.angle[j] - angle + std::f32::consts::FRAC_PI_2).sin();
            checked += (turn.abs() < 0.02) as usize;
        }
    }
    assert!(checked * 10 > a.len() * 9, "{checked} of {}", a.len());
}
