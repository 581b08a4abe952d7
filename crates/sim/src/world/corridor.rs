//! Corridors: a ring with a branch, and the demo's route with three turns.

use super::NamedRoute;
use super::build::Builder;
use super::furniture::Piece;
use super::plan::{self, Dress, Room};
use crate::texture::Material;
use cairn_geometry::Vec2;
use cairn_random::Random;

/// A piece of corridor.
pub(super) fn hallway(r: &mut Random, area: [f64; 4], stream: u64) -> Room {
    let walls =
        [Material::Plaster(165.0), Material::Brick(118.0), Material::Paper(172.0), Material::Plaster(140.0)];
    let floors = [
        Material::Tiles(135.0, 0.4),
        Material::Carpet(110.0),
        Material::Planks(125.0),
        Material::Tiles(120.0, 0.6),
    ];
    Room {
        area,
        height: 2.6,
        wall: walls[r.below(walls.len())],
        floor: floors[r.below(floors.len())],
        dress: Dress::Corridor,
        stream: stream | 1 << 40,
    }
}

/// Puts furniture along walls wherever it leaves room for the routes.
pub(super) fn line_walls(
    b: &mut Builder,
    area: [f64; 4],
    pieces: &[Piece],
    tries: usize,
    margin: f64,
    ceiling: f64,
) {
    let [x0, y0, x1, y1] = area;
    for _ in 0..tries {
        let piece = pieces[b.random.below(pieces.len())];
        let half = piece.half();
        let gap = half.x + 0.03;
        let (tx, ty) = (b.random.uniform(x0, x1), b.random.uniform(y0, y1));
        let (at, yaw) = match b.random.below(4) {
            0 => (Vec2::new(x0 + gap, ty), 0.0),
            1 => (Vec2::new(x1 - gap, ty), std::f64::consts::PI),
            2 => (Vec2::new(tx, y0 + gap), std::f64::consts::FRAC_PI_2),
            _ => (Vec2::new(tx, y1 - gap), -std::f64::consts::FRAC_PI_2),
        };
        if b.has_room(at, half, yaw, margin) {
            piece.place(b, at, yaw, ceiling);
        }
    }
}

const ALONG_WALLS: [Piece; 5] = [Piece::Plant, Piece::Bench, Piece::Shelf, Piece::Cartons, Piece::Cabinet];

fn furnish(b: &mut Builder, rooms: &[Room], margin: f64) {
    for (i, room) in rooms.iter().enumerate() {
        b.stream(0xF00D + i as u64);
        let [x0, y0, x1, y1] = room.area;
        let tries = ((x1 - x0) * (y1 - y0) * 0.5) as usize + 2;
        line_walls(b, room.area, &ALONG_WALLS, tries, margin, room.height);
    }
}

/// A ring of corridors of 2.4 m with a branch; sizes differ by seed.
pub(super) fn ring(b: &mut Builder) {
    let r = &mut b.random;
    let (w, d, k) = (r.uniform(18.0, 24.0), r.uniform(11.0, 15.0), 2.4);
    let branch = r.uniform(6.0, 9.0);
    let bx = (r.uniform(0.35, 0.6) * w).round();
    let areas = [
        [0.0, 0.0, w, k],
        [w - k, k, w, d - k],
        [0.0, d - k, w, d],
        [0.0, k, k, d - k],
        [bx, -branch, bx + k, 0.0],
    ];
    let rooms: Vec<Room> = areas.iter().enumerate().map(|(i, a)| hallway(r, *a, i as u64)).collect();
    let (l, h, t) = (k / 2.0, w - k / 2.0, d - k / 2.0);
    let mid = bx + l;
    let ring = [(l, l), (h, l), (h, t), (l, t), (l, l)];
    b.routes.push(NamedRoute::new("loop", &ring));
    b.routes.push(NamedRoute::new("twice", &[&ring[..], &ring[1..]].concat()));
    b.routes.push(NamedRoute::new("half", &ring[..3]));
    let end = -branch + 1.3;
    b.routes
        .push(NamedRoute::new("branch", &[(l, t), (l, l), (mid, l), (mid, end), (mid, l), (h, l), (h, t)]));
    let ten: Vec<(f64, f64)> =
        std::iter::once(ring[0]).chain((0..11).flat_map(|_| ring[1..].to_vec())).collect();
    b.routes.push(NamedRoute::new("long", &ten));
    plan::build(b, &rooms);
    furnish(b, &rooms, 0.5);
}

/// Four corridors with a left, a right and a right turn: about 40 m from end to end.
pub(super) fn demo(b: &mut Builder) {
    let k = 2.4;
    let r = &mut b.random;
    let (a, c, d) = (r.uniform(11.0, 12.5), r.uniform(8.5, 10.0), r.uniform(10.0, 11.5));
    let e = r.uniform(9.0, 10.0);
    let (x1, y1) = (a, c);
    let x2 = x1 + d;
    let areas = [
        [0.0, 0.0, x1 + k, k],
        [x1, k, x1 + k, y1 + k],
        [x1 + k, y1, x2 + k, y1 + k],
        [x2, y1 - e, x2 + k, y1],
    ];
    let rooms: Vec<Room> = areas.iter().enumerate().map(|(i, a)| hallway(r, *a, i as u64)).collect();
    let m = k / 2.0;
    let out = NamedRoute::new(
        "out",
        &[(1.3, m), (x1 + m, m), (x1 + m, y1 + m), (x2 + m, y1 + m), (x2 + m, y1 - e + 1.3)],
    );
    b.routes.push(out.clone());
    b.routes.push(out.reversed("home"));
    let mut both = out.points.clone();
    both.extend(out.points.iter().rev().skip(1));
    b.routes.push(NamedRoute { name: "out-and-home".into(), points: both });
    plan::build(b, &rooms);
    // People who walk by spoken directions stray: three quarters of a metre stay free on each side.
    furnish(b, &rooms, 0.72);
}
