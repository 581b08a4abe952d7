//! Times of the ORB extractor, stage by stage, and of the Hamming distance kernels:
//! `cargo bench -p cairn-vision --bench orb`.
//!
//! Prints the minimum, the 20th percentile and the median of many repetitions on one thread; on a busy machine use the
//! first two. The images are synthetic; where `CAIRN_PGM` names a folder of binary PGM images (as written by
//! `tools/compare_orb.py --keep FOLDER`), those are timed too.

use cairn_sensor::GrayImage;
use cairn_vision::orb::{Backend, Stage};
use cairn_vision::{Features, OrbConfig, OrbExtractor, best_two, best_two_of, hamming};
use std::hint::black_box;
use std::time::Instant;

#[path = "../examples/orb_features/pgm.rs"]
mod pgm;

const REPETITIONS: usize = 300;

fn main() {
    for (w, h) in [(752, 480), (640, 480)] {
        images(&format!("synthetic, {w} x {h}"), &[boxes(w, h)]);
    }
    let Ok(folder) = std::env::var("CAIRN_PGM") else {
        println!("skipped: real images (CAIRN_PGM is not set)");
        return time_distances();
    };
    let mut paths: Vec<_> =
        std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    paths.sort();
    let read: Vec<GrayImage> = paths.iter().filter_map(|p| pgm::read(&std::fs::read(p).ok()?)).collect();
    if read.is_empty() {
        println!("skipped: no PGM images in {folder}");
    } else {
        images(&folder, &read);
    }
    time_distances();
}

fn images(name: &str, images: &[GrayImage]) {
    for backend in [Backend::Scalar, Backend::Avx2, Backend::Avx512] {
        if !backend.available() {
            println!("skipped: {backend:?} is not available");
            continue;
        }
        let mut extractor = OrbExtractor::with_backend(OrbConfig::default(), backend);
        let mut features = Features::default();
        let mut stages = [const { Vec::new() }; 5];
        let mut whole = Vec::new();
        for i in 0..REPETITIONS {
            let image = &images[i % images.len()];
            let start = Instant::now();
            for (stage, times) in Stage::ALL.into_iter().zip(&mut stages) {
                let start = Instant::now();
                extractor.run(stage, image, &mut features);
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
            whole.push(start.elapsed().as_secs_f64() * 1e3);
        }
        println!("{name}, {} images, {backend:?}, {} features:", images.len(), features.len());
        for (stage, times) in Stage::ALL.iter().zip(stages) {
            report(&format!("{stage:?}"), times, "ms");
        }
        report("whole", whole, "ms");
    }
}

fn report(name: &str, mut times: Vec<f64>, unit: &str) {
    times.sort_by(f64::total_cmp);
    let at = |percent: usize| times[times.len() * percent / 100];
    println!("  {name:11} min {:7.3}  p20 {:7.3}  median {:7.3} {unit}", at(0), at(20), at(50));
}

fn time_distances() {
    let mut features = Features::default();
    OrbExtractor::new(OrbConfig { features: 2000, ..OrbConfig::default() })
        .extract(&boxes(1280, 960), &mut features);
    let all = &features.descriptors;
    // Sixty candidates per query, scattered in memory as those of a search window are.
    let near: Vec<u32> = (0..60).map(|i| (i * 797 + 13) % all.len() as u32).collect();
    let time = |work: &dyn Fn()| {
        let once = || {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e9
        };
        (0..50).map(|_| once()).collect::<Vec<f64>>()
    };
    let per = |times: Vec<f64>, n: usize| times.into_iter().map(|t| t / n as f64).collect::<Vec<f64>>();
    println!("distances among {} descriptors, per distance:", all.len());
    let single = time(&|| {
        black_box(all.windows(2).map(|p| hamming(&p[0], &p[1])).sum::<u32>());
    });
    report("hamming", per(single, all.len() - 1), "ns");
    let some = time(&|| {
        for query in all {
            black_box(best_two(query, all, &near));
        }
    });
    report("best_two", per(some, all.len() * near.len()), "ns");
    let every = time(&|| {
        for query in all.iter().take(500) {
            black_box(best_two_of(query, all));
        }
    });
    report("best_two_of", per(every, 500 * all.len()), "ns");
}

/// Overlapping boxes of random brightness with noise: about as many corners as an indoor photograph.
fn boxes(w: usize, h: usize) -> GrayImage {
    let mut random = cairn_random::Random::new(1);
    let mut below = |n: usize| random.below(n);
    let mut image = GrayImage::new(w, h);
    for i in 0..600 {
        let side = if i < 60 { 120 } else { 30 };
        let (x0, y0, bw, bh) = (below(w), below(h), 4 + below(side), 4 + below(side));
        let tone = below(200) + 20;
        for y in y0..(y0 + bh).min(h) {
            for x in x0..(x0 + bw).min(w) {
                image.row_mut(y)[x] = (tone + below(9)) as u8;
            }
        }
    }
    image
}
