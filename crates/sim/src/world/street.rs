//! A street: a road with pavements, houses behind hedges, trees, poles, parked cars, hills and a sky.

use super::NamedRoute;
use super::build::Builder;
use super::house;
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};

/// Half width of the road, outer edge of the pavements.
const ROAD: f64 = 3.2;
const PAVED: f64 = 6.0;

/// A road of about 60 m along x.
pub(super) fn build(b: &mut Builder) {
    b.ambient = 0.78;
    b.sun = Some((Vec3::new(0.45, -0.55, 0.7).normalize(), 0.5));
    let length = b.random.uniform(52.0, 62.0);
    let y = 0.5 * (ROAD + PAVED);
    let end = length - 3.0;
    let block = [(3.0, -y), (end, -y), (end, y), (3.0, y), (3.0, -y)];
    b.routes.push(NamedRoute::new("block", &block));
    b.routes.push(NamedRoute::new("along", &[(3.0, -y), (end, -y)]));
    let long: Vec<(f64, f64)> =
        std::iter::once(block[0]).chain((0..6).flat_map(|_| block[1..].to_vec())).collect();
    b.routes.push(NamedRoute::new("long", &long));
    b.areas.push([-2.0, -PAVED - 8.0, length + 2.0, PAVED + 8.0]);
    ground(b, length);
    horizon(b, length);
    for side in [1.0, -1.0] {
        row(b, length, side);
    }
    for (k, x0, side) in [(0, -8.0, 0.0), (1, length + 8.0, std::f64::consts::PI)] {
        b.stream(0xE0 + k);
        let size = Vec3::new(7.0, b.random.uniform(9.0, 13.0), 5.6);
        let shift = b.random.uniform(-2.0, 2.0);
        house::house(b, Vec2::new(x0, shift), size, side);
    }
}

/// Horizontal ground, texture down towards -y.
fn flat(b: &mut Builder, area: [f64; 4], texel: f64, material: Material, wear: f32) {
    let [x0, y0, x1, y1] = area;
    b.quad([Vec3::new(x0, y1, 0.0), Vec3::x(), -Vec3::y()], x1 - x0, y1 - y0, texel, |c, r| {
        material.coat(c);
        Decor::wear(c, r, wear, 60.0);
        if material == Material::Asphalt(105.0) {
            let (w, h) = (c.width_m(), c.height_m());
            let mut x = 1.0;
            while x < w {
                c.rect(x, h / 2.0 - 0.06, 1.5, 0.12, 215.0, 0.85);
                x += 3.0;
            }
            for y in [0.12, h - 0.2] {
                c.rect(0.0, y, w, 0.09, 200.0, 0.8);
            }
            for _ in 0..(w / 9.0) as usize {
                let (px, py) = (r.uniform_f32(1.0, w - 1.0), r.uniform_f32(0.8, h - 0.8));
                c.disc(px, py, 0.32, 60.0, 1.0);
                c.disc(px, py, 0.27, 90.0, 1.0);
                for k in -2..=2 {
                    c.rect(px - 0.18, py + 0.08 * k as f32, 0.36, 0.03, 45.0, 1.0);
                }
            }
        }
    });
}

fn ground(b: &mut Builder, length: f64) {
    b.stream(0x60);
    let (x0, x1) = (-4.5, length + 4.5);
    flat(b, [x0, -ROAD, x1, ROAD], 0.009, Material::Asphalt(105.0), 2.0);
    for (y0, y1) in [(-PAVED, -ROAD), (ROAD, PAVED)] {
        flat(b, [x0, y0, x1, y1], 0.008, Material::Tiles(150.0, 0.5), 2.0);
    }
    for (y0, y1) in [(-PAVED - 9.0, -PAVED), (PAVED, PAVED + 9.0)] {
        flat(b, [x0, y0, x1, y1], 0.018, Material::Leaves(112.0), 0.3);
    }
    let (far, out) = (210.0, PAVED + 9.0);
    let fields = [
        [-far, out, length + far, far],
        [-far, -far, length + far, -out],
        [-far, -out, x0, out],
        [x1, -out, length + far, out],
    ];
    for area in fields {
        flat(b, area, 0.2, Material::Leaves(112.0), 0.0);
    }
}

