//! Furniture: each piece is a few painted boxes and a footprint.

use super::build::{Block, BoxFace, Builder};
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};

/// A piece of furniture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Piece {
    /// A desk with a screen and things on it.
    Desk,
    /// A chair.
    Chair,
    /// A shelf full of books.
    Shelf,
    /// A low cabinet with drawers.
    Cabinet,
    /// A pot with leaves.
    Plant,
    /// A sofa.
    Sofa,
    /// Stacked cartons.
    Cartons,
    /// A square column up to the ceiling.
    Column,
    /// A bench along a wall.
    Bench,
}

impl Piece {
    /// Half sizes of the footprint: depth and width.
    pub fn half(self) -> Vec2 {
        match self {
            Piece::Desk => Vec2::new(0.4, 0.8),
            Piece::Chair => Vec2::new(0.24, 0.24),
            Piece::Shelf => Vec2::new(0.16, 0.6),
            Piece::Cabinet => Vec2::new(0.22, 0.5),
            Piece::Plant => Vec2::new(0.2, 0.2),
            Piece::Sofa => Vec2::new(0.42, 0.9),
            Piece::Cartons => Vec2::new(0.3, 0.35),
            Piece::Column => Vec2::new(0.28, 0.28),
            Piece::Bench => Vec2::new(0.18, 0.7),
        }
    }

    /// Places it; its front faces along `yaw`.
    pub fn place(self, b: &mut Builder, at: Vec2, yaw: f64, ceiling: f64) {
        b.add_obstacle(at, self.half(), yaw);
        let put = Put { at, yaw };
        match self {
            Piece::Desk => desk(b, put),
            Piece::Chair => chair(b, put),
            Piece::Shelf => shelf(b, put, ceiling),
            Piece::Cabinet => cabinet(b, put),
            Piece::Plant => plant(b, put),
            Piece::Sofa => sofa(b, put),
            Piece::Cartons => cartons(b, put),
            Piece::Column => column(b, put, ceiling),
            Piece::Bench => bench(b, put),
        }
    }
}

/// The pose of a piece.
#[derive(Clone, Copy)]
struct Put {
    at: Vec2,
    yaw: f64,
}

impl Put {
    /// A box of this piece: its middle in the piece's own axes, its base height, its sizes, its own turn.
    fn part(&self, x: f64, y: f64, base: f64, size: [f64; 3], turn: f64) -> Block {
        let (s, c) = self.yaw.sin_cos();
        Block {
            at: self.at + Vec2::new(c * x - s * y, s * x + c * y),
            base,
            size: Vec3::new(size[0], size[1], size[2]),
            yaw: self.yaw + turn,
            texel: 0.004,
        }
    }
}

fn wood(b: &mut Builder, block: &Block, tone: f32) {
    b.block(block, |_, c, r| {
        Material::Board(tone).coat(c);
        Decor::wear(c, r, 4.0, 40.0);
    });
}

fn desk(b: &mut Builder, p: Put) {
    let tone = b.random.uniform_f32(110.0, 200.0);
    wood(b, &p.part(0.0, 0.0, 0.7, [0.8, 1.6, 0.04], 0.0), tone);
    for (x, y) in [(-0.35, -0.74), (-0.35, 0.74), (0.35, -0.74), (0.35, 0.74)] {
        wood(b, &p.part(x, y, 0.0, [0.06, 0.06, 0.7], 0.0), tone - 50.0);
    }
    wood(b, &p.part(-0.33, 0.0, 0.3, [0.03, 1.4, 0.4], 0.0), tone - 20.0);
    // The screen is at the back and faces along -x, towards the chair's side or away, at random.
    let side = b.random.uniform(-0.35, 0.35);
    let turn = b.random.uniform(-0.4, 0.4);
    wood(b, &p.part(-0.15, side, 0.74, [0.05, 0.1, 0.12], turn), 40.0);
    b.block(&p.part(-0.15, side, 0.84, [0.05, 0.56, 0.36], turn), |which, c, r| {
        Material::Board(45.0).coat(c);
        let (w, h) = (c.width_m(), c.height_m());
        if which == BoxFace::Front {
            c.rect(0.02, 0.02, w - 0.04, h - 0.05, 205.0, 1.0);
            Decor::text(c, r, 0.04, 0.05, w * 0.5, 9, 0.014, 205.0);
            Decor::picture(c, r, w * 0.62, 0.05, w * 0.3, h * 0.5);
        } else if which == BoxFace::Back {
            Decor::text(c, r, w * 0.4, h * 0.4, w * 0.2, 1, 0.03, 45.0);
            c.frame(0.1, 0.06, w - 0.2, h - 0.12, 0.012, 80.0);
        }
    });
    clutter(b, p, 0.74, 5, [0.3, 0.7]);
}

