//! Prints the fastest of many runs to unproject 1000 pixels to rays and project them back, for each lens model.
//!
//! `cargo run --release -p cairn-sensor --example unproject_speed`

use cairn_geometry::{Vec2, Vec3};
use cairn_sensor::{Camera, Distortion};
use std::hint::black_box;
use std::time::Instant;

fn main() {
    let lenses = [
        Distortion::None,
        Distortion::RadialTangential([-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]),
        Distortion::Rational([0.4525, -2.6247, 0.00056, -0.0002, 1.5108, 0.3318, -2.4461, 1.4374]),
        Distortion::InverseRadialTangential([-0.0557, 0.0672, -0.00052, 0.00056, -0.0218]),
        Distortion::Equidistant([0.0034823894, 0.000715034845, -0.002053236141, 0.000202936736]),
        Distortion::Fov(0.92),
        Distortion::DoubleSphere { xi: -0.18, alpha: 0.59 },
    ];
    for distortion in lenses {
        let camera = Camera { distortion, ..Camera::pinhole(752, 480, 458.654, 457.296, 367.215, 248.375) };
        let pixels: Vec<Vec2> =
            (0..1000).map(|i| Vec2::new((i * 37 % 752) as f64, (i * 91 % 480) as f64)).collect();
        let rays: Vec<Vec3> = pixels.iter().filter_map(|p| camera.unproject(p)).collect();
        let (mut back, mut forth) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..200 {
            let start = Instant::now();
            for p in &pixels {
                black_box(camera.unproject(black_box(p)));
            }
            back = back.min(start.elapsed().as_secs_f64());
            let start = Instant::now();
            for r in &rays {
                black_box(camera.project(black_box(r)));
            }
            forth = forth.min(start.elapsed().as_secs_f64());
        }
        let (back, forth) = (back * 1e3, forth * 1e3);
        println!(
            "{:<26} unproject {back:.4} ms   project {forth:.4} ms   ({} rays)",
            distortion.name(),
            rays.len()
        );
    }
}
