//! The objects in a street: houses, trees, poles, cars, hedges.

use super::build::{Block, BoxFace, Builder, turned};
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};

/// A house with a gable roof; its front (the side with the door) looks along its own +x.
pub(super) fn house(b: &mut Builder, at: Vec2, size: Vec3, yaw: f64) {
    b.add_obstacle(at, Vec2::new(size.x / 2.0, size.y / 2.0), yaw);
    let wall = match b.random.below(3) {
        0 => Material::Brick(b.random.uniform_f32(95.0, 140.0)),
        1 => Material::Plaster(b.random.uniform_f32(150.0, 200.0)),
        _ => Material::Brick(b.random.uniform_f32(70.0, 100.0)),
    };
    let poor = b.options.poor_walls;
    b.block(&Block { at, base: 0.0, size, yaw, texel: 0.01 }, |which, c, r| {
        if r.chance(poor) {
            Material::Plain(175.0).coat(c);
            return;
        }
        wall.coat(c);
        if which == BoxFace::Top {
            return;
        }
        Decor::wear(c, r, 1.5, 50.0);
        let (w, h) = (c.width_m(), c.height_m());
        let floors = (h / 2.7) as usize;
        let door = if which == BoxFace::Front { r.uniform_f32(0.25, 0.7) * w } else { -9.0 };
        for floor in 0..floors {
            let y = h - 2.3 - 2.7 * floor as f32;
            let mut x = r.uniform_f32(0.5, 1.1);
            while x + 1.3 < w {
                let (ww, wh) = (r.uniform_f32(0.8, 1.2), r.uniform_f32(1.1, 1.35));
                if floor > 0 || (x - door - 0.5).abs() > 1.4 {
                    Decor::window(c, r, x, y, ww, wh);
                }
                x += ww + r.uniform_f32(0.6, 1.5);
            }
        }
        if which == BoxFace::Front {
            Decor::door(c, r, door, 1.0, 2.1);
            Decor::text(c, r, door, h - 2.5, 1.0, 1, 0.14, 100.0);
        }
        c.rect(0.15, 0.0, 0.09, h, 60.0, 1.0);
        c.rect(0.0, h - 0.35, w, 0.35, 80.0, 0.7);
    });
    roof(b, at, size, yaw);
}

/// Two slopes and two triangles.
fn roof(b: &mut Builder, at: Vec2, size: Vec3, yaw: f64) {
    let [x, y, z] = turned(yaw);
    let top = Vec3::new(at.x, at.y, size.z);
    let rise = 0.55 * size.x / 2.0 + 0.8;
    let slope = rise.hypot(size.x / 2.0);
    for side in [1.0, -1.0] {
        // Seen from outside: the ridge above, the eave below.
        let out = x * side;
        let right = (-out).cross(&z);
        let down = (out * (size.x / 2.0) - z * rise) / slope;
        let origin = top + z * rise - right * (size.y / 2.0);
        b.quad([origin, right, down], size.y, slope, 0.015, |c, r| {
            Material::Tiles(95.0, 0.3).coat(c);
            Decor::wear(c, r, 1.0, 50.0);
            let (w, h) = (c.width_m(), c.height_m());
            Decor::window(c, r, 0.3 * w, 0.35 * h, 0.8, 0.9);
        });
        let gable = y * side;
        let right = (-gable).cross(&z);
        let origin = top + gable * (size.y / 2.0) - right * (size.x / 2.0) + z * rise;
        let corners = vec![Vec2::new(size.x / 2.0, 0.0), Vec2::new(size.x, rise), Vec2::new(0.0, rise)];
        b.polygon([origin, right, -z], corners, 0.012, |c, _| Material::Brick(110.0).coat(c));
    }
    let chimney = Block {
        at: at + (y * (0.25 * size.y)).xy(),
        base: size.z + 0.4 * rise,
        size: Vec3::new(0.6, 0.6, rise * 0.6 + 0.9),
        yaw,
        texel: 0.012,
    };
    b.block(&chimney, |_, c, _| Material::Brick(100.0).coat(c));
}

/// A tree: a trunk and a crown of turned boxes.
pub(super) fn tree(b: &mut Builder, at: Vec2) {
    b.add_obstacle(at, Vec2::new(0.16, 0.16), 0.0);
    let height = b.random.uniform(2.0, 2.8);
    let yaw = b.random.uniform(0.0, 1.5);
    let trunk = Block { at, base: 0.0, size: Vec3::new(0.28, 0.28, height), yaw, texel: 0.006 };
    b.block(&trunk, |_, c, r| {
        Material::Planks(80.0).coat(c);
        Decor::wear(c, r, 25.0, 50.0);
    });
    for _ in 0..7 {
        let s = b.random.uniform(0.9, 1.9);
        let offset = Vec2::new(b.random.uniform(-0.8, 0.8), b.random.uniform(-0.8, 0.8));
        let leaf = Block {
            at: at + offset,
            base: height - 0.4 + b.random.uniform(0.0, 1.6),
            size: Vec3::new(s, s * b.random.uniform(0.7, 1.2), s * b.random.uniform(0.6, 1.0)),
            yaw: b.random.uniform(0.0, 1.5),
            texel: 0.016,
        };
        let tone = b.random.uniform_f32(95.0, 130.0);
        b.block(&leaf, |_, c, _| Material::Leaves(tone).coat(c));
    }
}