/// Books, cups and paper on a board.
fn clutter(b: &mut Builder, p: Put, base: f64, count: usize, reach: [f64; 2]) {
    for _ in 0..count {
        let (x, y) = (b.random.uniform(-reach[0], reach[0]), b.random.uniform(-reach[1], reach[1]));
        let size = [b.random.uniform(0.08, 0.24), b.random.uniform(0.08, 0.28), b.random.uniform(0.02, 0.16)];
        let turn = b.random.uniform(-0.8, 0.8);
        let tone = b.random.uniform_f32(40.0, 225.0);
        b.block(&p.part(x, y, base, size, turn), |_, c, r| {
            Material::Board(tone).coat(c);
            let (w, h) = (c.width_m(), c.height_m());
            if w > 0.07 && h > 0.07 {
                Decor::picture(c, r, 0.15 * w, 0.15 * h, 0.7 * w, 0.7 * h);
            }
        });
    }
}

fn chair(b: &mut Builder, p: Put) {
    let tone = b.random.uniform_f32(50.0, 150.0);
    b.block(&p.part(0.0, 0.0, 0.43, [0.44, 0.44, 0.06], 0.0), |_, c, _| Material::Carpet(tone).coat(c));
    b.block(&p.part(-0.2, 0.0, 0.52, [0.05, 0.42, 0.42], 0.0), |_, c, r| {
        Material::Carpet(tone).coat(c);
        let (w, h) = (c.width_m(), c.height_m());
        if w > 0.2 && h > 0.2 {
            c.frame(0.0, 0.0, w, h, 0.02, tone - 40.0);
            Decor::text(c, r, w * 0.3, h * 0.2, w * 0.4, 1, 0.03, tone);
        }
    });
    for (x, y) in [(-0.19, -0.19), (-0.19, 0.19), (0.19, -0.19), (0.19, 0.19)] {
        wood(b, &p.part(x, y, 0.0, [0.04, 0.04, 0.43], 0.0), 70.0);
    }
}

fn shelf(b: &mut Builder, p: Put, ceiling: f64) {
    let tone = b.random.uniform_f32(80.0, 190.0);
    let height = b.random.uniform(1.5, 2.1).min(ceiling - 0.1);
    b.block(&p.part(0.0, 0.0, 0.0, [0.32, 1.2, height], 0.0), |which, c, r| {
        if which == BoxFace::Front {
            Decor::books(c, r, tone);
        } else {
            Material::Board(tone).coat(c);
            Decor::wear(c, r, 5.0, 45.0);
        }
    });
}

fn cabinet(b: &mut Builder, p: Put) {
    let tone = b.random.uniform_f32(90.0, 200.0);
    b.block(&p.part(0.0, 0.0, 0.0, [0.44, 1.0, 0.85], 0.0), |which, c, r| {
        Material::Board(tone).coat(c);
        if which == BoxFace::Front {
            for i in 0..2 {
                for j in 0..3 {
                    let (x, y) = (0.03 + 0.48 * i as f32, 0.03 + 0.27 * j as f32);
                    c.frame(x, y, 0.46, 0.25, 0.01, tone - 60.0);
                    c.rect(x + 0.16, y + 0.05, 0.14, 0.02, 30.0, 1.0);
                    c.rect(x + 0.16, y + 0.11, 0.1, 0.05, 238.0, 1.0);
                    Decor::text(c, r, x + 0.165, y + 0.12, 0.09, 1, 0.025, 238.0);
                }
            }
        }
        Decor::wear(c, r, 5.0, 50.0);
    });
    clutter(b, p, 0.85, 4, [0.12, 0.38]);
}