/// Hills all round at 200 m and clouds above.
fn horizon(b: &mut Builder, length: f64) {
    b.stream(0x5C);
    // The sky is not lit: it is the light source.
    let (ambient, sun) = (std::mem::replace(&mut b.ambient, 1.0), b.sun.take());
    let (mid, far, high) = (length / 2.0, 200.0 + length / 2.0, 46.0);
    for k in 0..4 {
        let out = [Vec3::x(), Vec3::y(), -Vec3::x(), -Vec3::y()][k];
        let right = out.cross(&Vec3::z());
        let origin = Vec3::new(mid, 0.0, high) + out * far - right * far;
        b.quad([origin, right, -Vec3::z()], 2.0 * far, high, 0.15, |c, r| {
            Material::Sky.coat(c);
            let (w, h) = (c.width_m(), c.height_m());
            for tone in [150.0, 120.0, 92.0] {
                let mut x = -20.0;
                while x < w {
                    let (r2, up) = (r.uniform_f32(4.0, 26.0), r.uniform_f32(2.0, 9.0) + (tone - 92.0) * 0.16);
                    c.shape([x - r2, h - up, x + r2, h], tone + r.uniform_f32(-12.0, 12.0), 1.0, |px, py| {
                        (((px - x) / r2).powi(2) + ((h - py) / up).powi(2)).sqrt().mul_add(up, -up)
                    });
                    x += r.uniform_f32(3.0, 14.0);
                }
            }
        });
    }
    let side = 4.6 * far;
    let origin = Vec3::new(mid - side / 2.0, -side / 2.0, 100.0);
    b.quad([origin, Vec3::x(), Vec3::y()], side, side, 0.7, |c, _| Material::Sky.coat(c));
    (b.ambient, b.sun) = (ambient, sun);
}

/// Houses, hedges, trees, poles and cars on one side of the road.
fn row(b: &mut Builder, length: f64, side: f64) {
    b.stream(if side > 0.0 { 0x71 } else { 0x72 });
    let mut x = 0.5;
    while x + 7.0 < length {
        let wide = b.random.uniform(7.0, 11.0).min(length - x);
        let deep = b.random.uniform(6.0, 8.0);
        let back = b.random.uniform(1.6, 3.6);
        let size = Vec3::new(deep, wide, if b.random.chance(0.6) { 5.6 } else { 3.1 });
        let at = Vec2::new(x + wide / 2.0, side * (PAVED + back + deep / 2.0));
        house::house(b, at, size, -side * std::f64::consts::FRAC_PI_2);
        let y = side * (PAVED + 0.3);
        if b.random.chance(0.7) {
            house::hedge(b, Vec2::new(x + 0.2, y), Vec2::new(x + wide * 0.4, y));
        }
        if b.random.chance(0.7) {
            house::hedge(b, Vec2::new(x + wide * 0.6, y), Vec2::new(x + wide - 0.2, y));
        }
        x += wide + b.random.uniform(0.8, 4.0);
    }
    let mut x = 4.0;
    while x < length - 3.0 {
        let kerb = Vec2::new(x, side * (ROAD + 0.3));
        let (tree, yaw) = (b.random.chance(0.6), b.random.uniform(0.0, 1.5));
        // Walkers cut corners by some decimetres.
        if b.has_room(kerb, Vec2::new(0.16, 0.16), yaw, 0.8) {
            if tree {
                house::tree(b, kerb);
            } else {
                house::pole(b, kerb, yaw);
            }
        }
        x += b.random.uniform(5.0, 9.0);
    }
    let mut x = 7.0;
    while x < length - 9.0 {
        if b.random.chance(0.55) {
            let yaw = b.random.uniform(-0.04, 0.04);
            house::car(b, Vec2::new(x, side * (ROAD - 1.05)), yaw);
        }
        x += b.random.uniform(6.0, 11.0);
    }
}
