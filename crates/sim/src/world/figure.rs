//! Passers-by: figures of painted boxes whose arms and legs swing.

use super::build::{Builder, sides};
use super::{Face, World};
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};

/// Textures of one figure: cloth, trousers, head.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wardrobe {
    parts: [(usize, f64); 3],
}

impl Wardrobe {
    /// The texture of the cloth, and its texels per metre.
    pub fn cloth(&self) -> (usize, f64) {
        self.parts[0]
    }
}

/// A figure at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Index of the clothes.
    pub clothes: usize,
    /// Position on the floor, metres.
    pub at: Vec2,
    /// Its heading, radians from x.
    pub heading: f64,
    /// Angle of the swing, radians.
    pub swing: f64,
}

/// Someone who walks to and fro along a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Passer {
    /// Corners of the line, metres.
    pub line: Vec<Vec2>,
    /// Metres a second.
    pub speed: f64,
    /// Its position on the line at time 0, metres.
    pub start: f64,
    /// Index of the clothes.
    pub clothes: usize,
}

impl Passer {
    /// The figure at a time in seconds.
    pub fn figure(&self, seconds: f64) -> Figure {
        let lengths: Vec<f64> = self.line.windows(2).map(|w| (w[1] - w[0]).norm()).collect();
        let total: f64 = lengths.iter().sum();
        let walked = self.start + self.speed * seconds;
        let phase = walked.rem_euclid(2.0 * total.max(1e-6));
        let (mut left, back) = if phase <= total { (phase, false) } else { (2.0 * total - phase, true) };
        let mut at = self.line.first().copied().unwrap_or_else(Vec2::zeros);
        let mut heading = 0.0;
        for (w, length) in self.line.windows(2).zip(&lengths) {
            let step = left.min(*length);
            let dir = (w[1] - w[0]) / length.max(1e-9);
            at = w[0] + dir * step;
            heading = dir.y.atan2(dir.x);
            left -= step;
            if left <= 0.0 {
                break;
            }
        }
        let turn = if back { std::f64::consts::PI } else { 0.0 };
        Figure { clothes: self.clothes, at, heading: heading + turn, swing: walked * 4.4 }
    }
}

/// Paints the clothes that figures of this world wear.
pub(crate) fn wardrobes(b: &mut Builder) -> Vec<Wardrobe> {
    (0..4)
        .map(|i| {
            b.stream(0xBEEF + i);
            let frame = [Vec3::new(0.0, 0.0, -50.0), Vec3::x(), -Vec3::z()];
            let (lamps, ambient, sun) = (std::mem::take(&mut b.lights), b.ambient, b.sun.take());
            b.ambient = 0.8;
            let (shirt, trousers) = (b.random.uniform_f32(50.0, 210.0), b.random.uniform_f32(30.0, 110.0));
            let parts = [
                b.paint(frame, 0.62, 0.62, 0.005, |c, r| {
                    Material::Carpet(shirt).coat(c);
                    for k in 0..4 {
                        c.rect(
                            0.0,
                            0.08 + 0.15 * k as f32,
                            0.62,
                            r.uniform_f32(0.02, 0.06),
                            255.0 - shirt,
                            0.8,
                        );
                    }
                    Decor::picture(c, r, 0.12, 0.15, 0.22, 0.22);
                }),
                b.paint(frame, 0.3, 0.9, 0.005, |c, r| {
                    Material::Carpet(trousers).coat(c);
                    Decor::wear(c, r, 20.0, 40.0);
                    let h = c.height_m();
                    c.rect(0.0, h - 0.08, 0.4, 0.08, 20.0, 1.0);
                }),
                b.paint(frame, 0.26, 0.3, 0.004, |c, _| {
                    Material::Plaster(165.0).coat(c);
                    c.rect(0.0, 0.0, 0.3, 0.08, 35.0, 1.0);
                    for x in [0.05, 0.13] {
                        c.disc(x, 0.13, 0.014, 20.0, 1.0);
                    }
                    c.line((0.06, 0.22), (0.13, 0.22), 0.014, 60.0, 1.0);
                }),
            ];
            (b.lights, b.ambient, b.sun) = (lamps, ambient, sun);
            Wardrobe { parts }
        })
        .collect()
}

impl Figure {
    /// The boxes of the figure as faces.
    pub(crate) fn faces(&self, world: &World) -> Vec<Face> {
        let Some(wardrobe) = world.wardrobe.get(self.clothes % world.wardrobe.len().max(1)) else {
            return Vec::new();
        };
        let (s, c) = self.heading.sin_cos();
        let (x, y, z) = (Vec3::new(c, s, 0.0), Vec3::new(-s, c, 0.0), Vec3::z());
        let foot = Vec3::new(self.at.x, self.at.y, 0.0);
        let mut faces = Vec::new();
        let mut put = |part: usize, hang: Vec3, swing: f64, size: Vec3| {
            // A box that hangs at a point and swings about the figure's y axis.
            let (ss, cs) = swing.sin_cos();
            let axes = [x * cs + z * ss, y, z * cs - x * ss];
            let middle = foot + x * hang.x + y * hang.y + z * hang.z - axes[2] * (size.z / 2.0);
            let (texture, scale) = wardrobe.parts[part];
            for (_, (frame, w, h)) in sides(&middle, &axes, &size) {
                let k = vec![Vec2::zeros(), Vec2::new(w, 0.0), Vec2::new(w, h), Vec2::new(0.0, h)];
                faces.push(Face::new(frame, k, texture, scale));
            }
        };
        let swing = 0.45 * self.swing.sin();
        put(0, Vec3::new(0.0, 0.0, 1.45), 0.0, Vec3::new(0.24, 0.42, 0.6));
        put(2, Vec3::new(0.02, 0.0, 1.74), 0.0, Vec3::new(0.2, 0.18, 0.26));
        put(1, Vec3::new(0.0, 0.1, 0.88), swing, Vec3::new(0.16, 0.15, 0.86));
        put(1, Vec3::new(0.0, -0.1, 0.88), -swing, Vec3::new(0.16, 0.15, 0.86));
        put(0, Vec3::new(0.0, 0.27, 1.42), -swing, Vec3::new(0.1, 0.1, 0.58));
        put(0, Vec3::new(0.0, -0.27, 1.42), swing, Vec3::new(0.1, 0.1, 0.58));
        faces
    }
}
