//! One big room: columns, groups of tables, sofas, shelves along the walls.

use super::NamedRoute;
use super::build::Builder;
use super::corridor::line_walls;
use super::furniture::Piece;
use super::plan::{self, Dress, Room};
use crate::texture::Material;
use cairn_geometry::Vec2;

/// A hall of about 22 by 15 m, 4 m high.
pub(super) fn build(b: &mut Builder) {
    let (w, d) = (b.random.uniform(20.0, 24.0), b.random.uniform(14.0, 16.5));
    let walls = [Material::Brick(120.0), Material::Plaster(160.0), Material::Paper(165.0)];
    let floors = [Material::Tiles(130.0, 0.6), Material::Planks(120.0), Material::Tiles(140.0, 0.35)];
    let room = Room {
        area: [0.0, 0.0, w, d],
        height: 4.0,
        wall: walls[b.random.below(3)],
        floor: floors[b.random.below(3)],
        dress: Dress::Hall,
        stream: 3 | 1 << 40,
    };
    let (l, h, t) = (2.2, w - 2.2, d - 2.2);
    let (mx, my) = (w / 2.0, d / 2.0);
    let around = [(l, l), (h, l), (h, t), (l, t), (l, l)];
    b.routes.push(NamedRoute::new("loop", &around));
    b.routes.push(NamedRoute::new("eight", &[(l, l), (mx, my), (h, t), (h, l), (mx, my), (l, t), (l, l)]));
    b.routes.push(NamedRoute::new("across", &[(l, l), (mx, my), (h, t)]));
    let long: Vec<(f64, f64)> =
        std::iter::once(around[0]).chain((0..10).flat_map(|_| around[1..].to_vec())).collect();
    b.routes.push(NamedRoute::new("long", &long));
    plan::build(b, &[room]);
    b.stream(0xBA11);
    for (fx, fy) in [(0.25, 0.5), (0.75, 0.5), (0.5, 0.25), (0.5, 0.75)] {
        let at = Vec2::new(fx * w, fy * d);
        if b.has_room(at, Piece::Column.half(), 0.0, 0.6) {
            Piece::Column.place(b, at, 0.0, room.height);
        }
    }
    let pieces = [
        Piece::Desk,
        Piece::Desk,
        Piece::Chair,
        Piece::Sofa,
        Piece::Plant,
        Piece::Cartons,
        Piece::Cabinet,
        Piece::Shelf,
        Piece::Bench,
    ];
    for _ in 0..90 {
        let piece = pieces[b.random.below(pieces.len())];
        let at = Vec2::new(b.random.uniform(1.0, w - 1.0), b.random.uniform(1.0, d - 1.0));
        let yaw = b.random.uniform(-3.1, 3.1);
        if b.has_room(at, piece.half(), yaw, 0.55) {
            piece.place(b, at, yaw, room.height);
        }
    }
    line_walls(
        b,
        room.area,
        &[Piece::Shelf, Piece::Cabinet, Piece::Plant, Piece::Bench],
        24,
        0.6,
        room.height,
    );
}