fn plant(b: &mut Builder, p: Put) {
    let pot = b.random.uniform_f32(60.0, 210.0);
    b.block(&p.part(0.0, 0.0, 0.0, [0.28, 0.28, 0.32], 0.0), |_, c, r| {
        Material::Board(pot).coat(c);
        let w = c.width_m();
        c.rect(0.0, 0.03, w, 0.04, 255.0 - pot, 0.7);
        Decor::wear(c, r, 30.0, 50.0);
    });
    for i in 0..5 {
        let (x, y) = (b.random.uniform(-0.13, 0.13), b.random.uniform(-0.13, 0.13));
        let size = [b.random.uniform(0.12, 0.3), b.random.uniform(0.12, 0.3), b.random.uniform(0.15, 0.4)];
        let (base, turn) = (0.32 + 0.16 * f64::from(i), b.random.uniform(0.0, 1.5));
        b.block(&p.part(x, y, base, size, turn), |_, c, _| Material::Leaves(105.0).coat(c));
    }
}

fn sofa(b: &mut Builder, p: Put) {
    let tone = b.random.uniform_f32(60.0, 170.0);
    let parts = [
        (0.0, 0.0, 0.08, [0.84, 1.8, 0.34]),
        (-0.32, 0.0, 0.42, [0.2, 1.8, 0.42]),
        (0.05, 0.8, 0.42, [0.7, 0.2, 0.2]),
        (0.05, -0.8, 0.42, [0.7, 0.2, 0.2]),
    ];
    for (x, y, base, size) in parts {
        b.block(&p.part(x, y, base, size, 0.0), |_, c, r| {
            Material::Carpet(tone).coat(c);
            Decor::wear(c, r, 6.0, 45.0);
        });
    }
    for y in [-0.4, 0.35] {
        let turn = b.random.uniform(-0.5, 0.5);
        b.block(&p.part(-0.12, y, 0.42, [0.14, 0.4, 0.36], turn), |_, c, r| {
            let (w, h) = (c.width_m(), c.height_m());
            Decor::picture(c, r, 0.0, 0.0, w, h);
        });
    }
}

fn cartons(b: &mut Builder, p: Put) {
    let mut base = 0.0;
    for i in 0..3 {
        let k = 1.0 - 0.15 * f64::from(i);
        let size = [0.56 * k, 0.64 * k, b.random.uniform(0.25, 0.42)];
        let turn = b.random.uniform(-0.25, 0.25) * f64::from(i.min(1));
        let tone = b.random.uniform_f32(120.0, 180.0);
        b.block(&p.part(0.0, 0.0, base, size, turn), |_, c, r| {
            Material::Board(tone).coat(c);
            let (w, h) = (c.width_m(), c.height_m());
            c.rect(0.45 * w, 0.0, 0.08 * w, h, tone + 45.0, 0.8);
            Decor::text(c, r, 0.08 * w, 0.3 * h, 0.35 * w, 2, 0.05, tone);
            Decor::notice(c, r, 0.6 * w, 0.3 * h, 0.3 * w, 0.4 * h);
            Decor::wear(c, r, 12.0, 45.0);
        });
        base += size[2];
    }
}

fn column(b: &mut Builder, p: Put, ceiling: f64) {
    b.block(&p.part(0.0, 0.0, 0.0, [0.5, 0.5, ceiling], 0.0), |_, c, r| {
        Material::Plaster(165.0).coat(c);
        Decor::wear(c, r, 8.0, 50.0);
        let (w, h) = (c.width_m(), c.height_m());
        c.rect(0.0, h - 0.3, w, 0.3, 70.0, 1.0);
        let y = h - 1.2 - r.uniform_f32(0.2, 0.5);
        Decor::picture(c, r, 0.06, y, w - 0.12, 0.5);
        Decor::notice(c, r, 0.12, y + 0.6, 0.21, 0.29);
    });
}

fn bench(b: &mut Builder, p: Put) {
    let tone = b.random.uniform_f32(90.0, 170.0);
    b.block(&p.part(0.0, 0.0, 0.42, [0.36, 1.4, 0.05], 0.0), |_, c, r| {
        Material::Planks(tone).coat(c);
        Decor::wear(c, r, 10.0, 50.0);
    });
    for y in [-0.6, 0.6] {
        wood(b, &p.part(0.0, y, 0.0, [0.32, 0.06, 0.42], 0.0), 50.0);
    }
}