/// A lamp post with a sign.
pub(super) fn pole(b: &mut Builder, at: Vec2, yaw: f64) {
    b.add_obstacle(at, Vec2::new(0.07, 0.07), yaw);
    let post = Block { at, base: 0.0, size: Vec3::new(0.12, 0.12, 4.6), yaw, texel: 0.006 };
    b.block(&post, |_, c, r| {
        Material::Board(105.0).coat(c);
        Decor::wear(c, r, 25.0, 60.0);
        let h = c.height_m();
        for k in 0..4 {
            c.rect(0.0, h - 0.5 - 0.5 * k as f32, 0.2, 0.22, 215.0, 1.0);
        }
    });
    let sign = Block { at, base: 2.1, size: Vec3::new(0.15, 0.65, 0.65), yaw, texel: 0.005 };
    b.block(&sign, |_, c, r| {
        let (w, h) = (c.width_m(), c.height_m());
        Decor::picture(c, r, 0.0, 0.0, w, h);
        c.frame(0.0, 0.0, w, h, 0.04, 30.0);
    });
}

/// A parked car along its own x.
pub(super) fn car(b: &mut Builder, at: Vec2, yaw: f64) {
    b.add_obstacle(at, Vec2::new(2.1, 0.88), yaw);
    let paint = b.random.uniform_f32(40.0, 215.0);
    let body = Block { at, base: 0.18, size: Vec3::new(4.2, 1.76, 0.68), yaw, texel: 0.008 };
    b.block(&body, |which, c, r| {
        Material::Board(paint).coat(c);
        let (w, h) = (c.width_m(), c.height_m());
        match which {
            BoxFace::Left | BoxFace::Right => {
                for x in [0.8, w - 0.8] {
                    c.disc(x, h - 0.02, 0.36, 15.0, 1.0);
                    c.disc(x, h - 0.02, 0.24, 185.0, 1.0);
                    c.disc(x, h - 0.02, 0.08, 60.0, 1.0);
                }
                for k in [0.35, 0.6] {
                    c.rect(k * w, 0.0, 0.015, h * 0.9, 20.0, 0.8);
                    c.rect(k * w - 0.25, 0.15, 0.16, 0.035, 20.0, 0.9);
                }
            }
            BoxFace::Front | BoxFace::Back => {
                for x in [0.1, w - 0.45] {
                    c.rect(x, 0.12, 0.35, 0.16, 245.0, 1.0);
                    c.frame(x, 0.12, 0.35, 0.16, 0.02, 30.0);
                }
                c.rect(w / 2.0 - 0.26, 0.34, 0.52, 0.12, 240.0, 1.0);
                Decor::text(c, r, w / 2.0 - 0.23, 0.36, 0.46, 1, 0.08, 240.0);
                c.rect(0.0, h - 0.14, w, 0.14, 40.0, 1.0);
            }
            _ => {}
        }
        Decor::wear(c, r, 2.0, 40.0);
    });
    let (s, k) = yaw.sin_cos();
    let cabin_at = at - Vec2::new(k, s) * 0.25;
    let cabin = Block { at: cabin_at, base: 0.86, size: Vec3::new(2.2, 1.6, 0.55), yaw, texel: 0.008 };
    b.block(&cabin, |which, c, _| {
        Material::Board(paint).coat(c);
        let (w, h) = (c.width_m(), c.height_m());
        if which != BoxFace::Top {
            c.rect(0.08, 0.06, w - 0.16, h - 0.1, 45.0, 1.0);
            c.polygon(
                &[(0.2 * w, 0.06), (0.35 * w, 0.06), (0.2 * w, h - 0.04), (0.08 * w, h - 0.04)],
                120.0,
                0.8,
            );
            if w > 2.0 {
                c.rect(w / 2.0 - 0.04, 0.0, 0.08, h, paint, 1.0);
            }
        }
    });
}

/// A hedge from one point to another.
pub(super) fn hedge(b: &mut Builder, from: Vec2, to: Vec2) {
    let d = to - from;
    let (at, yaw) = ((from + to) / 2.0, d.y.atan2(d.x));
    b.add_obstacle(at, Vec2::new(d.norm() / 2.0, 0.25), yaw);
    let size = Vec3::new(d.norm(), 0.5, b.random.uniform(0.8, 1.2));
    b.block(&Block { at, base: 0.0, size, yaw, texel: 0.01 }, |_, c, _| Material::Leaves(105.0).coat(c));
}
